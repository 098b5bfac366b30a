"""Poses of a body that moves as motion files of other laboratories do: limbs that point the same way."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import least_squares

from benchmarks.motion_files import MotionFile
from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError
from tracker.results.recognition import JOINTS

_LIMBS = tuple(
    (f"{side}_{one}", f"{side}_{other}")
    for side in ("left", "right")
    for one, other in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
)
_ACROSS = ("right_shoulder", "left_shoulder"), ("right_hip", "left_hip")

# Beside limbs of length 1: what limbs do not tell goes to where it rests, or stays as it was a frame before.
_USUAL, _STEADY = 0.03, 0.05
# A point that runs through another part by its full depth turns a limb by some ten degrees.
_APART = 0.15
_DELTA = 1e-5
# No joint of nineteen true movements does that at 25 frames a second, see `tracker.tracking.jumps`.
_JUMP_M, _TIMES = 0.1, 2.5
# Headings tried for the first frame.
_HEADINGS = np.radians(np.arange(0, 360, 45))


def poses_like(motion: MotionFile, body: BodyModel, rate_hz: float) -> Array:
    """The movement of a motion file done by a body, on the floor, above the world's origin.

    Limbs, shoulders, hips and trunk point as in the file; no part runs through another as far as that can be had; the
    way of the hips is scaled by the length of the legs.

    Args:
        motion: at least two frames.
        body: has the landmarks `JOINTS`.
        rate_hz: frames a second asked for.

    Returns:
        (T, dof) rad and m.

    Raises:
        SequenceError: a joint jumps, for the body cannot follow the file there; says at what time.
        ModelError: the body lacks one of the landmarks.
    """
    times = np.arange(motion.times_s[0], motion.times_s[-1], 1 / rate_hz)
    joints = make_interp_spline(motion.times_s, motion.joints, k=1)(times)
    wanted = directions_of(joints)
    fit = _Fit(body)
    poses = [fit.first(wanted[0])]
    for directions in wanted[1:]:
        poses.append(fit.solved(poses[-1], directions, _STEADY))
    placed = _placed(np.array(poses), joints, body)
    ways = np.linalg.norm(np.diff(_joints(body, placed), axis=0), axis=2).max(axis=1)
    jumps = (ways[1:-1] > _JUMP_M) & (ways[1:-1] > _TIMES * np.maximum(ways[:-2], ways[2:]))
    if jumps.any():
        raise SequenceError(f"a joint jumps after {times[1 + int(np.argmax(jumps))]:.2f} s; leave that out")
    return placed


def directions_of(joints: Array) -> Array:
    """(*B, 11, 3) unit vectors along limbs, across shoulders and hips, and up the trunk, of `JOINTS` (*B, 12, 3)."""
    at = {name: joints[..., k, :] for k, name in enumerate(JOINTS)}
    ways = [at[other] - at[one] for one, other in (*_LIMBS, *_ACROSS)]
    low, high = ((at[f"left_{name}"] + at[f"right_{name}"]) / 2 for name in ("hip", "shoulder"))
    stacked = np.stack([*ways, high - low], axis=-2)
    unit: Array = stacked / np.linalg.norm(stacked, axis=-1, keepdims=True)
    return unit


class _Fit:
    """Least squares of one frame after the other."""

    def __init__(self, body: BodyModel) -> None:
        self._body = body
        self._free = np.flatnonzero(body.rotates)
        low, high = body.limits[self._free].T
        self._limits = low, high
        self._spreads = np.where(high - low < 2 * np.pi, high - low, np.inf)

    def first(self, wanted: Array) -> Array:
        """The best of several headings."""
        heading = int(self._free[np.argmax(np.ptp(self._body.limits[self._free], axis=1))])
        found = []
        for angle in _HEADINGS:
            q = self._body.rest()
            q[heading] = angle
            found.append(self.solved(q, wanted, 0.0))
        return min(found, key=lambda q: float((self._residuals(q[None], q, wanted, 0.0) ** 2).sum()))

    def solved(self, before: Array, wanted: Array, steady: float) -> Array:
        """The pose (dof,) near the one before whose limbs point as wanted."""
        low, high = self._limits

        def poses(values: Array) -> Array:
            q: Array = np.tile(before, (len(values), 1))
            q[:, self._free] = values
            return q

        def residuals(values: Array) -> Array:
            rows: Array = self._residuals(poses(values[None]), before, wanted, steady)[0]
            return rows

        def jacobian(values: Array) -> Array:
            moved = values + np.vstack([np.zeros(len(values)), _DELTA * np.eye(len(values))])
            rows = self._residuals(poses(moved), before, wanted, steady)
            slopes: Array = (rows[1:] - rows[0]).T / _DELTA
            return slopes

        start = np.clip(before[self._free], low + 1e-6, high - 1e-6)
        answer = least_squares(residuals, start, jacobian, bounds=(low, high), x_scale=1.0, max_nfev=60)
        found: Array = poses(answer.x[None])[0]
        return found

    def _residuals(self, q: Array, before: Array, wanted: Array, steady: float) -> Array:
        """(B, R) of poses (B, dof)."""
        apart = (directions_of(_joints(self._body, q)) - wanted).reshape(len(q), -1)
        usual = _USUAL * (q - self._body.rest())[:, self._free] / self._spreads
        change = steady * (q - before)[:, self._free]
        through = _APART * self._body.collisions(q)[:, None]
        rows: Array = np.concatenate([apart, usual, change, through], axis=1)
        return rows


def _placed(poses: Array, joints: Array, body: BodyModel) -> Array:
    """The poses with the way of the hips; the lowest point of all frames lies on the floor."""
    own = _joints(body, poses)
    way = _hips(joints) * _leg(own) / _leg(joints)
    way[:, :2] -= (way[:, :2].min(axis=0) + way[:, :2].max(axis=0)) / 2
    shifts = way - _hips(own)
    shifts[:, 2] -= (_lowest(body, poses) + shifts[:, 2]).min()
    placed = poses.copy()
    placed[:, [body.names.index(f"torso_{axis}") for axis in "xyz"]] += shifts
    return placed


def _joints(body: BodyModel, poses: Array) -> Array:
    """(T, 12, 3) in the order of `JOINTS`."""
    found: Array = body.landmarks_in_world(poses)[:, [body.landmark_names.index(name) for name in JOINTS]]
    return found


def _hips(joints: Array) -> Array:
    """(T, 3) between both."""
    middle: Array = joints[:, [JOINTS.index("left_hip"), JOINTS.index("right_hip")]].mean(axis=1)
    return middle


def _leg(joints: Array) -> float:
    """Length of the left one in the first frame, metres."""
    ends = joints[0, [JOINTS.index(f"left_{joint}") for joint in ("hip", "knee", "ankle")]]
    return float(np.linalg.norm(np.diff(ends, axis=0), axis=1).sum())


def _lowest(body: BodyModel, poses: Array) -> Array:
    """(T,) height of the lowest point of the skin, or of the parts' centres."""
    placements = body.world_from_part(poses)
    if body.skin is None:
        heights: Array = placements[:, :, 2, 3].min(axis=1)
        return heights
    return np.array([body.skin.world_points(one)[:, 2].min() for one in placements])
