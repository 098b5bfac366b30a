"""The features that movements are compared by: where each limb points, seen from the segment it hangs on.

These are the joint angles of Gavrila & Davis without the singularities of angles: they say nothing of the world's axes,
of where somebody stands and faces, nor of the lengths of the limbs, so that persons, body models and motion files
compare. A difference between two of them is an angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.arrays import Array, Array32, Mask, frozen
from tracker.body import BodyModel
from tracker.errors import ModelError, nearest

JOINTS = tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)
"""Landmarks that the features are made of."""

LIMBS = tuple(f"{side}_{limb}" for side in ("left", "right") for limb in ("upper_arm", "forearm", "thigh", "shin"))
"""Limbs whose direction counts; behind them comes the vertical, seen from the trunk."""

FEATURES = (*LIMBS, "vertical")

RATE_HZ = 25.0
"""Frames a second that movements are compared at."""

_LONGEST_GAP_S = 0.25
"""Frames are interpolated over gaps up to this long: half the time of the quickest swing of an arm."""


@dataclass(frozen=True)
class Course:
    """How one person moved, at even times."""

    start_s: float
    """Time of the first frame, seconds; the others follow at `RATE_HZ`."""

    directions: Array32
    """(T, 9, 3) unit vectors in the order of `FEATURES`."""

    known: Mask
    """(T,) frames in which the joints are known."""

    @property
    def times_s(self) -> Array:
        """(T,) seconds."""
        times: Array = self.start_s + np.arange(len(self.known)) / RATE_HZ
        return times

    @property
    def seconds(self) -> float:
        """How long it is."""
        return len(self.known) / RATE_HZ

    def part(self, first: int, behind: int) -> Course:
        """Some of the frames."""
        start = self.start_s + first / RATE_HZ
        return Course(start, self.directions[first:behind], self.known[first:behind])

    def part_known(self) -> Course:
        """The known frames, put together."""
        return Course(self.start_s, self.directions[self.known], self.known[self.known])

    def mirrored(self) -> Course:
        """The same movement with left and right exchanged."""
        half = len(LIMBS) // 2
        order = [*range(half, 2 * half), *range(half), 2 * half]
        turned = self.directions[:, order] * np.array([1, -1, 1], dtype=np.float32)
        return Course(self.start_s, frozen(turned, np.float32), self.known)


def limb_directions(joints: Array) -> Array:
    """Directions of limbs in the axes of the thorax, or the pelvis: x forward, y left, z up along the trunk.

    Args:
        joints: (T, 12, 3) in the order of `JOINTS`, any unit, the world's z up.

    Returns:
        (T, 9, 3) unit vectors in the order of `FEATURES`; NaN where a joint is missing or two lie at one place.
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
    """Directions at even times, of joints at any.

    Args:
        times_s: (T,) seconds, rising.
        joints: (T, 12, 3) in the order of `JOINTS`; NaN where unknown.
    """
    directions = limb_directions(joints)
    good = np.flatnonzero(np.isfinite(directions).all(axis=(1, 2)))
    n_frames = int(np.floor((times_s[-1] - times_s[0]) * RATE_HZ + 1e-6)) + 1
    even = times_s[0] + np.arange(n_frames) / RATE_HZ
    if len(good) == 0:
        blank = np.zeros((n_frames, len(FEATURES), 3), dtype=np.float32)
        return Course(float(times_s[0]), blank, np.zeros(n_frames, dtype=np.bool_))
    at = times_s[good]
    flat = directions[good].reshape(len(good), -1)
    values = np.stack([np.interp(even, at, column) for column in flat.T], axis=1).reshape(n_frames, -1, 3)
    values /= np.maximum(np.linalg.norm(values, axis=-1, keepdims=True), 1e-9)
    behind = np.searchsorted(at, even - 1e-6)
    after, ahead = at[np.minimum(behind, len(at) - 1)], at[np.maximum(behind - 1, 0)]
    inside = (even >= at[0] - 1e-6) & (even <= at[-1] + 1e-6)
    near = np.abs(after - even) < 1e-5
    known = inside & (near | (after - ahead <= _LONGEST_GAP_S))
    return Course(float(times_s[0]), frozen(values, np.float32), frozen(known, np.bool_))


def joint_columns(body: BodyModel) -> list[int]:
    """Numbers of the landmarks of a body that the features are made of.

    Raises:
        ModelError: it lacks one: the body is no person's.
    """
    names = body.landmark_names
    missing = next((name for name in JOINTS if name not in names), None)
    if missing is not None:
        raise ModelError(
            f'model "{body.name}" has no landmark "{missing}"; {nearest(missing, names)}; movements are told by '
            "shoulders, elbows, wrists, hips, knees and ankles"
        )
    return [names.index(name) for name in JOINTS]


def course_of(body: BodyModel, times_s: Array, poses: Array) -> Course:
    """Directions at even times, of poses (T, dof) of a body at times (T,) in seconds; NaN where lost.

    Raises:
        ModelError: the body is no person's.
    """
    columns = joint_columns(body)
    lost: Mask = np.asarray(~np.isfinite(poses).all(axis=1))
    joints = body.landmarks_in_world(np.where(lost[:, None], body.rest(), poses))[:, columns]
    joints[lost] = np.nan
    return course(times_s, joints)
