"""K persons in the foreground of several views: who is where, and which pixels are whose (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.bodies.scene import Person
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import InitializationError
from tracker.tracking.initialization._foregrounds import cleaned
from tracker.tracking.initialization._likeness import misfit, size_of
from tracker.tracking.initialization._person_pieces import (
    MARGIN_M,
    MOST_ALIKE,
    alike,
    covered,
    person_pieces,
    place,
    reach,
    showing,
    standing_apart,
    taken,
    where_told,
)
from tracker.tracking.initialization._torso_axis import hull_axis, region_axes, torso_axis
from tracker.tracking.initialization._visual_hull import Hull, shadow, visual_hull, within_all

# A view in which so much of a person's region may belong to another one does not show its axis.
_CONTESTED = 0.2
# Layers taken off a hull, at most, to part persons who touch.
_EROSIONS = 4


@dataclass(frozen=True)
class Found:
    """One person's foreground."""

    points: Array
    """(N, 3) voxels that the person can fill, metres."""

    regions: tuple[Mask | None, ...]
    """(H, W) its pixels in each view; None without a foreground, and where it overlaps with another person."""

    others: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(M, 3) voxels of others who may be the person as well, metres."""


def find_persons(
    masks: tuple[Mask | None, ...], rig: Rig, persons: tuple[Person, ...], held: tuple[Person, ...]
) -> list[Found]:
    """The likeliest of `ways_to_find`: K persons, the largest first."""
    return next(ways_to_find(masks, rig, persons, held))


def ways_to_find(
    masks: tuple[Mask | None, ...], rig: Rig, persons: tuple[Person, ...], held: tuple[Person, ...]
) -> Iterator[list[Found]]:
    """The regions of K persons that do not overlap in space; in an image they may.

    What is foreground in a single view, such as a moved chair, is foreground nowhere in space. A hole in one mask is
    forgiven where no other way shows all persons. Where one person is sought and more are there, each may be that one.

    Args:
        masks: (H, W) foreground of each view, None where there is none.
        rig: the cameras.
        persons: the K persons sought; their poses do not matter.
        held: persons whose poses are known: their places are taken.

    Yields:
        K persons, the largest first; of one person each that may be it, the likeliest first.

    Raises:
        InitializationError: fewer than K.
    """
    sizes = [size_of(person) for person in persons]
    statures = sorted((size.stature_m for size in sizes), reverse=True)
    reach_m = max(reach(person) for person in persons)
    most = 1 if sum(mask is not None for mask in masks) > 2 else 0
    masks = tuple(None if mask is None else cleaned(mask) for mask in masks)
    hull = visual_hull(rig, masks, most)
    theirs = taken(held, rig)
    hull = hull.part(~within_all(rig, theirs, hull.points))

    def parted(most_lacking: int, erosions: int) -> list[Hull]:
        pieces = person_pieces(hull.part(hull.lacking <= most_lacking), erosions, sizes, reach_m)
        return showing(pieces, masks, rig, theirs)

    erosions = range(_EROSIONS + 1 if len(persons) + len(held) > 1 else 1)
    trials = [parted(n, m) for n in range(most + 1) for m in erosions]
    enough = [pieces for pieces in trials if len(pieces) >= len(persons)]
    if enough:

        def cost(pieces: list[Hull]) -> float:
            return misfit(pieces[: len(persons)], statures) - 0.5 * covered(pieces[: len(persons)], masks, rig)

        best = where_told(min(enough, key=cost), persons)
        if len(persons) > 1:
            yield _with_regions(best[: len(persons)], masks, rig)
            return
        told = persons[0].at is not None
        candidates = best[:MOST_ALIKE] if told else alike(best)
        whole = _each(candidates, masks, rig)
        if not told:
            yield from whole
        # somebody close by is one piece with the person
        erosions = range(1, _EROSIONS + 1 if len(candidates) == 1 and not held else 1)
        apart = (alike(standing_apart(parted(0, m), min(statures))) for m in erosions)
        parts = where_told(next((pieces for pieces in apart if len(pieces) > 1), []), persons)
        ways = _each(parts, masks, rig)
        yield from (ways or whole)[:1] if told else ways
        return
    n_pieces = max(len(pieces) for pieces in trials)
    raise InitializationError(
        f"the foreground of all views shows {n_pieces} person(s), expected {len(persons)}: check the "
        "background plates; persons must be apart at the start; start at another frame or give the poses"
    )


def _each(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig) -> list[list[Found]]:
    """Each of some pieces as the person, who is not the others."""
    found = []
    for n, piece in enumerate(pieces):
        others = np.concatenate([np.zeros((0, 3)), *(other.points for k, other in enumerate(pieces) if k != n)])
        found.append([replace(one, others=others) for one in _with_regions([piece], masks, rig)])
    return found


def _with_regions(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig) -> list[Found]:
    regions: list[list[Mask | None]] = [[None] * len(masks) for _ in pieces]
    contested = np.ones((len(pieces), len(masks)))
    for v, mask in enumerate(masks):
        if mask is None:
            continue
        mine = [mask & shadow(rig, v, piece.points, MARGIN_M) for piece in pieces]
        times = np.sum(mine, axis=0)
        for k, region in enumerate(mine):
            regions[k][v] = region
            contested[k, v] = (region & (times > 1)).sum() / max(int(region.sum()), 1)
    found = []
    for k, piece in enumerate(pieces):
        limit = max(_CONTESTED, float(np.sort(contested[k])[1]))
        chosen = (region if share <= limit else None for region, share in zip(regions[k], contested[k], strict=True))
        found.append(Found(piece.points, tuple(chosen)))
    return found


def in_order(found: list[Found], persons: tuple[Person, ...], rig: Rig, seen_before: bool) -> list[Found]:
    """Which of the found is which person: by where it is told to be, who is taller, where a lost one was seen last."""
    heads = np.array([_head_top(other, rig) for other in found])
    statures = np.array([size_of(person).stature_m for person in persons])
    costs = np.abs((heads - heads.mean())[None] - (statures - statures.mean())[:, None])
    if not seen_before:
        places = np.array([place(other.points) for other in found])
        for k, person in enumerate(persons):
            if person.at is not None:
                costs[k] = np.linalg.norm(places - person.at, axis=1)
    if seen_before:
        last = np.array([person.body.landmarks_in_world(person.q).mean(axis=0) for person in persons])
        costs += np.linalg.norm(last[:, None] - np.array([other.points.mean(axis=0) for other in found])[None], axis=2)
    return [found[n] for n in linear_sum_assignment(costs)[1]]


def _head_top(found: Found, rig: Rig) -> float:
    """Height of the head above the world's origin, metres."""
    try:
        return float(torso_axis(rig, found.regions, region_axes(found.regions, 0.0)).head_top[2])
    except InitializationError:
        return float(hull_axis(found.points).head_top[2])
