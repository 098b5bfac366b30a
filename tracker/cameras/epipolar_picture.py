"""A picture of the epipolar lines of a rig, by which eyes tell whether it is right."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import CalibrationError

# BGR, told apart on dark and bright.
_COLOURS = ((66, 135, 245), (72, 199, 116), (235, 120, 60), (200, 90, 200), (60, 200, 220), (120, 120, 250))
# Lines of a view in another one: more can't be told apart.
_N_FEATURES = 6


def epipolar_picture(rig: Rig, images: tuple[Image, ...], source: int = 0) -> Image:
    """Distinct points of one view and their epipolar lines over the others (figure 7 of Gavrila & Davis 1996).

    Where the rig is right, each line passes through what the point of its colour shows.

    Args:
        rig: the cameras.
        images: one picture of each view, taken at one time.
        source: the view whose points are chosen.

    Raises:
        CalibrationError: a picture has another size than its camera.
    """
    for camera, image in zip(rig.cameras, images, strict=True):
        if (image.shape[1], image.shape[0]) != camera.size:
            raise CalibrationError(
                f'view "{camera.name}": the picture has {image.shape[1]}x{image.shape[0]} px, the rig was calibrated '
                f"at {camera.size[0]}x{camera.size[1]}"
            )
    shown = [image.copy() if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in images]
    width = max(1, round(rig.cameras[source].size[0] / 500))
    for k, pixel in enumerate(_features(images[source])):
        colour = _COLOURS[k % len(_COLOURS)]
        cv2.circle(shown[source], _whole(pixel), 5 * width, colour, width + 1, cv2.LINE_AA)
        for target in range(len(rig)):
            if target != source:
                line = rig.epipolar_line(pixel, source, target, 400)
                near = line[(np.abs(line) < 1e5).all(axis=1)]
                cv2.polylines(shown[target], [near.round().astype(np.int32)], False, colour, width, cv2.LINE_AA)
    for camera, image in zip(rig.cameras, shown, strict=True):
        place = 10 * width, 24 * width
        cv2.putText(image, camera.name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7 * width, (255, 255, 255), width + 1)
    return _tiled(shown)


def _features(image: Image) -> Array:
    """(N, 2) distinct pixels, well apart, in the middle of a picture."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    mask = np.zeros_like(grey)
    mask[height // 6 : -height // 6, width // 6 : -width // 6] = 255
    found = cv2.goodFeaturesToTrack(grey, _N_FEATURES, 0.05, min(height, width) / 6, mask=mask)
    return np.zeros((0, 2)) if found is None else np.asarray(found.reshape(-1, 2), dtype=np.float64)


def _whole(pixel: Array) -> tuple[int, int]:
    return round(float(pixel[0])), round(float(pixel[1]))


def _tiled(images: list[Image], width_px: int = 800) -> Image:
    """Pictures two in a row."""
    sized = [
        cv2.resize(i, (width_px, round(width_px * i.shape[0] / i.shape[1])), interpolation=cv2.INTER_AREA)
        for i in images
    ]
    tallest = max(image.shape[0] for image in sized)
    padded = [np.pad(image, ((0, tallest - image.shape[0]), (0, 0), (0, 0))) for image in sized]
    if len(padded) % 2:
        padded.append(np.zeros_like(padded[0]))
    rows = [np.hstack(padded[k : k + 2]) for k in range(0, len(padded), 2)]
    picture: Image = np.vstack(rows)
    return picture
