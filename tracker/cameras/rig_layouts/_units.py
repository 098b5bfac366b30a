"""The unit of length of a file: metres for the cameras, and a word where another unit makes a room of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.errors import CalibrationError, nearest
from tracker.foundation.lengths import METRES_PER_UNIT, unit_sign

_GUESSED = {"m": "metres", "cm": "centimetres", "mm": "millimetres"}
"""Units that a file without a word for them may be in."""

FARTHEST_M, _FAR_M = 200.0, 30.0
"""A room is metres across: cameras hundreds of metres from one another are not believed, tens of metres are told."""

_NEAR_M = 0.02
"""Cameras all within that are not believed either, if another unit makes a room of them: lenses are as wide."""

_ROOM_M = 0.5, 60.0
"""Distance of the two cameras of a room that are farthest from one another."""

_USUAL_M = 4.0
"""Of several units that make a room, the one is named first that comes nearest to this."""


def unit_of(word: object) -> str:
    """The sign of the unit that a word tells, such as `mm` or `millimeters`.

    Raises:
        CalibrationError: it is none.
    """
    unit = unit_sign(word) if isinstance(word, str) else None
    if unit is None:
        raise CalibrationError(f'units = "{word}": {nearest(str(word), METRES_PER_UNIT)}')
    return unit


def in_metres(cameras: Sequence[Camera], unit: str, scale: float = 1.0) -> tuple[Camera, ...]:
    """The cameras with their places in metres.

    Args:
        cameras: their places in a unit.
        unit: sign of it, see `tracker.foundation.lengths`.
        scale: by which lengths are multiplied besides.

    Raises:
        CalibrationError: the scale is no factor of lengths.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise CalibrationError(f"scale = {scale:g}: expected a factor above 0, by which lengths are multiplied")
    factor = scale * METRES_PER_UNIT[unit]
    moved = []
    for camera in cameras:
        motion = np.array(camera.camera_from_world)
        motion[:3, 3] *= factor
        moved.append(replace(camera, camera_from_world=motion))
    return tuple(moved)


def unit_remarks(cameras: Sequence[Camera], unit: str, path: Path, told: bool) -> tuple[str, ...]:
    """What to know where cameras stand tens of metres from one another.

    Args:
        cameras: with places in metres.
        unit: that the file was read in.
        path: of the file.
        told: whether the user told the unit or the scale: who tells that cameras stand within millimetres is believed.

    Raises:
        CalibrationError: they stand hundreds of metres from one another, or all within millimetres although another
            unit makes a room of them.
    """
    centres = np.stack([camera.centre for camera in cameras])
    farthest = max(float(np.linalg.norm(centres - centre, axis=1).max()) for centre in centres)
    if (told or farthest >= _NEAR_M) and farthest <= _FAR_M:
        return ()
    metres = METRES_PER_UNIT
    others = {other: farthest * metres[other] / metres[unit] for other in _GUESSED if other != unit}
    rooms = {other: wide for other, wide in others.items() if _ROOM_M[0] <= wide <= _ROOM_M[1]}
    units = sorted(rooms, key=lambda other: abs(math.log(rooms[other] / _USUAL_M)))
    apart = f"{farthest:.0f} m" if farthest > 1 else f"{1000 * farthest:.1f} mm"
    line = f"two cameras are {apart} apart, expected a room: "
    if units:
        line += (
            f"in {' or in '.join(f'{_GUESSED[other]} they are {rooms[other]:.2g} m apart' for other in units)}: if the "
            f"file is in {_GUESSED[units[0]]}, `bodytrack rig convert {path} rig.toml --units {units[0]}` reads it so"
        )
    else:
        line += f"if its lengths have another unit, `bodytrack rig convert {path} rig.toml --scale METRES` tells it"
    if farthest > FARTHEST_M or (units and farthest < _NEAR_M):
        raise CalibrationError(line)
    return (line,) if units else ()


def up_remarks(cameras: Sequence[Camera]) -> tuple[str, ...]:
    """What to know where the world of a file has another axis up than z."""
    up = Rig(tuple(cameras)).likely_up if cameras else "z"
    if up == "z":
        return ()
    return (
        f"z is not up in this file, {up} seems to be: `bodytrack rig convert THIS rig.toml --up {up}` turns it, and "
        "--floor METRES tells where the floor lies along that axis",
    )
