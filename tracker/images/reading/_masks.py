"""Silhouettes that a user brings: one mask a view and frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Mask, frozen
from tracker.foundation.errors import CalibrationError, SequenceError
from tracker.images.plate import Plate
from tracker.images.reading._pictures import check_size, downscaled, read_painted
from tracker.images.reading._selection import view_paths
from tracker.images.reading._streaming import OpenViews


@dataclass(frozen=True)
class MaskFiles:
    """Masks of a recording, read when their frames are."""

    files: tuple[dict[int, Path], ...]
    """For each view: number in the file name -> file."""

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    """Widths and heights of the images as on disk, px."""

    first: int
    """Number in a view's file names that belongs to its image at position 0."""

    downscale: float

    def read(self, view: int, position: int) -> Mask | None:
        """The mask (h, w) of a view's image as delivered; None where there is none.

        Raises:
            SequenceError: the file cannot be read.
            CalibrationError: it has another size than the images.
        """
        path = self.files[view].get(position + self.first)
        if path is None:
            return None
        covered = read_painted(path)
        if covered is None:
            raise SequenceError(f"{path}: not an image that can be read: the file is corrupt or truncated")
        size = covered.shape[1], covered.shape[0]
        if size != self.sizes[view]:
            raise CalibrationError(
                f'{path}: the mask has {size[0]}x{size[1]} px, the images of view "{self.names[view]}" have '
                f"{self.sizes[view][0]}x{self.sizes[view][1]} px"
            )
        mask: Mask = frozen(_smaller(covered, self.downscale), np.bool_)
        return mask


def _smaller(mask: Mask, factor: float) -> Mask:
    """What covers half of so many pixels in both directions, or more; of enlarged images, every pixel twice."""
    if factor == 1:
        return mask
    if factor < 1:
        times = round(1 / factor)
        return mask.repeat(times, axis=0).repeat(times, axis=1)
    factor = int(factor)
    height, width = (length // factor for length in mask.shape)
    whole = mask[: height * factor, : width * factor].reshape(height, factor, width, factor)
    most: Mask = whole.mean(axis=(1, 3)) >= 0.5
    return most


def checked_masks(masks: MaskFiles, views: OpenViews) -> MaskFiles:
    """The masks, if there is one for each image that is read, or some may be missing.

    Raises:
        SequenceError: names the first one that is missing, or the last of those that count what a video has dropped.
    """
    frames = {index: views.positions(index) for index in views.selection.indices}
    for v, name in enumerate(masks.names):
        numbers = {index: places[v] + masks.first for index, places in frames.items() if places[v] >= 0}
        lacking = [index for index, number in numbers.items() if number not in masks.files[v]]
        if lacking and views.on_missing == "error":
            raise SequenceError(
                f'masks of view "{name}": none numbered {numbers[lacking[0]]} for frame {lacking[0]}, '
                f"{len(lacking)} of {len(views.selection.indices)} frames have none; add them, choose others with "
                'start and stop, or set on_missing = "skip" to go on without'
            )
        uneven = views.uneven[v] if views.uneven else None
        if uneven is not None and masks.files[v] and max(masks.files[v]) > max(uneven) + 1:
            raise SequenceError(
                f'masks of view "{name}": numbered up to {max(masks.files[v])}, the video holds {max(uneven) + 1} '
                "images, for some were dropped: number the masks as the images in it, from 0 on"
            )
    return masks


def mask_paths(pattern: str, names: tuple[str, ...]) -> tuple[Path, ...]:
    """The pattern of every view, with `{frame}` in the file name.

    Raises:
        SequenceError: a placeholder is missing.
    """
    paths = view_paths(pattern, names)
    if paths[0].name.count("{frame}") != 1:
        raise SequenceError(
            f'masks = "{pattern}": no {{frame}} in the file name, expected e.g. masks/{{view}}/{{frame}}.png'
        )
    return paths


# What stands before the persons in a view, painted by the user: a table, a treadmill, a clock in the picture.


def load_occluders(rig: Rig, pattern: str, factor: float) -> tuple[Mask | None, ...]:
    """Where (h, w) each view shows what stands before the persons; None for a view without a picture of it.

    Args:
        rig: names the views, and has the image sizes as recorded.
        pattern: path with `{view}` to pictures; what is not black stands before the persons.
        factor: pixels, in both directions, that one of an image as delivered averages.

    Raises:
        SequenceError: there is no such picture for any view, one cannot be read, or covers all of its view.
        CalibrationError: one has not the calibrated size.
    """
    paths = view_paths(pattern, rig.names)
    if not any(path.exists() for path in paths):
        raise SequenceError(f"occluders: no file {paths[0]}, nor of another view; expected one for each that has some")
    found: list[Mask | None] = []
    for camera, path in zip(rig.cameras, paths, strict=True):
        painted = read_painted(path) if path.exists() else None
        if painted is None and path.exists():
            raise SequenceError(f'occluders of view "{camera.name}": {path} is not an image that can be read')
        found.append(None if painted is None else _mask(camera, painted, path, factor))
    return tuple(found)


def with_occluders(plates: Sequence[Plate | None], occluders: Sequence[Mask | None]) -> tuple[Plate | None, ...]:
    """The plates, which know what stands before the persons."""
    pairs = zip(plates, occluders, strict=True)
    return tuple(plate if plate is None or mask is None else replace(plate, occluder=mask) for plate, mask in pairs)


def _mask(camera: Camera, painted: Mask, path: Path, factor: float) -> Mask:
    white = np.where(painted[..., None], np.uint8(255), np.uint8(0))
    check_size(camera.name, white, camera.size, f"the picture of occluders {path}")
    # a pixel of which a part is covered shows the person only partly
    mask: Mask = downscaled(np.repeat(white, 3, axis=2), factor)[..., 0] > 0
    if mask.all():
        raise SequenceError(
            f'occluders of view "{camera.name}": all of the picture is painted; leave the view out with `views`'
        )
    return mask
