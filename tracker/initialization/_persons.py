"""K persons in the foreground of several views: who is where, and which pixels are whose (paper, section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.arrays import Array, Mask
from tracker.errors import InitializationError
from tracker.initialization._visual_hull import STEP_M, Hull, connected, shadow, visual_hull
from tracker.rig import Rig
from tracker.scene import Person

# A person standing or crouching, against legs alone, chairs and shadows on the floor.
_LEAST_HEIGHT, _MOST_HEIGHT, _LEAST_VOLUME_M3 = 0.5, 1.6, 0.012
# A view in which so much of a person's region may belong to another one does not show its axis.
_CONTESTED = 0.2
_HELD_M = 0.2
_MARGIN_M = 0.03
_EROSIONS = 4
# A hole in a view's mask is believed where the persons then cover so many times the pixels.
_GAIN = 1.08


@dataclass(frozen=True)
class Found:
    """One person's foreground."""

    points: Array
    """(N, 3) voxels that the person can fill, metres."""

    regions: tuple[Mask | None, ...]
    """(H, W) its pixels in each view; None without a foreground, and where it overlaps with another person."""

    area: int
    """Its pixels in all views, those shared with another person included."""

    @property
    def height_m(self) -> float:
        """Extent upwards, metres."""
        low, high = np.percentile(self.points[:, 2], [0.5, 99.5])
        return float(high - low) + STEP_M

    @property
    def centre(self) -> Array:
        """(3,) middle of the voxels, metres."""
        middle: Array = self.points.mean(axis=0)
        return middle


def find_persons(
    masks: tuple[Mask | None, ...], rig: Rig, persons: tuple[Person, ...], held: tuple[Person, ...]
) -> list[Found]:
    """The regions of K persons that do not overlap in space; in an image they may.

    What is foreground in a single view, such as a moved chair, is foreground nowhere in space. A hole in one mask is
    forgiven where no other way shows all persons.

    Args:
        masks: (H, W) foreground of each view, None where there is none.
        rig: the cameras.
        persons: the K persons sought; their poses do not matter.
        held: persons whose poses are known: their places are taken.

    Returns:
        K persons, the largest first.

    Raises:
        InitializationError: fewer than K.
    """
    least = min(_upright_height(person) for person in persons)
    most = 1 if sum(mask is not None for mask in masks) > 2 else 0
    hull = visual_hull(rig, masks, most)
    hull = hull.part(~_taken(hull.points, held))
    found: list[Found] = []
    n_pieces = covered = 0
    for lacking in range(most + 1):
        pieces = _pieces(hull.part(hull.lacking <= lacking), len(persons), least, len(persons) + len(held) > 1)
        n_pieces = max(n_pieces, len(pieces))
        if len(pieces) < len(persons):
            continue
        trial = _with_regions(pieces[: len(persons)], masks, rig)
        area = sum(person.area for person in trial)
        if not found or area > _GAIN * covered:
            found, covered = trial, area
    if found:
        return found
    raise InitializationError(
        f"the foreground of all views shows {n_pieces} upright person(s), expected {len(persons)}: check the "
        "background plates; persons must stand apart at the start; start at another frame or give the poses"
    )


def _pieces(hull: Hull, n_persons: int, least_m: float, several: bool) -> list[Hull]:
    """Pieces of a hull that can be persons; where they are too few, what touches is parted."""
    pieces: list[Hull] = []
    for erosions in range(_EROSIONS + 1 if several else 1):
        pieces = [piece for piece in connected(hull, erosions) if _like_a_person(piece, least_m)]
        if len(pieces) >= n_persons:
            break
    return pieces


def in_order(found: list[Found], persons: tuple[Person, ...], seen_before: bool) -> list[Found]:
    """Which of the found is which person: by height, and by where a lost person was seen last."""
    costs = np.empty((len(persons), len(found)))
    for k, person in enumerate(persons):
        marks = person.body.landmarks_in_world(person.q).mean(axis=0)
        for n, other in enumerate(found):
            costs[k, n] = abs(other.height_m - _upright_height(person))
            costs[k, n] += float(np.linalg.norm(other.centre - marks)) if seen_before else 0.0
    return [found[n] for n in linear_sum_assignment(costs)[1]]


def _upright_height(person: Person) -> float:
    marks = person.body.landmarks_in_world(person.body.rest())
    return person.body.stature_m or float(np.ptp(marks[:, 2]))


def _taken(points: Array, held: tuple[Person, ...]) -> Mask:
    """Which points (N, 3) belong to persons whose poses are known: those near their bones."""
    taken = np.zeros(len(points), dtype=np.bool_)
    for person in held:
        marks = person.body.landmarks_in_world(person.q)
        names = person.body.landmark_names
        for one, other in person.body.links:
            start, end = marks[names.index(one)], marks[names.index(other)]
            along = np.clip((points - start) @ (end - start) / max(float((end - start) @ (end - start)), 1e-9), 0, 1)
            taken |= np.linalg.norm(points - start - along[:, None] * (end - start), axis=1) < _HELD_M
    return taken


def _like_a_person(piece: Hull, stature_m: float) -> bool:
    height, volume = float(np.ptp(piece.points[:, 2])) + STEP_M, len(piece.points) * STEP_M**3
    return _LEAST_HEIGHT * stature_m < height < _MOST_HEIGHT * stature_m and volume > _LEAST_VOLUME_M3


def _with_regions(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig) -> list[Found]:
    regions: list[list[Mask | None]] = [[None] * len(masks) for _ in pieces]
    contested = np.ones((len(pieces), len(masks)))
    for v, mask in enumerate(masks):
        if mask is None:
            continue
        mine = [mask & shadow(rig, v, piece.points, _MARGIN_M) for piece in pieces]
        times = np.sum(mine, axis=0)
        for k, region in enumerate(mine):
            regions[k][v] = region
            contested[k, v] = (region & (times > 1)).sum() / max(int(region.sum()), 1)
    found = []
    for k, piece in enumerate(pieces):
        limit = max(_CONTESTED, float(np.sort(contested[k])[1]))
        chosen = (region if share <= limit else None for region, share in zip(regions[k], contested[k], strict=True))
        area = sum(int(region.sum()) for region in regions[k] if region is not None)
        found.append(Found(piece.points, tuple(chosen), area))
    return found
