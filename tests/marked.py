"""A moving body as a marker system sees it: pairs of markers beside the joints of both arms."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.results.evaluation.marker_set import MarkerSet
from tracker.results.markers import Markers

JOINTS = ("left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow", "right_wrist")
HINGES = [(0, 1, 2), (3, 4, 5)]
OFFSET_S, TURN, SHIFT = (
    0.3137,
    Rotation.from_euler("zyx", [128.0, 7.0, -3.0], degrees=True).as_matrix(),
    (1.3, -0.7, 0.1),
)
NOISE_M = 0.0005
SIDES_M = 0.03
"""From a joint's centre to either marker of its pair."""


def movement(body: BodyModel, times_s: np.ndarray) -> np.ndarray:
    """(T, dof) poses: both arms swing and bend, the body leans and turns; nothing repeats."""
    q = np.tile(body.rest(), (len(times_s), 1))
    curves = {
        "torso_x": 0.2 * np.sin(0.9 * times_s),
        "torso_z": 1.0 + 0.02 * np.sin(2.1 * times_s),
        "torso_elevation": np.radians(12) * np.sin(1.3 * times_s),
        "torso_twist": np.radians(15) * times_s,
        "left_arm_elevation": np.radians(50 + 35 * np.sin(2.2 * times_s)),
        "right_arm_elevation": np.radians(40 + 35 * np.sin(1.7 * times_s + 1)),
        "left_arm_abduction": np.radians(30 + 20 * np.sin(1.1 * times_s)),
        "right_arm_abduction": np.radians(25 + 15 * np.sin(1.5 * times_s)),
        "left_arm_extension": np.radians(50 + 40 * np.sin(2.9 * times_s + 0.4 * times_s**2)),
        "right_arm_extension": np.radians(45 + 35 * np.sin(3.4 * times_s + 1 + 0.3 * times_s**2)),
    }
    for name, curve in curves.items():
        q[:, body.names.index(name)] = curve
    return q


def joints_at(body: BodyModel, times_s: np.ndarray) -> np.ndarray:
    """(T, 6, 3) m."""
    columns = [body.landmark_names.index(name) for name in JOINTS]
    return body.landmarks_in_world(movement(body, times_s))[:, columns]


def simulated(body: BodyModel, rng: np.random.Generator, rate_hz: float = 120.0) -> Markers:
    """Pairs of markers on both sides of every joint, with noise and gaps, in a world and by a clock of their own."""
    times_s = np.arange(0.0, 5.4, 1 / rate_hz)
    joints = joints_at(body, times_s - OFFSET_S)
    pairs = []
    for k in range(6):
        first = 3 * (k // 3)
        upper, lower = joints[:, first + 1] - joints[:, first], joints[:, first + 2] - joints[:, first + 1]
        hinge = np.cross(upper, lower)
        across = SIDES_M * hinge / np.linalg.norm(hinge, axis=1, keepdims=True)
        pairs += [joints[:, k] + across, joints[:, k] - across]
    points = np.stack(pairs, axis=1) @ TURN.T + SHIFT + NOISE_M * rng.normal(size=(len(times_s), 12, 3))
    points[rng.random(points.shape[:2]) < 0.03] = np.nan
    return Markers(tuple(f"M{k}" for k in range(12)), times_s, points)


SET = MarkerSet(joints={name: (f"M{2 * k}", f"M{2 * k + 1}") for k, name in enumerate(JOINTS)})
TIMES_S = np.arange(100) / 25


def turn_error_deg(rotation: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.degrees(Rotation.from_matrix(rotation @ wanted.T).magnitude()))
