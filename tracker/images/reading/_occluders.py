"""What stands before the persons in a view, painted by the user: a table, a treadmill, a clock in the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Mask
from tracker.foundation.errors import SequenceError
from tracker.images.plate import Plate
from tracker.images.reading._pictures import check_size, downscaled, read_painted
from tracker.images.reading._selection import view_paths


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
