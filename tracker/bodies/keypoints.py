"""Keypoints of a detector in images, their names, and the persons that several views show together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.segments import Mirror
from tracker.cameras.rig import Rig
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
    """Detections in one image: any number of persons, some of which may be other things.

    Raises:
        SequenceError: the array does not fit the names.
    """

    names: tuple[str, ...]
    """Names of the K keypoints, as in the body file."""

    found: Array
    """(N, K, 3) pixel x, y and confidence 0 to 1 for each of N persons; NaN for a keypoint that was not found."""

    def __post_init__(self) -> None:
        if fault := shape_fault(self.found, None, len(self.names), 3):
            raise SequenceError(f"keypoints: {fault}")

    @staticmethod
    def none(names: tuple[str, ...]) -> Detections:
        """No detection."""
        return Detections(names, np.zeros((0, len(names), 3)))


def swapped_sides(names: tuple[str, ...], mirror: Mirror) -> Integers:
    """(K,) for each keypoint its partner on the other side; itself if it has none."""
    places = {plain_name(name): k for k, name in enumerate(names)}
    return np.array([places.get(mirror.of(plain_name(name)), k) for k, name in enumerate(names)], dtype=np.int64)


@dataclass(frozen=True)
class Meant:
    """Those of K keypoints that mean a point of a body."""

    rows: Integers
    """(L,) numbers of the keypoints."""

    points: Array
    """(L, 3) the points in the reference pose, metres."""

    ends: Integers
    """(L,) last parameter that moves each."""

    def of(self, chosen: Integers) -> Meant:
        """Some of them."""
        return Meant(self.rows[chosen], self.points[chosen], self.ends[chosen])


def meant(names: tuple[str, ...], body: BodyModel) -> Meant:
    """Meanings of keypoints: names in the body's file, and landmarks of the same name in any spelling."""
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
    grouped by their words, as those of the head; without any of `_LIMBS` each stands alone with its partner.
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
"""Detectors exchange the sides of a whole limb: its keypoints are exchanged together. Others are exchanged one by
one."""


_OUTLIER = 0.05
"""Reprojection error at which a keypoint is wrong, times the person's extent in the view: 20 px of 400. Errors of
correct BlazePose detections on seven recordings: median 0.012, 90 % below 0.035."""

_LEAST_KEYPOINTS = 6
"""Keypoints that two views must agree on to show one person."""

_MOST_EXCHANGED = 8
"""Largest number of views for which all ways to exchange a limb's sides are tried: 163 of eight."""


@dataclass(frozen=True)
class Skeleton:
    """A person in space."""

    points: Array
    """(K, 3) metres; NaN where fewer than two views agree."""

    n_views: Integers
    """(K,) views that agree on each keypoint."""

    used: dict[int, int]
    """View -> number of the detection that shows the person."""

    pixels: Array
    """(V, K, 2) the keypoints that agree, sides exchanged where the detector had them wrong; NaN for others."""


def skeletons(
    rig: Rig, found: Sequence[Array], other_side: Integers, limbs: Sequence[Integers], most: int
) -> list[Skeleton]:
    """The persons that the views agree on, the surest one first.

    Args:
        rig: the V cameras.
        found: for each view (N, K, 3) pixels and confidences of detections; NaN for keypoints not found.
        other_side: (K,) partner of each keypoint on the other side.
        limbs: keypoints whose sides are exchanged together.
        most: largest number of persons.
    """
    left = {v: list(range(len(view))) for v, view in enumerate(found)}
    persons: list[Skeleton] = []
    while len(persons) < most:
        used = _best_seed(rig, found, left, other_side)
        if used is None:
            break
        person = _settled(rig, found, used, other_side, limbs)
        if person is not None:
            persons.append(person)
        for v, n in used.items():
            left[v].remove(n)
    return persons


@dataclass(frozen=True)
class _Seed:
    """Detections that may be one person."""

    score: float
    pixels: Array
    """(V, K, 2) of the pair, with the sides as its first view has them."""

    used: dict[int, int]


def _best_seed(
    rig: Rig, found: Sequence[Array], left: dict[int, list[int]], other_side: Integers
) -> dict[int, int] | None:
    """View -> detection of the person that the views agree on best, from all pairs of detections in two views."""
    best: _Seed | None = None
    for v, u in itertools.combinations(left, 2):
        for n, m, swapped in itertools.product(left[v], left[u], (False, True)):
            pixels = np.full((len(rig), len(other_side), 2), np.nan)
            pixels[v] = found[v][n, :, :2]
            pixels[u] = found[u][m][other_side if swapped else slice(None), :2]
            pair = _Seed(0.0, pixels, {v: n, u: m})
            seed = _joined(rig, pair, found, left, other_side)
            if seed is not None and (best is None or seed.score > best.score):
                best = seed
    return None if best is None else best.used


def _joined(
    rig: Rig, pair: _Seed, found: Sequence[Array], left: dict[int, list[int]], other_side: Integers
) -> _Seed | None:
    """A pair with the detections of the other views that agree with it; None if the pair itself does not agree."""
    points, _ = rig.triangulate(pair.pixels)
    fits = [_fits(rig, points, v, pair.pixels[v]) for v in pair.used]
    good = (fits[0] > 0) & (fits[1] > 0)
    if np.count_nonzero(good) < _LEAST_KEYPOINTS:
        return None
    points = np.where(good[:, None], points, np.nan)
    # Two rays meet easily, above all those of cameras that face each other: the third view decides.
    score, used = 0.25 * float((fits[0] + fits[1])[good].sum()), dict(pair.used)
    for v in left:
        if v in pair.used or not left[v]:
            continue
        trials = [(n, found[v][n][order, :2]) for n in left[v] for order in (slice(None), other_side)]
        each = [_fits(rig, points, v, pixels) for _, pixels in trials]
        best = int(np.argmax([fit.sum() for fit in each]))
        if np.count_nonzero(each[best]) >= _LEAST_KEYPOINTS // 2:
            used[v] = trials[best][0]
            score += float(each[best].sum())
    return _Seed(score, pair.pixels, used)


def _fits(rig: Rig, points: Array, v: int, pixels: Array) -> Array:
    """(K,) agreement of each point with a detection: 1 exactly there, 0 from an outlier's distance on."""
    errors = np.linalg.norm(rig.cameras[v].project(points) - pixels, axis=1)
    share = np.nan_to_num(errors, nan=np.inf) / (_OUTLIER * extent(pixels))
    fits: Array = np.maximum(1 - share**2, 0.0)
    return fits


def extent(pixels: Array) -> float:
    """Diagonal of the box around keypoints (K, 2), px."""
    return float(np.linalg.norm(np.nanmax(pixels, axis=0) - np.nanmin(pixels, axis=0)))


def _settled(
    rig: Rig, found: Sequence[Array], used: dict[int, int], other_side: Integers, limbs: Sequence[Integers]
) -> Skeleton | None:
    """Exchanges the sides of limbs in views if the rays then meet, and leaves out keypoints that still do not.

    None if that is most of it: then it was no person.
    """
    pixels = np.full((len(rig), len(other_side), 2), np.nan)
    for v, n in used.items():
        pixels[v] = found[v][n][:, :2]
    for limb in limbs if len(used) <= _MOST_EXCHANGED else ():
        pixels = _sides_settled(rig, pixels, sorted(used), limb, other_side)
    points, kept = _consensus(rig, pixels)
    n_views, n_seen = (np.isfinite(one[..., 0]).sum(axis=0) for one in (kept, pixels))
    points[n_views < 2] = np.nan
    n_points = np.count_nonzero(n_views >= 2)
    if n_points < max(_LEAST_KEYPOINTS, 0.5 * np.count_nonzero(n_seen >= 2)):
        return None
    return Skeleton(points, n_views, used, kept)


def _sides_settled(rig: Rig, pixels: Array, views: list[int], limb: Integers, other_side: Integers) -> Array:
    """Keypoints (V, K, 2) with the sides of one limb exchanged in views, at most half, if the rays then meet."""
    best, least = pixels, np.inf
    limits = _limits(pixels)
    for n_swapped in range(len(views) // 2 + 1):
        for swapped in itertools.combinations(views, n_swapped):
            trial = pixels.copy()
            for v in swapped:
                trial[v, limb] = pixels[v, other_side[limb]]
            points, _ = rig.triangulate(trial[:, limb])
            errors = np.linalg.norm(rig.project(points) - trial[:, limb], axis=2) / limits[:, None]
            misfit = float(np.nansum(np.minimum(errors, 3.0) ** 2))
            # an exchange must be worth it: limbs beside each other fit either way
            if misfit < (0.7 if n_swapped else 1.0) * least:
                best, least = trial, misfit
    return best


def _limits(pixels: Array) -> Array:
    """(V,) reprojection error at which a keypoint of (V, K, 2) is wrong, px; infinite where a view has none."""
    return np.array([_OUTLIER * extent(view) if np.isfinite(view).any() else np.inf for view in pixels])


def _consensus(rig: Rig, pixels: Array) -> tuple[Array, Array]:
    """Points (K, 3) after leaving out, one by one, the views (V, K, 2) that fit worst; and the kept views."""
    kept = pixels.copy()
    limits = _limits(pixels)
    while True:
        points, _ = rig.triangulate(kept)
        errors = np.linalg.norm(rig.project(points) - kept, axis=2) / limits[:, None]
        errors = np.nan_to_num(errors, nan=0.0)
        worst = errors.argmax(axis=0)
        bad = np.flatnonzero(errors.max(axis=0) > 1)
        if len(bad) == 0:
            return points, kept
        kept[worst[bad], bad] = np.nan
