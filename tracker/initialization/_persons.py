"""K persons in the foreground of several views: who is where, and which pixels are whose (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.arrays import Array, Mask
from tracker.errors import InitializationError
from tracker.initialization._likeness import Size, like_a_person, misfit, size_of, smallest, tall
from tracker.initialization._torso_axis import hull_axis, region_axes, torso_axis
from tracker.initialization._visual_hull import Hull, connected, shadow, visual_hull, within_all
from tracker.rig import Rig
from tracker.scene import Person

# Where only two views look, the hull also has ghosts, whose foreground is that of others but for 3 to 10 %.
_OWN = 0.25
# A view in which so much of a person's region may belong to another one does not show its axis.
_CONTESTED = 0.2
# Around the bones of known persons, metres, and how many points of each bone stand for it.
_HELD_M, _ALONG = 0.2, 12
_REACH, _FEW = 0.6, 50
# Of a body that lies in its reference pose, in lengths from its middle to its farthest landmark.
_LYING_REACH = 1.2
_MARGIN_M = 0.03
_EROSIONS = 4
# Share of the likeliest piece's volume from which on another one may be the person as well, and how many may.
_ALIKE, _MOST_ALIKE = 0.5, 3
# Height, in statures, of those who are told apart where they are one piece, how wide they are both ways at most,
# and how far apart their middles are: the legs and the trunk of one person are lower, what lies around him, shadows and
# ghosts, is a shell 1 to 1.6 statures wide, what stands to the left and right in his hull is nearer.
_UPRIGHT, _WIDE, _BESIDE_M = 0.75, 0.8, 0.4
# Gaps of this share of the image's longer side are closed.
_GAP = 0.006


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
    reach_m = max(_reach(person) for person in persons)
    most = 1 if sum(mask is not None for mask in masks) > 2 else 0
    masks = tuple(None if mask is None else cleaned(mask) for mask in masks)
    hull = visual_hull(rig, masks, most)
    theirs = _taken(held, rig)
    hull = hull.part(~within_all(rig, theirs, hull.points))

    def parted(most_lacking: int, erosions: int) -> list[Hull]:
        pieces = _pieces(hull.part(hull.lacking <= most_lacking), erosions, sizes, reach_m)
        return _showing(pieces, masks, rig, theirs)

    erosions = range(_EROSIONS + 1 if len(persons) + len(held) > 1 else 1)
    trials = [parted(n, m) for n in range(most + 1) for m in erosions]
    enough = [pieces for pieces in trials if len(pieces) >= len(persons)]
    if enough:

        def cost(pieces: list[Hull]) -> float:
            return misfit(pieces[: len(persons)], statures) - 0.5 * _covered(pieces[: len(persons)], masks, rig)

        best = _where_told(min(enough, key=cost), persons)
        if len(persons) > 1:
            yield _with_regions(best[: len(persons)], masks, rig)
            return
        told = persons[0].at is not None
        alike = best[:_MOST_ALIKE] if told else _alike(best)
        whole = _each(alike, masks, rig)
        if not told:
            yield from whole
        # somebody close by is one piece with the person
        erosions = range(1, _EROSIONS + 1 if len(alike) == 1 and not held else 1)
        apart = (_alike(_side_by_side(parted(0, m), min(statures))) for m in erosions)
        parts = _where_told(next((pieces for pieces in apart if len(pieces) > 1), []), persons)
        ways = _each(parts, masks, rig)
        yield from (ways or whole)[:1] if told else ways
        return
    n_pieces = max(len(pieces) for pieces in trials)
    raise InitializationError(
        f"the foreground of all views shows {n_pieces} person(s), expected {len(persons)}: check the "
        "background plates; persons must be apart at the start; start at another frame or give the poses"
    )


def _pieces(hull: Hull, erosions: int, sizes: list[Size], reach_m: float) -> list[Hull]:
    """Pieces of a hull that can be persons, the likeliest first."""
    pieces, statures = [], [size.stature_m for size in sizes]
    for whole in connected(hull, erosions):
        if len(whole.points) > _FEW:
            piece = _within_reach(whole, reach_m)
            if _hollow(piece):
                continue
            if not tall(piece.points, min(statures)):
                piece = whole  # what lies has no upright axis, and a length that counts
            if like_a_person(piece, smallest(sizes)):
                pieces.append(piece)
    return sorted(pieces, key=lambda piece: misfit([piece], [float(np.mean(statures))]))


def _hollow(piece: Hull) -> bool:
    """Whether nothing is in the middle, as in what is left of a hull around a known person."""
    if not len(piece.points):
        return True
    lateral = np.linalg.norm(piece.points[:, :2] - np.median(piece.points[:, :2], axis=0), axis=1)
    return int((lateral < _HELD_M).sum()) <= _FEW


def _showing(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig, theirs: tuple[Mask, ...]) -> list[Hull]:
    """The pieces of whose foreground a fair share is not that of those before them, nor around others (H, W).

    Of a woman who had left the room, hands and shadow of the man who danced there were searched in every third frame.
    """
    views = [(v, mask) for v, mask in enumerate(masks) if mask is not None]
    unexplained = {v: mask & ~theirs[v] for v, mask in views}
    kept = []
    for piece in pieces:
        regions = {v: mask & shadow(rig, v, piece.points, _MARGIN_M) for v, mask in views}
        own = sum(int((unexplained[v] & region).sum()) for v, region in regions.items())
        if own > _OWN * sum(int(region.sum()) for region in regions.values()):
            kept.append(piece)
            for v, region in regions.items():
                unexplained[v] &= ~region
    return kept


def _alike(pieces: list[Hull]) -> list[Hull]:
    """Those of pieces that may be the person as well as the first one, some at most."""
    least = _ALIKE * max((len(piece.points) for piece in pieces[:_MOST_ALIKE]), default=0)
    return [piece for piece in pieces[:_MOST_ALIKE] if len(piece.points) >= least]


def _where_told(pieces: list[Hull], persons: tuple[Person, ...]) -> list[Hull]:
    """The pieces, those nearest to where persons are told to be first, in the persons' order."""
    left, first = list(pieces), []
    for person in persons:
        if person.at is not None and left:
            gaps = [float(np.linalg.norm(_place(piece.points) - person.at)) for piece in left]
            first.append(left.pop(int(np.argmin(gaps))))
    return first + left


def _place(points: Array) -> Array:
    """(2,) where voxels (N, 3) are on the floor, metres."""
    place: Array = np.median(points[:, :2], axis=0)
    return place


def _side_by_side(pieces: list[Hull], stature_m: float) -> list[Hull]:
    """Those of pieces that are as high and wide as persons who stand, and apart from those before."""
    kept: list[Hull] = []
    for piece in pieces:
        gaps = [np.linalg.norm(_place(piece.points) - _place(other.points)) for other in kept]
        extents = np.ptp(piece.points, axis=0) / stature_m
        like_one = extents[2] > _UPRIGHT and extents[:2].min() < _WIDE
        if like_one and min(gaps, default=np.inf) > _BESIDE_M:
            kept.append(piece)
    return kept


def _each(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig) -> list[list[Found]]:
    """Each of some pieces as the person, who is not the others."""
    found = []
    for n, piece in enumerate(pieces):
        others = np.concatenate([np.zeros((0, 3)), *(other.points for k, other in enumerate(pieces) if k != n)])
        found.append([replace(one, others=others) for one in _with_regions([piece], masks, rig)])
    return found


def _within_reach(piece: Hull, reach_m: float) -> Hull:
    """Without what is farther from the upright axis than a hand can be."""
    lateral = piece.points[:, :2] - np.median(piece.points[:, :2], axis=0)
    return piece.part(np.linalg.norm(lateral, axis=1) < reach_m)


def _covered(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig) -> float:
    """Share of the foreground of all views that the pieces explain."""
    inside = total = 0
    for v, mask in enumerate(masks):
        if mask is not None:
            points = np.concatenate([piece.points for piece in pieces])
            inside += int((mask & shadow(rig, v, points, _MARGIN_M)).sum())
            total += int(mask.sum())
    return inside / max(total, 1)


def in_order(found: list[Found], persons: tuple[Person, ...], rig: Rig, seen_before: bool) -> list[Found]:
    """Which of the found is which person: by where it is told to be, who is taller, where a lost one was seen last."""
    heads = np.array([_head_top(other, rig) for other in found])
    statures = np.array([size_of(person).stature_m for person in persons])
    costs = np.abs((heads - heads.mean())[None] - (statures - statures.mean())[:, None])
    if not seen_before:
        places = np.array([_place(other.points) for other in found])
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
        return float(torso_axis(rig, found.regions, region_axes(found.regions, 1)).head_top[2])
    except InitializationError:
        return float(hull_axis(found.points).head_top[2])


def cleaned(mask: Mask) -> Mask:
    """A mask (H, W) without specks, and without gaps narrower than a hand."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    radius = max(2, round(max(mask.shape) * _GAP))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    closed: Mask = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, disc) > 0
    return closed


def _reach(person: Person) -> float:
    """How far from a vertical line through its middle a body can be: hands of a person, head and tail of an animal."""
    marks = person.body.landmarks_in_world(person.body.rest())[:, :2]
    length = float(np.linalg.norm(marks - np.median(marks, axis=0), axis=1).max(initial=0.0))
    return max(_REACH * size_of(person).stature_m, _LYING_REACH * length)


def _taken(held: tuple[Person, ...], rig: Rig) -> tuple[Mask, ...]:
    """The pixels (H, W) of each view around the bones of persons whose poses are known."""
    bones = [np.zeros((0, 3))]
    for person in held:
        marks = person.body.landmarks_in_world(person.q)
        names = person.body.landmark_names
        for one, other in person.body.links:
            start, end = marks[names.index(one)], marks[names.index(other)]
            bones.append(start + np.linspace(0, 1, _ALONG)[:, None] * (end - start))
    points = np.concatenate(bones)
    return tuple(shadow(rig, v, points, _HELD_M) for v in range(len(rig)))


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
        found.append(Found(piece.points, tuple(chosen)))
    return found
