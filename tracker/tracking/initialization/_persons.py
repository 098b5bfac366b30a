"""K persons in the foreground of several views: assigns persons and pixels (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.bodies.scene import Person
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import InitializationError
from tracker.tracking.initialization._foregrounds import cleaned
from tracker.tracking.initialization._visual_hull import (
    STEP_M,
    Hull,
    connected,
    hull_axis,
    region_axes,
    shadow,
    torso_axis,
    visual_hull,
    within_all,
)

# A person standing or crouching, against legs alone, chairs and shadows on the floor.
_LEAST_HEIGHT, _MOST_HEIGHT, _LEAST_VOLUME_M3, _VOLUME_M3 = 0.5, 1.6, 0.012, 0.08
# A lying person is at least as long as one on hands and knees, and at most as one with the arms beyond the head; as
# thick as a chest, because a shadow on the floor is as long; and has a body's volume, except for holes in the masks.
_LEAST_LENGTH, _MOST_LENGTH, _LEAST_THICKNESS, _LEAST_BODY = 0.55, 1.4, 0.11, 0.6
# Heights of a standing person, arms hanging or raised, in statures.
_STANDING = 0.9, 1.3
# Least height of a body without a stature in its file, in its extents: a bird with its wings spread is flat only in its
# reference pose.
_FLAT = 0.3


class Size(NamedTuple):
    """Size of a body."""

    stature_m: float
    """Height in the reference pose, metres; larger for a flat body without a stature."""

    length_m: float
    """Its largest extent there, metres: an animal is longer than high."""

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
    """Whether voxels (N, 3) are as high as a person who stands or crouches, metres."""
    return _LEAST_HEIGHT * stature_m < float(np.ptp(points[:, 2])) + STEP_M < _MOST_HEIGHT * stature_m


def standing(points: Array, stature_m: float) -> bool:
    """Whether voxels (N, 3) are as high as a standing person, metres."""
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
    """Difference of the pieces from persons of these statures.

    The terms: share of the stature by which they are too low, or too high even for raised arms; for lying ones too
    short or too long; tilt of their axes; share of the views that see nothing there, or do not look; less for a body's
    volume.
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


MARGIN_M = 0.03
"""Margin around the voxels of a piece for its pixels, metres."""

MOST_ALIKE = 3
"""Largest number of pieces that may be one person."""

# If only two views look, the hull also has ghosts, whose foreground belongs to others except for 3 to 10 %.
_OWN = 0.25
# Around the bones of known persons, metres, and how many points of each bone stand for it.
_HELD_M, _ALONG = 0.2, 12
# How far a body reaches from a vertical line through it, in statures, and voxels too few for it or its middle.
_REACH, _FEW = 0.6, 50
# Extent of a body that lies in its reference pose, in lengths from its middle to its farthest landmark.
_LYING_REACH = 1.2
# Share of the likeliest piece's volume from which on another one may be the person as well.
_ALIKE = 0.5
# Limits for separating persons in one piece: height in statures, width both ways, and distance of their middles. The
# legs and the trunk of one person are lower; shadows and ghosts around him are a shell 1 to 1.6 statures wide; pieces
# to the left and right in his hull are nearer.
_UPRIGHT, _WIDE, _BESIDE_M = 0.75, 0.8, 0.4


def person_pieces(hull: Hull, erosions: int, sizes: list[Size], reach_m: float) -> list[Hull]:
    """Pieces of a hull that can be persons, the likeliest first."""
    pieces, statures = [], [size.stature_m for size in sizes]
    for whole in connected(hull, erosions):
        if len(whole.points) > _FEW:
            piece = _within_reach(whole, reach_m)
            if _hollow(piece):
                continue
            if not tall(piece.points, min(statures)):
                piece = whole  # a lying body has no upright axis, and its length counts
            if like_a_person(piece, smallest(sizes)):
                pieces.append(piece)
    return sorted(pieces, key=lambda piece: misfit([piece], [float(np.mean(statures))]))


def _hollow(piece: Hull) -> bool:
    """Whether the middle is empty, as in the rest of a hull around a known person."""
    if not len(piece.points):
        return True
    lateral = np.linalg.norm(piece.points[:, :2] - np.median(piece.points[:, :2], axis=0), axis=1)
    return int((lateral < _HELD_M).sum()) <= _FEW


def _within_reach(piece: Hull, reach_m: float) -> Hull:
    """Without voxels farther from the upright axis than a hand can be."""
    lateral = piece.points[:, :2] - np.median(piece.points[:, :2], axis=0)
    return piece.part(np.linalg.norm(lateral, axis=1) < reach_m)


def reach(person: Person) -> float:
    """Reach of a body from a vertical line through its middle: hands of a person, head and tail of an animal."""
    marks = person.body.landmarks_in_world(person.body.rest())[:, :2]
    length = float(np.linalg.norm(marks - np.median(marks, axis=0), axis=1).max(initial=0.0))
    return max(_REACH * size_of(person).stature_m, _LYING_REACH * length)


def taken(held: tuple[Person, ...], rig: Rig) -> tuple[Mask, ...]:
    """The pixels (H, W) of each view around the bones of persons with known poses."""
    bones = [np.zeros((0, 3))]
    for person in held:
        marks = person.body.landmarks_in_world(person.q)
        names = person.body.landmark_names
        for one, other in person.body.links:
            start, end = marks[names.index(one)], marks[names.index(other)]
            bones.append(start + np.linspace(0, 1, _ALONG)[:, None] * (end - start))
    points = np.concatenate(bones)
    return tuple(shadow(rig, v, points, _HELD_M) for v in range(len(rig)))


def showing(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig, theirs: tuple[Mask, ...]) -> list[Hull]:
    """The pieces with a fair share of foreground of their own, neither of pieces before them nor around others (H, W).

    Without this rule, hands and shadow of a dancing man were searched in every third frame for a woman who had left the
    room.
    """
    views = [(v, mask) for v, mask in enumerate(masks) if mask is not None]
    unexplained = {v: mask & ~theirs[v] for v, mask in views}
    kept = []
    for piece in pieces:
        regions = {v: mask & shadow(rig, v, piece.points, MARGIN_M) for v, mask in views}
        own = sum(int((unexplained[v] & region).sum()) for v, region in regions.items())
        if own > _OWN * sum(int(region.sum()) for region in regions.values()):
            kept.append(piece)
            for v, region in regions.items():
                unexplained[v] &= ~region
    return kept


def covered(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig) -> float:
    """Share of the foreground of all views that the pieces explain."""
    inside = total = 0
    for v, mask in enumerate(masks):
        if mask is not None:
            points = np.concatenate([piece.points for piece in pieces])
            inside += int((mask & shadow(rig, v, points, MARGIN_M)).sum())
            total += int(mask.sum())
    return inside / max(total, 1)


def alike(pieces: list[Hull]) -> list[Hull]:
    """Pieces that may be the person as well as the first one, up to a limit."""
    least = _ALIKE * max((len(piece.points) for piece in pieces[:MOST_ALIKE]), default=0)
    return [piece for piece in pieces[:MOST_ALIKE] if len(piece.points) >= least]


def where_told(pieces: list[Hull], persons: tuple[Person, ...]) -> list[Hull]:
    """The pieces, those nearest to the persons' given places first, in the persons' order."""
    left, first = list(pieces), []
    for person in persons:
        if person.at is not None and left:
            gaps = [float(np.linalg.norm(place(piece.points) - person.at)) for piece in left]
            first.append(left.pop(int(np.argmin(gaps))))
    return first + left


def place(points: Array) -> Array:
    """(2,) where voxels (N, 3) are on the floor, metres."""
    middle: Array = np.median(points[:, :2], axis=0)
    return middle


def standing_apart(pieces: list[Hull], stature_m: float) -> list[Hull]:
    """Pieces as high and wide as standing persons, and apart from those before."""
    kept: list[Hull] = []
    for piece in pieces:
        gaps = [np.linalg.norm(place(piece.points) - place(other.points)) for other in kept]
        extents = np.ptp(piece.points, axis=0) / stature_m
        like_one = extents[2] > _UPRIGHT and extents[:2].min() < _WIDE
        if like_one and min(gaps, default=np.inf) > _BESIDE_M:
            kept.append(piece)
    return kept


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
    """(H, W) its pixels in each view; None without a foreground, and if it overlaps with another person."""

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

    Foreground in a single view, such as a moved chair, is foreground nowhere in space. A hole in one mask is tolerated
    if nothing else shows all persons. If one person is sought and more are there, each may be that one.

    Args:
        masks: (H, W) foreground of each view, None where there is none.
        rig: the cameras.
        persons: the K persons sought; their poses do not matter.
        held: persons with known poses: their places are taken.

    Yields:
        K persons, the largest first; for one person each candidate, the likeliest first.

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
    """Each of some pieces as the person, without the others."""
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
    """Assigns the pieces to persons: by a given place, by stature, by the last place of a lost one."""
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
