"""Recognition of movements (Gavrila & Davis 1995): dynamic time warping of joint angles against known movements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoints import meant
from tracker.foundation.arrays import Array, Array32, Mask, frozen
from tracker.foundation.errors import ModelError

_TRIED, _SPREAD, _STIFF = 16, 0.3, 1e-6
"""Poses about the reference pose, rad and m, in which a segment without any turn shows that it has none."""

_VERTICAL = "vertical"

_ALIKE = 0.01
"""Tolerance of the mirror symmetry of directions of a body with two sides, at rest."""


@dataclass(frozen=True)
class Features:
    """Directions that movements are compared by."""

    names: tuple[str, ...]

    partners: tuple[int, ...] = ()
    """For each the number of the other side's; empty for a body without sides."""

    across: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Normal of the plane between the sides."""

    def mirrored(self, directions: Array32) -> Array32:
        """Directions (T, L, 3) with the sides exchanged, of a body with sides."""
        normal, found = np.array(self.across, dtype=np.float32), directions[:, list(self.partners)]
        turned: Array32 = found - 2 * (found @ normal)[..., None] * normal / (normal @ normal)
        return frozen(turned, np.float32)


def features_of(body: BodyModel) -> Features:
    """The segments of a body that can turn, and the vertical if the body moves about.

    Raises:
        ModelError: it has no such segment, or one with the name of the vertical.
    """
    named = dict.fromkeys(part.segment for part in body.parts)
    if _VERTICAL in named:
        raise ModelError(
            f'model "{body.name}": movements have a direction "{_VERTICAL}": give the segment another name'
        )
    q = body.clamped(body.rest() + np.random.default_rng(0).normal(0, _SPREAD, (_TRIED, body.dof)))
    turning = np.ptp(segment_directions(body, Features(tuple(named)), q), axis=0).max(axis=1) > _STIFF
    names = tuple(name for name, turns in zip(named, turning, strict=True) if turns)
    if not names:
        raise ModelError(f'model "{body.name}" has no segment that turns: there is no movement to recognize')
    names = names if body.stays else (*names, _VERTICAL)
    others = [body.mirror.of(name) for name in names]
    features = Features(names, (), body.mirror.across)
    if set(others) != set(names) or others == list(names):
        return features
    paired = replace(features, partners=tuple(names.index(name) for name in others))
    rest = segment_directions(body, features, body.rest()[None]).astype(np.float32)
    return paired if np.abs(paired.mirrored(rest) - rest).max() < _ALIKE else features


def segment_directions(body: BodyModel, features: Features, poses: Array) -> Array:
    """(T, L, 3) unit vectors of features at poses (T, dof), in the axes of the segment that carries the body.

    A segment points as its first part does: its other parts may be carried things.
    """
    if body.stays:
        axes = np.tile(np.eye(3), (len(poses), 1, 1))
    else:
        axes = body.world_from_parameters(poses)[:, body.root.columns[-1], :3, :3]
    first = {part.segment: p for p, part in reversed(list(enumerate(body.parts)))}
    pointing = body.world_from_part(poses)[:, :, :3, 2]
    upwards = np.tile([0.0, 0.0, 1.0], (len(poses), 1))
    found = [upwards if name == _VERTICAL else pointing[:, first[name]] for name in features.names]
    directions: Array = np.einsum("tji,tlj->tli", axes, np.stack(found, axis=1))
    return directions


# The features that movements are compared by: where each limb points, seen from the segment it hangs on.
#
# These are the joint angles of Gavrila & Davis without the singularities of angles. They do not depend on the world's
# axes, on the person's place and heading, nor on the lengths of the limbs, so that persons, body models and motion
# files compare. A difference between two of them is an angle. Other bodies are told by their segments, see
# `tracker.results.recognition`, and compare with themselves alone.

JOINTS = tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)
"""Landmarks of the features."""

LIMBS = tuple(f"{side}_{limb}" for side in ("left", "right") for limb in ("upper_arm", "forearm", "thigh", "shin"))
"""Limbs whose direction counts; then the vertical, seen from the trunk."""

FEATURES = (*LIMBS, "vertical")

PERSONS = Features(FEATURES, (*range(len(LIMBS) // 2, len(LIMBS)), *range(len(LIMBS) // 2), len(LIMBS)))
"""Those of all persons."""

RATE_HZ = 25.0
"""Frame rate of comparisons, Hz."""

_LONGEST_GAP_S = 0.25
"""Largest gap that is interpolated, seconds: half the time of the quickest swing of an arm."""


@dataclass(frozen=True)
class Course:
    """The movement of one person, at even times."""

    start_s: float
    """Time of the first frame, seconds; the others follow at `RATE_HZ`."""

    directions: Array32
    """(T, L, 3) unit vectors in the order of the features, nine of a person."""

    known: Mask
    """(T,) frames in which the joints are known."""

    features: Features = PERSONS
    """Meaning of the directions."""

    places: Array | None = None
    """(T, 2) where the hips are over the floor, in lengths of a leg; None where nobody has told."""

    @property
    def speed(self) -> float:
        """How fast the hips go over the floor, leg lengths a second, in the middle; NaN where that is not known.

        Steps sway: they are left out by looking at ways of a second.
        """
        n = round(RATE_HZ)
        if self.places is None or len(self.places) <= n:
            return np.nan
        return float(np.median(np.linalg.norm(self.places[n:] - self.places[:-n], axis=1)))

    @property
    def times_s(self) -> Array:
        """(T,) seconds."""
        times: Array = self.start_s + np.arange(len(self.known)) / RATE_HZ
        return times

    @property
    def seconds(self) -> float:
        """Duration, seconds."""
        return len(self.known) / RATE_HZ

    def part(self, first: int, behind: int) -> Course:
        """Some of the frames."""
        start, directions = self.start_s + first / RATE_HZ, self.directions[first:behind]
        places = None if self.places is None else self.places[first:behind]
        return replace(self, start_s=start, directions=directions, known=self.known[first:behind], places=places)

    def part_known(self) -> Course:
        """The known frames, joined."""
        places = None if self.places is None else self.places[self.known]
        return replace(self, directions=self.directions[self.known], known=self.known[self.known], places=places)

    def mirrored(self) -> Course:
        """The same movement with left and right exchanged, of a body with sides."""
        return replace(self, directions=self.features.mirrored(self.directions))


def limb_directions(joints: Array) -> Array:
    """Directions of limbs in the axes of the thorax, or the pelvis: x forward, y left, z up along the trunk.

    Args:
        joints: (T, 12, 3) in the order of `JOINTS`, any unit, the world's z up.

    Returns:
        (T, 9, 3) unit vectors in the order of `FEATURES`; NaN if a joint is missing or two joints coincide.
    """
    left, right = joints[:, :6], joints[:, 6:]
    along = (left[:, 0] + right[:, 0] - left[:, 3] - right[:, 3]) / 2
    thorax, pelvis = _axes(along, left[:, 0] - right[:, 0]), _axes(along, left[:, 3] - right[:, 3])
    columns = []
    for side in (left, right):
        for axes, start, end in ((thorax, 0, 1), (thorax, 1, 2), (pelvis, 3, 4), (pelvis, 4, 5)):
            columns.append(np.einsum("tij,tj->ti", axes, side[:, end] - side[:, start]))
    columns.append(pelvis[:, :, 2])
    found = np.stack(columns, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        directions: Array = found / np.linalg.norm(found, axis=-1, keepdims=True)
    return directions


def _axes(along: Array, across: Array) -> Array:
    """(T, 3, 3) rows x, y, z of axes whose z is `along` (T, 3) and whose y is nearest to `across` (T, 3)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        up = along / np.linalg.norm(along, axis=1, keepdims=True)
        y = across - up * np.sum(up * across, axis=1, keepdims=True)
        y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([np.cross(y, up), y, up], axis=1)


def course(times_s: Array, joints: Array) -> Course:
    """Directions at even times, from joints at any times.

    Args:
        times_s: (T,) seconds, rising.
        joints: (T, 12, 3) in the order of `JOINTS`; NaN where unknown.
    """
    return _even(times_s, limb_directions(joints), PERSONS, _over_floor(joints))


def _over_floor(joints: Array) -> Array:
    """(T, 2) places of the hips, in lengths of a leg, of joints (T, 12, 3) with z up."""
    legs = [np.linalg.norm(np.diff(joints[:, k : k + 3], axis=1), axis=2).sum(axis=1) for k in (3, 9)]
    places: Array = (joints[:, 3, :2] + joints[:, 9, :2]) / 2 / np.nanmedian(legs)
    return places


def _even(times_s: Array, directions: Array, features: Features, places: Array | None = None) -> Course:
    """Directions (T, L, 3) and places (T, 2) at any times (T,), interpolated at even ones."""
    good = np.flatnonzero(np.isfinite(directions).all(axis=(1, 2)))
    n_frames = int(np.floor((times_s[-1] - times_s[0]) * RATE_HZ + 1e-6)) + 1
    even = times_s[0] + np.arange(n_frames) / RATE_HZ
    if len(good) == 0:
        blank = np.zeros((n_frames, len(features.names), 3), dtype=np.float32)
        return Course(float(times_s[0]), blank, np.zeros(n_frames, dtype=np.bool_), features)
    at = times_s[good]
    flat = directions[good].reshape(len(good), -1)
    values = np.stack([np.interp(even, at, column) for column in flat.T], axis=1).reshape(n_frames, -1, 3)
    values /= np.maximum(np.linalg.norm(values, axis=-1, keepdims=True), 1e-9)
    behind = np.searchsorted(at, even - 1e-6)
    after, ahead = at[np.minimum(behind, len(at) - 1)], at[np.maximum(behind - 1, 0)]
    inside = (even >= at[0] - 1e-6) & (even <= at[-1] + 1e-6)
    near = np.abs(after - even) < 1e-5
    known = inside & (near | (after - ahead <= _LONGEST_GAP_S))
    if places is not None:
        places = frozen(np.stack([np.interp(even, at, column) for column in places[good].T], axis=1))
    return Course(float(times_s[0]), frozen(values, np.float32), frozen(known, np.bool_), features, places)


def course_of(body: BodyModel, times_s: Array, poses: Array) -> Course:
    """Directions at even times, of poses (T, dof) of a body at times (T,) in seconds; NaN where lost.

    A person is a body with the landmarks `JOINTS`, or with names for them in `[keypoints]` of its model file.

    Raises:
        ModelError: the body is not a person's, and no segment of it turns.
    """
    lost: Mask = np.asarray(~np.isfinite(poses).all(axis=1))
    placed, called = np.where(lost[:, None], body.rest(), poses), meant(JOINTS, body)
    if len(called.rows) == len(JOINTS):
        joints = body.points_in_world(placed, called.points, called.ends)
        features, directions, places = PERSONS, limb_directions(joints), _over_floor(joints)
    else:
        places = None
        features = features_of(body)
        directions = segment_directions(body, features, placed)
    directions[lost] = np.nan
    return _even(times_s, directions, features, places)
