"""How like a person a piece of the visual hull is: standing, crouching, seated or lying."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.bodies.scene import Person
from tracker.foundation.arrays import Array
from tracker.tracking.initialization._torso_axis import hull_axis
from tracker.tracking.initialization._visual_hull import STEP_M, Hull

# A person standing or crouching, against legs alone, chairs and shadows on the floor.
_LEAST_HEIGHT, _MOST_HEIGHT, _LEAST_VOLUME_M3, _VOLUME_M3 = 0.5, 1.6, 0.012, 0.08
# Who lies is as long as stands on hands and knees, at least, and at most a person with the arms beyond the head; as
# thick as a chest, for a shadow on the floor is as long; and has a body's volume, holes in the masks granted.
_LEAST_LENGTH, _MOST_LENGTH, _LEAST_THICKNESS, _LEAST_BODY = 0.55, 1.4, 0.11, 0.6
# Heights of a standing person, arms hanging or raised, in statures.
_STANDING = 0.9, 1.3
# Least height of a body that the file tells no stature of, in its extents: a bird with its wings spread is flat in its
# reference pose, and in no other one.
_FLAT = 0.3


class Size(NamedTuple):
    """How large a body is."""

    stature_m: float
    """Height in the reference pose, metres; of a flat body that tells no stature more."""

    length_m: float
    """Its largest extent there: an animal is longer than high, metres."""

    volume_m3: float
    """Cubic metres."""


def size_of(person: Person) -> Size:
    """The size of a person's body."""
    extents = person.body.extents_m
    stature_m = person.body.stature_m or max(float(extents[2]), _FLAT * float(extents.max()))
    volume_m3 = 4 / 3 * np.pi * float(np.prod(person.body.shapes[:, :3], axis=1).sum())
    return Size(stature_m, max(stature_m, float(extents.max())), volume_m3)


def smallest(sizes: list[Size]) -> Size:
    """The least of each extent of several bodies."""
    return Size(*(min(values) for values in zip(*sizes, strict=True)))


def tall(points: Array, stature_m: float) -> bool:
    """Whether voxels (N, 3) are as high as somebody who stands or crouches, metres."""
    return _LEAST_HEIGHT * stature_m < float(np.ptp(points[:, 2])) + STEP_M < _MOST_HEIGHT * stature_m


def standing(points: Array, stature_m: float) -> bool:
    """Whether voxels (N, 3) are as high as somebody who stands, metres."""
    return _height(points) > _STANDING[0] * stature_m


def like_a_person(piece: Hull, size: Size) -> bool:
    """Whether a piece can be a person of that size or a larger one: high enough, or long enough."""
    volume = len(piece.points) * STEP_M**3
    if tall(piece.points, size.stature_m):
        return volume > _LEAST_VOLUME_M3
    thick = _LEAST_THICKNESS * size.stature_m < _height(piece.points) < _LEAST_HEIGHT * size.stature_m
    long = _LEAST_LENGTH * size.length_m < _length(piece.points) < _MOST_LENGTH * size.length_m
    return thick and long and volume > _LEAST_BODY * size.volume_m3


def misfit(pieces: list[Hull], statures: list[float]) -> float:
    """How unlike persons of so many statures the pieces are.

    The share of the stature by which they are too low, or too high even for raised arms, of those that lie too short or
    too long; how far their axes lean; the share of the views that do not look at them, or see nothing there; less for a
    body's volume.
    """
    ordered = sorted(pieces, key=lambda piece: _height(piece.points), reverse=True)
    total = 0.0
    for piece, stature in zip(ordered, statures, strict=True):
        extent = _height(piece.points) if tall(piece.points, stature) else _length(piece.points)
        share = extent / stature
        total += max(_STANDING[0] - share, 0.0) + max(share - _STANDING[1], 0.0)
        total += 0.25 * (1 - float(hull_axis(piece.points).direction[2]))
        total += 0.5 * (1 - float(piece.seen.mean())) + 0.08 * float(piece.lacking.mean())
        total -= 0.3 * min(len(piece.points) * STEP_M**3 / _VOLUME_M3, 1.0)
    return total


def _height(points: Array) -> float:
    return _extent(points[:, 2])


def _length(points: Array) -> float:
    """Extent along the major axis, metres."""
    _, vectors = np.linalg.eigh(np.cov(points.T))
    return _extent(points @ vectors[:, 2])


def _extent(along: Array) -> float:
    low, high = np.percentile(along, [0.5, 99.5])
    return float(high - low) + STEP_M
