"""Pieces of the visual hull that can be persons: which ones, and where (paper, section 4.1)."""

from __future__ import annotations

import numpy as np

from tracker.bodies.scene import Person
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.tracking.initialization._likeness import Size, like_a_person, misfit, size_of, smallest, tall
from tracker.tracking.initialization._visual_hull import Hull, connected, shadow

MARGIN_M = 0.03
"""Around the voxels of a piece, where its pixels are looked for, metres."""

MOST_ALIKE = 3
"""Pieces that may be one and the same person, at most."""

# Where only two views look, the hull also has ghosts, whose foreground is that of others but for 3 to 10 %.
_OWN = 0.25
# Around the bones of known persons, metres, and how many points of each bone stand for it.
_HELD_M, _ALONG = 0.2, 12
# How far a body reaches from a vertical line through it, in statures, and voxels too few for it or its middle.
_REACH, _FEW = 0.6, 50
# Of a body that lies in its reference pose, in lengths from its middle to its farthest landmark.
_LYING_REACH = 1.2
# Share of the likeliest piece's volume from which on another one may be the person as well.
_ALIKE = 0.5
# Height, in statures, of those who are told apart where they are one piece, how wide they are both ways at most,
# and how far apart their middles are: the legs and the trunk of one person are lower, what lies around him, shadows and
# ghosts, is a shell 1 to 1.6 statures wide, what stands to the left and right in his hull is nearer.
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


def _within_reach(piece: Hull, reach_m: float) -> Hull:
    """Without what is farther from the upright axis than a hand can be."""
    lateral = piece.points[:, :2] - np.median(piece.points[:, :2], axis=0)
    return piece.part(np.linalg.norm(lateral, axis=1) < reach_m)


def reach(person: Person) -> float:
    """How far from a vertical line through its middle a body can be: hands of a person, head and tail of an animal."""
    marks = person.body.landmarks_in_world(person.body.rest())[:, :2]
    length = float(np.linalg.norm(marks - np.median(marks, axis=0), axis=1).max(initial=0.0))
    return max(_REACH * size_of(person).stature_m, _LYING_REACH * length)


def taken(held: tuple[Person, ...], rig: Rig) -> tuple[Mask, ...]:
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


def showing(pieces: list[Hull], masks: tuple[Mask | None, ...], rig: Rig, theirs: tuple[Mask, ...]) -> list[Hull]:
    """The pieces of whose foreground a fair share is not that of those before them, nor around others (H, W).

    Of a woman who had left the room, hands and shadow of the man who danced there were searched in every third frame.
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
    """Those of pieces that may be the person as well as the first one, some at most."""
    least = _ALIKE * max((len(piece.points) for piece in pieces[:MOST_ALIKE]), default=0)
    return [piece for piece in pieces[:MOST_ALIKE] if len(piece.points) >= least]


def where_told(pieces: list[Hull], persons: tuple[Person, ...]) -> list[Hull]:
    """The pieces, those nearest to where persons are told to be first, in the persons' order."""
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
    """Those of pieces that are as high and wide as persons who stand, and apart from those before."""
    kept: list[Hull] = []
    for piece in pieces:
        gaps = [np.linalg.norm(place(piece.points) - place(other.points)) for other in kept]
        extents = np.ptp(piece.points, axis=0) / stature_m
        like_one = extents[2] > _UPRIGHT and extents[:2].min() < _WIDE
        if like_one and min(gaps, default=np.inf) > _BESIDE_M:
            kept.append(piece)
    return kept
