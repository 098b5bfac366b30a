"""The numbers of a body model file as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.entries import PartEntry
from tracker.foundation.arrays import Array, frozen

_FIELDS = ("joints", "starts", "ends", "radii", "squareness", "taper", "landmarks")

# Landmarks this close to the end of a part, or to the middle of two joints, are that point, metres.
SAME_M = 0.006

SQUARENESS = (0.1, 1.0)
"""Exponents a superquadric may have here: below 0.1 it has corners, above 1 it is no longer convex (Solina & Bajcsy
1990)."""

MOST_TAPER = 0.7
"""Limits of `TaperedSuperquadric`."""


@dataclass(frozen=True)
class Anatomy:
    """Positions (m), logarithms of radii, and shape exponents of all entries; changes are arrays of the same layout."""

    joints: Array
    """(J, 3) of all segments."""

    starts: Array
    ends: Array
    """(P, 3) of all parts."""

    radii: Array
    """(P, 2) natural logarithms of metres."""

    squareness: Array
    taper: Array
    """(P, 2)"""

    landmarks: Array
    """(L, 3)"""

    parents: tuple[int, ...]
    """Index of each segment's parent, -1 for the world."""

    part_segments: tuple[int, ...]
    landmark_segments: tuple[int, ...]
    segment_mates: tuple[int, ...]
    """Index of the other side's segment; its own on the midline."""

    part_mates: tuple[int, ...]
    landmark_mates: tuple[int, ...]
    lone_segments: tuple[bool, ...]
    lone_parts: tuple[bool, ...]
    lone_landmarks: tuple[bool, ...]
    """Whether it is of one side and the other side has no such: a racket in a hand."""

    fronts: Array
    """(P, 3)"""

    across: Array
    """(3,) unit normal of the plane of symmetry."""

    @classmethod
    def of(cls, body: BodyDescription) -> Anatomy:
        """The numbers of a description."""
        names = [segment.name for segment in body.segments]
        parts = [part.name for part in body.parts]
        marks = list(body.landmarks)
        place = {name: k for k, name in enumerate(names)} | {"world": -1}
        parents = [place[segment.parent] for segment in body.segments]
        part_segments = [place[part.segment] for part in body.parts]
        landmark_segments = [place[mark.segment] for mark in body.landmarks.values()]
        across = np.array(body.across) / np.linalg.norm(body.across)
        segment_mates = _mates(names, body)
        lone_segments: list[bool] = []
        for k, parent in enumerate(parents):
            lone_segments.append(_is_lone(k, names, parent, (segment_mates, lone_segments), body))
        sided = (segment_mates, lone_segments)
        return cls(
            joints=np.array([segment.joint for segment in body.segments]),
            starts=np.array([part.start for part in body.parts]),
            ends=np.array([part.end for part in body.parts]),
            radii=np.log([part.radii for part in body.parts]),
            squareness=np.array([part.squareness for part in body.parts]),
            taper=np.array([part.taper for part in body.parts]),
            landmarks=np.array([mark.at for mark in body.landmarks.values()]).reshape(-1, 3),
            parents=tuple(parents),
            part_segments=tuple(part_segments),
            landmark_segments=tuple(landmark_segments),
            segment_mates=segment_mates,
            part_mates=_mates(parts, body),
            landmark_mates=_mates(marks, body),
            lone_segments=tuple(lone_segments),
            lone_parts=tuple(
                _is_lone(p, parts, k, sided, body) or (body.mirrored(one.name) == one.name and _is_beside(one, across))
                for p, (k, one) in enumerate(zip(part_segments, body.parts, strict=True))
            ),
            lone_landmarks=tuple(_is_lone(m, marks, k, sided, body) for m, k in enumerate(landmark_segments)),
            fronts=np.array([part.front for part in body.parts]),
            across=across,
        )

    def described(self, body: BodyDescription) -> BodyDescription:
        """The description with these numbers."""
        segments = tuple(
            segment.model_copy(update={"joint": tuple(joint)})
            for segment, joint in zip(body.segments, self.joints.tolist(), strict=True)
        )
        # Limits of the shapes are kept to rounding.
        squareness, taper = self.squareness.clip(*SQUARENESS), self.taper.clip(-MOST_TAPER, MOST_TAPER)
        columns = (self.starts, self.ends, np.exp(self.radii), squareness, taper)
        fields = ("start", "end", "radii", "squareness", "taper")
        parts = tuple(
            part.model_copy(update=dict(zip(fields, map(tuple, values), strict=True)))
            for part, *values in zip(body.parts, *(column.tolist() for column in columns), strict=True)
        )
        landmarks = {
            name: mark.model_copy(update={"at": tuple(at)})
            for (name, mark), at in zip(body.landmarks.items(), self.landmarks.tolist(), strict=True)
        }
        return body.model_copy(update={"segments": segments, "parts": parts, "landmarks": landmarks})

    def packed(self) -> Array:
        """(n,) all numbers."""
        return np.concatenate([getattr(self, name).ravel() for name in _FIELDS])

    def plus(self, change: Array) -> Anatomy:
        """The anatomy changed by (n,)."""
        values, start = {}, 0
        for name in _FIELDS:
            old = getattr(self, name)
            values[name] = old + change[start : start + old.size].reshape(old.shape)
            start += old.size
        return replace(self, **values)

    def still(self) -> Anatomy:
        """No change at all, of the same layout."""
        return replace(self, **{name: np.zeros_like(getattr(self, name)) for name in _FIELDS})

    def children(self, k: int) -> tuple[int, ...]:
        """Segments that hang on segment k."""
        return tuple(j for j, parent in enumerate(self.parents) if parent == k)

    def below(self, k: int) -> list[int]:
        """Segment k and all that hang on it."""
        found = [k]
        for j, parent in enumerate(self.parents):
            if parent in found:
                found.append(j)
        return found

    def length_axis(self, k: int) -> Array | None:
        """(3,) from the joint of a segment to the next one, or to its farthest landmark or part; None if none is."""
        ends = [self.joints[j] for j in self.children(k)]
        if not ends:
            ends = [self.landmarks[m] for m, segment in enumerate(self.landmark_segments) if segment == k]
            ends = [end for end in ends if np.linalg.norm(end - self.joints[k]) > SAME_M]
        if not ends:
            ends = [self.ends[p] for p, segment in enumerate(self.part_segments) if segment == k]
        gaps = [end - self.joints[k] for end in ends]
        longest = max(gaps, key=lambda gap: float(np.linalg.norm(gap)), default=np.zeros(3))
        length = float(np.linalg.norm(longest))
        return longest / length if length > SAME_M else None

    def part_axes(self, p: int) -> tuple[Array, Array, Array]:
        """(3,) each: unit vectors along, to the front and to the side of a part."""
        along = self.ends[p] - self.starts[p]
        along = along / np.linalg.norm(along)
        side = np.cross(along, self.fronts[p])
        side /= np.linalg.norm(side)
        return along, np.cross(side, along), side

    def one(self, name: str, p: int, k: int) -> Array:
        """One number of a part: change per unit."""
        change = self.still()
        getattr(change, name)[p, k] = 1.0
        return change.packed()

    def mirrored(self, change: Array) -> Array:
        """A change (n,) as the other side has it; what that side has not goes along with its segment."""
        given = self.still().plus(change)
        flip = np.eye(3) - 2 * np.outer(self.across, self.across)
        found = replace(
            given,
            joints=given.joints[list(self.segment_mates)] @ flip,
            starts=given.starts[list(self.part_mates)] @ flip,
            ends=given.ends[list(self.part_mates)] @ flip,
            radii=given.radii[list(self.part_mates)],
            squareness=given.squareness[list(self.part_mates)],
            taper=given.taper[list(self.part_mates)],
            landmarks=given.landmarks[list(self.landmark_mates)] @ flip,
        )
        moved = np.concatenate([found.joints, np.zeros((1, 3))])  # the world, -1, stays
        for k in np.flatnonzero(self.lone_segments):
            found.joints[k] = moved[k] = moved[self.parents[k]]
        for p in np.flatnonzero(self.lone_parts):
            found.starts[p] = found.ends[p] = moved[self.part_segments[p]]
            found.radii[p], found.squareness[p], found.taper[p] = 0.0, 0.0, 0.0
        for m in np.flatnonzero(self.lone_landmarks):
            found.landmarks[m] = moved[self.landmark_segments[m]]
        return found.packed()

    def symmetrized(self, change: Array) -> Array:
        """The part of a change (n,) that keeps the body symmetric."""
        kept: Array = (change + self.mirrored(change)) / 2
        return kept


def _mates(names: list[str], body: BodyDescription) -> tuple[int, ...]:
    mates = [body.mirrored(name) for name in names]
    return tuple(names.index(mate) if mate in names else k for k, mate in enumerate(mates))


def _is_lone(
    k: int, names: list[str], above: int, sided: tuple[Sequence[int], Sequence[bool]], body: BodyDescription
) -> bool:
    """Whether the k-th of some names is alone: called after a side or hanging on one, and without a partner."""
    mate, (mates, lone) = body.mirrored(names[k]), sided
    return mate not in names or (mate == names[k] and above >= 0 and (mates[above] != above or lone[above]))


def _is_beside(part: PartEntry, across: Array) -> bool:
    """Whether the plane of symmetry does not run through a part."""
    levels = np.array([part.start, part.end]) @ across
    return bool(np.abs(levels).min() > max(part.radii) and levels[0] * levels[1] > 0)


# How the numbers of a body model file change together when a body grows: each change is packed, per unit of it.


def grown(anatomy: Anatomy) -> Array:
    """The whole body larger: change per relative unit."""
    change = replace(anatomy.still(), radii=np.ones_like(anatomy.radii))
    same = {name: getattr(anatomy, name) for name in ("joints", "starts", "ends", "landmarks")}
    return replace(change, **same).packed()


def fattened(anatomy: Anatomy) -> Array:
    """All radii larger: change per relative unit."""
    return replace(anatomy.still(), radii=np.ones_like(anatomy.radii)).packed()


def lengthened(anatomy: Anatomy, k: int) -> Array:
    """A segment longer along its axis: change per relative unit."""
    change, axis = anatomy.still(), anatomy.length_axis(k)
    assert axis is not None
    _stretch(anatomy, change, k, np.outer(axis, axis))
    return change.packed()


def widened(anatomy: Anatomy, k: int, axis: int) -> Array:
    """A segment with several joints larger along one axis of the reference pose: change per relative unit."""
    change, unit = anatomy.still(), np.eye(3)[axis]
    _stretch(anatomy, change, k, np.outer(unit, unit))
    for p, segment in enumerate(anatomy.part_segments):
        if segment == k:
            _, front, side = anatomy.part_axes(p)
            change.radii[p] += (front @ unit) ** 2, (side @ unit) ** 2
    return change.packed()


def shifted(anatomy: Anatomy, k: int, shift: Array) -> Array:
    """A joint elsewhere on its parent: change per metre; landmarks between it and its mate follow half."""
    change = anatomy.still()
    _carry(anatomy, change, k, shift)
    middle = (anatomy.joints[k] + anatomy.joints[anatomy.segment_mates[k]]) / 2
    for m, segment in enumerate(anatomy.landmark_segments):
        if segment == anatomy.parents[k] and np.linalg.norm(anatomy.landmarks[m] - middle) < SAME_M:
            change.landmarks[m] += shift / (1 if anatomy.segment_mates[k] == k else 2)
    return change.packed()


def end_moved(anatomy: Anatomy, p: int, end: str, shift: Array) -> Array:
    """One end of a part elsewhere: change per metre; landmarks there follow."""
    change, points = anatomy.still(), anatomy.starts if end == "start" else anatomy.ends
    (change.starts if end == "start" else change.ends)[p] += shift
    for m, segment in enumerate(anatomy.landmark_segments):
        if segment == anatomy.part_segments[p] and np.linalg.norm(anatomy.landmarks[m] - points[p]) < SAME_M:
            change.landmarks[m] += shift
    return change.packed()


def _carry(anatomy: Anatomy, change: Anatomy, k: int, shift: Array) -> None:
    """Moves segment k with all that hangs on it."""
    below = set(anatomy.below(k))
    for j in below:
        change.joints[j] += shift
    for p, segment in enumerate(anatomy.part_segments):
        if segment in below:
            change.starts[p] += shift
            change.ends[p] += shift
    for m, segment in enumerate(anatomy.landmark_segments):
        if segment in below:
            change.landmarks[m] += shift


def _stretch(anatomy: Anatomy, change: Anatomy, k: int, along: Array) -> None:
    joint = anatomy.joints[k]
    for j in anatomy.children(k):
        _carry(anatomy, change, j, along @ (anatomy.joints[j] - joint))
    for p, segment in enumerate(anatomy.part_segments):
        if segment == k:
            change.starts[p] += along @ (anatomy.starts[p] - joint)
            change.ends[p] += along @ (anatomy.ends[p] - joint)
    for m, segment in enumerate(anatomy.landmark_segments):
        if segment == k:
            change.landmarks[m] += along @ (anatomy.landmarks[m] - joint)


# How lengths of persons of one stature go together: who has long thighs has a short trunk, and hands as feet.
#
# ANSUR II (Gordon et al., 2012 Anthropometric Survey of U.S. Army Personnel, NATICK/TR-15/007, 2014; public data of
# 4082 men and 1986 women): logarithms of lengths over the stature, correlated over the men and over the women, mean of
# both. Upper arm: acromion to radiale; forearm: radiale to stylion; thigh: trochanterion less lateral femoral
# epicondyle; shin: that less lateral malleolus; trunk: cervicale less trochanterion; head and neck: stature less
# cervicale.

SEGMENTS = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot", "trunk", "head")

CORRELATIONS = frozen(
    [
        [1.00, 0.34, 0.21, 0.18, 0.37, 0.13, -0.26, -0.29],
        [0.34, 1.00, 0.39, 0.28, 0.42, 0.34, -0.38, -0.28],
        [0.21, 0.39, 1.00, 0.08, 0.28, 0.61, -0.20, -0.15],
        [0.18, 0.28, 0.08, 1.00, 0.05, 0.05, -0.74, -0.23],
        [0.37, 0.42, 0.28, 0.05, 1.00, 0.24, -0.50, -0.35],
        [0.13, 0.34, 0.61, 0.05, 0.24, 1.00, -0.17, -0.10],
        [-0.26, -0.38, -0.20, -0.74, -0.50, -0.17, 1.00, -0.05],
        [-0.29, -0.28, -0.15, -0.23, -0.35, -0.10, -0.05, 1.00],
    ]
)
"""Standard deviations are 0.033, 0.043, 0.040, 0.049, 0.039, 0.035, 0.040 and 0.048: `ShapePrior.length`."""

_CALLED = {"chest.height": "trunk", "torso.height": "trunk"}
"""Parameters that lengthen what is measured under another name."""


def correlated(names: Sequence[str], sides: Sequence[str]) -> Array:
    """(S, S) correlations of shape parameters; those without known proportions are independent.

    Args:
        names: of the parameters, `left_thigh.length`.
        sides: words that tell sides apart, `left`.
    """
    found, first = np.eye(len(names)), dict[str, int]()
    for k, name in enumerate(names):
        plain = name
        for side in sides:
            plain = plain.removeprefix(f"{side}_")
        segment = _CALLED.get(plain, plain.removesuffix(".length"))
        if segment in SEGMENTS and (plain.endswith(".length") or plain in _CALLED):
            first.setdefault(segment, k)  # of a body whose sides differ the first one: the other is as free as it was
    for one, k in first.items():
        for other, j in first.items():
            found[k, j] = CORRELATIONS[SEGMENTS.index(one), SEGMENTS.index(other)]
    return found
