"""Keypoints that a detector found in images, and what they are called."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.segments import Mirror
from tracker.foundation.arrays import Array, Integers, shape_fault
from tracker.foundation.errors import SequenceError


def plain_name(name: str) -> str:
    """A keypoint's name in our spelling: `RShoulder`, `Right Shoulder` and `shoulder_r` are right_shoulder."""
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name)
    parts = words.replace("-", " ").replace("_", " ").replace(".", " ").split()
    # a name in capitals is one word
    if name.isupper():
        parts = name.lower().replace("-", " ").replace("_", " ").split()
    sides = [_SIDES[part] for part in parts if part in _SIDES]
    rest = [part for part in parts if part not in _SIDES]
    plain = "_".join([*sides[:1], *rest])
    return _WORDS.get(plain, plain)


_SIDES = {"l": "left", "r": "right", "left": "left", "right": "right"}
_WORDS = {"mid_hip": "pelvis", "hip_center": "pelvis", "hips": "pelvis", "head": "head_top"} | {
    f"{side}_big_toe": f"{side}_toe" for side in ("left", "right")
}


@dataclass(frozen=True)
class Detections:
    """What a detector found in one image: any number of persons, some of which may be none.

    Raises:
        SequenceError: the array does not fit the names.
    """

    names: tuple[str, ...]
    """Of the K keypoints, as the body file knows them."""

    found: Array
    """(N, K, 3) pixel x, y and confidence 0 to 1 for each of N persons; NaN for a keypoint that was not found."""

    def __post_init__(self) -> None:
        if fault := shape_fault(self.found, None, len(self.names), 3):
            raise SequenceError(f"keypoints: {fault}")

    @staticmethod
    def none(names: tuple[str, ...]) -> Detections:
        """Nobody found."""
        return Detections(names, np.zeros((0, len(names), 3)))


def swapped_sides(names: tuple[str, ...], mirror: Mirror) -> Integers:
    """(K,) for each keypoint the one of the other side; itself where there is none."""
    places = {plain_name(name): k for k, name in enumerate(names)}
    return np.array([places.get(mirror.of(plain_name(name)), k) for k, name in enumerate(names)], dtype=np.int64)


@dataclass(frozen=True)
class Meant:
    """Those of K keypoints that mean a point of a body."""

    rows: Integers
    """(L,) which keypoints."""

    points: Array
    """(L, 3) the points in the reference pose, metres."""

    ends: Integers
    """(L,) last parameter that moves each."""

    def of(self, chosen: Integers) -> Meant:
        """Some of them."""
        return Meant(self.rows[chosen], self.points[chosen], self.ends[chosen])


def meant(names: tuple[str, ...], body: BodyModel) -> Meant:
    """What keypoints mean: what the body's file calls so, and landmarks of the same name, however it is spelt."""
    marks = {plain_name(mark.name): mark for mark in (*body.landmarks, *body.keypoints)}
    rows = [k for k, name in enumerate(names) if plain_name(name) in marks]
    found = [marks[plain_name(names[k])] for k in rows]
    return Meant(
        np.array(rows, dtype=np.int64),
        np.array([mark.point for mark in found]).reshape(-1, 3),
        np.array([mark.parameter for mark in found], dtype=np.int64),
    )


def limbs(names: tuple[str, ...], body: BodyModel) -> list[Integers]:
    """Keypoints whose sides a detector may exchange together, with their partners: the arms, the legs, the head.

    Limbs are the groups of the body that have a partner on the other side. Keypoints that the body does not know are
    told apart by their words, as those of the head; without any of `_LIMBS` each with its partner alone.
    """
    other, known = swapped_sides(names, body.mirror), meant(names, body)
    place = {int(row): int(end) for row, end in zip(known.rows, known.ends, strict=True)}
    found: dict[str, list[int]] = {}
    for k in np.flatnonzero(other != np.arange(len(names))):
        words = set(plain_name(names[k]).split("_"))
        limb = next((limb for limb, own in _LIMBS.items() if words & own), names[min(k, other[k])])
        found.setdefault(_group(body, place.get(int(k), -1)) or limb, []).append(int(k))
    return [np.array(members, dtype=np.int64) for members in found.values()]


def _group(body: BodyModel, end: int) -> str:
    """The pair of limbs that a point belongs to, by the left one's name; empty for trunk and head."""
    for group in body.limbs:
        if end in body.group(group) and (other := body.partner_of(group)):
            return min(group, other)
    return ""


_LIMBS = {
    "arms": {"shoulder", "elbow", "wrist", "hand"},
    "legs": {"hip", "knee", "ankle", "heel", "toe", "foot"},
    "head": {"eye", "ear"},
}
"""Detectors exchange the sides of a whole limb: its keypoints are told apart together. Others are so one by one."""
