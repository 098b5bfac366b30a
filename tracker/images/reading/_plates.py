"""Clean plates: from pictures of the empty scene, or from the recording itself."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image, Mask
from tracker.foundation.errors import SequenceError
from tracker.images.operations.appearance import Light, light_of, sparse
from tracker.images.operations.masks import grown
from tracker.images.plate import LEAST_INLIERS, MOST_LEVEL, Plate, aligned, changed
from tracker.images.reading._footage import view_paths
from tracker.images.reading._pictures import check_size, read_image
from tracker.kernels.changes import dominant_modes

N_SAMPLES = 25
"""Images, spread over a recording, that a plate is made of."""

# Colours that agree: six deviations of a noise of 2 grey levels.
_REACH = 12
# A place is free if so many images agree, and not so many others on another colour: a person may stand for most of the
# time and leave. See docs/lab/backdrops.md.
_MOST, _RIVALS = 0.6, 0.3


# Rows of all images that are looked at together: 25 images of 4K are 0.6 GiB, which need not be there twice.
_ROWS = 64
# Unknown regions grow by this share of the longer side: 7 px of 720, because colours are smoothed and bodies sway.
_GROWN = 0.01


@dataclass(frozen=True)
class RecordedPlate:
    """A plate from images with persons, and its quality."""

    plate: Plate
    """Unknown where no colour is surely the scene's."""

    moving: float
    """Share of the view that persons cover at some time: nearly nothing if no person ever moves."""

    known: float
    """Known share of the pixels that persons cover in an image: 1 if they walk about, less if they stay."""

    level: float
    """Median threshold of the images against the plate, grey levels."""


def recorded_plate(images: Sequence[Image]) -> RecordedPlate:
    """The dominant colour of every pixel, over images (h, w, 3) brought to the same light."""
    middle = np.median([sparse(image) for image in images], axis=0).astype(np.uint8)
    lights = [light_of(middle, sparse(image)) for image in images]
    shape, n = images[0].shape[:2], len(images)
    picture, counts, rivals = np.empty((*shape, 3), np.uint8), np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    for top in range(0, shape[0], _ROWS):
        rows = slice(top, top + _ROWS)
        strips = (_lit(image[rows], light, top) for image, light in zip(images, lights, strict=True))
        dominant_modes(np.stack(list(strips)), _REACH, picture[rows], counts[rows], rivals[rows])
    masks, levels = np.empty((n, *shape), dtype=np.bool_), np.empty(n)
    for k, (image, light) in enumerate(zip(images, lights, strict=True)):
        _, masks[k], levels[k] = changed(_lit(image, light), Plate(picture))
    doubted = (counts < _MOST * n) | (rivals >= _RIVALS * n)
    unknown = _grown(doubted & masks.any(axis=0))
    covered_px, known_px = float(np.median(_sizes(masks))), float(np.median(_sizes(masks, ~unknown)))
    plate, moving = Plate(picture, unknown, recorded=True), float(masks.any(axis=0).mean())
    return RecordedPlate(plate, moving, known_px / max(covered_px, 1.0), float(np.median(levels)))


def _lit(part: Image, light: Light | None, top: int = 0) -> Image:
    """Rows of an image (h, w, 3), from `top` on, in the light that all have in common."""
    return np.ascontiguousarray(part) if light is None else light.on(part, (0, top))


def _sizes(masks: Mask, within: Mask | None = None) -> list[int]:
    """Pixels of each mask (n, h, w)."""
    return [int(np.count_nonzero(mask if within is None else mask & within)) for mask in masks]


def _grown(doubted: Mask) -> Mask:
    """Without specks, and wider by `_GROWN`."""
    opened = cv2.morphologyEx(doubted.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return grown(opened.view(np.bool_), _GROWN * max(doubted.shape))


_IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}
# Of 35 views of nine recordings, plates of those where 0.5 and more of what persons cover is known show nobody (11 have
# 0.74 to 0.96, two 0.50 and 0.57), two of 0.45 and 0.47 nobody either; of the others, 0.04 to 0.40, most show a person.
_LEAST_KNOWN = 0.5
# A foreground in a single view tells nothing of depth.
_LEAST_VIEWS = 2
# Less of an image than this is no person.
_LEAST_MOVING = 0.002
_LEAST_IMAGES = 10

log = logging.getLogger("tracker")


def load_plates(
    rig: Rig,
    pattern: str | None,
    delivered: Callable[[Image], Image],
    clip: Callable[[Path], Image],
    fit_to: tuple[Image | None, ...] | None = None,
) -> tuple[Plate | None, ...]:
    """Clean plates of all views.

    Args:
        rig: names the views, and has their image sizes.
        pattern: path with `{view}` to an image or a clip; None for no plates.
        delivered: makes of a picture as recorded what is compared with the images.
        clip: reads a plate from a video file.
        fit_to: an image of each view that its plate is fitted to; None for plates that fit as they are.

    Raises:
        SequenceError: a plate is missing or unreadable, or does not show what its view does.
    """
    if pattern is None:
        return (None,) * len(rig)
    plates: list[Plate | None] = []
    for v, (camera, path) in enumerate(zip(rig.cameras, view_paths(pattern, rig.names), strict=True)):
        plate = _read_plate(camera.name, path, clip)
        if fit_to is not None:
            plate = _fitted_plate(camera.name, plate, path, fit_to[v])
        check_size(camera.name, plate, camera.size, f"the background {path}")
        plates.append(Plate(delivered(plate)))
    return tuple(plates)


def _read_plate(name: str, path: Path, clip: Callable[[Path], Image]) -> Image:
    if not path.exists():
        raise SequenceError(f'background of view "{name}": no file {path}')
    plate = read_image(path) if path.suffix.lower() in _IMAGES else clip(path)
    if plate is None:
        raise SequenceError(f'background of view "{name}": {path} is not an image that can be read')
    return plate


def _fitted_plate(name: str, plate: Image, path: Path, image: Image | None) -> Image:
    if image is None:
        raise SequenceError(f'background of view "{name}": no first image to fit the plate to; unset align_background')
    fitted, n_agree = aligned(plate, image)
    if n_agree < LEAST_INLIERS:
        raise SequenceError(
            f'background of view "{name}": {path} and the first image have {n_agree} features in common, expected at '
            f"least {LEAST_INLIERS}: is it the plate of another view, or was the camera carried elsewhere?"
        )
    return fitted


def recorded_plates(names: Sequence[str], images_of: Callable[[int], Sequence[Image]]) -> tuple[Plate | None, ...]:
    """Plates from most images; None, with a warning that says why, for views in which a person stays.

    Args:
        names: of the views.
        images_of: images (h, w, 3) of a view, by its number, spread over the recording.
    """
    plates: list[Plate | None] = []
    for v, name in enumerate(names):
        plate, fault = _recorded(images_of(v), _LEAST_KNOWN)
        if fault:
            log.warning('view "%s": no plate can be made from the recording: %s', name, fault)
        plates.append(None if plate is None else plate.plate)
    return tuple(plates)


def backdrop(images: Sequence[Image]) -> RecordedPlate | None:
    """Most frequent colours of a view's images (h, w, 3), persons who stay included; None if nothing, or all, moves."""
    return _recorded(images, 0.0)[0]


def clean_enough(backdrops: Sequence[RecordedPlate | None]) -> tuple[Plate | None, ...]:
    """Backdrops as plates if no person stays in two views; otherwise none.

    A person who walks about in two views does so in space, and stays in the others only along the line of sight: the
    plate is unknown there. Of a person who moves an arm or two the rest would be background. With the plates of only
    two views two recordings were 65 and 37 mm off; with those of all four 31 and 24.
    """
    free = sum(one is not None and one.known >= _LEAST_KNOWN for one in backdrops)
    return tuple(None if one is None or free < _LEAST_VIEWS else one.plate for one in backdrops)


def _recorded(images: Sequence[Image], least_known: float) -> tuple[RecordedPlate | None, str]:
    """A plate, or why there is none."""
    if len(images) < _LEAST_IMAGES:
        return None, f"it has {len(images)} images to make it of, expected at least {_LEAST_IMAGES}"
    found = recorded_plate(images)
    if found.level > MOST_LEVEL:
        return None, f"its images differ from one another by {found.level:.0f} grey levels: did the camera move?"
    if found.moving < _LEAST_MOVING:
        return (
            None,
            "nobody moves: a person who stands there all the time would be in it; film the scene without persons",
        )
    if found.known < least_known:
        return None, (
            f"a person stays in one place ({found.known:.0%} of the pixels that persons cover are known without them, "
            f"expected at least {least_known:.0%}); film the scene without persons, or bring masks"
        )
    return found, ""
