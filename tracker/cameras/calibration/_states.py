"""Cameras as rows of numbers that an adjustment changes."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array
from tracker.kernels.rows import BundleCameraRow, BundleUnknowns

PARAMETERS = (
    "rotation about x",
    "rotation about y",
    "rotation about z",
    "centre x",
    "centre y",
    "centre z",
    "camera constant",
    "principal point x",
    "principal point y",
    "affinity",
    "shear",
    "radial k1",
    "radial k2",
    "decentring p1",
    "decentring p2",
    "radial k3",
    "time offset",
)
"""The unknowns of a camera in the order of `tracker.kernels.rows.BundleUnknowns`."""

UNITS = ("rad",) * 3 + ("m",) * 3 + ("px",) * 3 + ("",) * 7 + ("frames",)
"""Their units; the rotations are about the camera's own axes."""

STATE_COLUMNS = (-1, -1, -1, *range(BundleCameraRow.X, BundleCameraRow.K4), BundleCameraRow.DELAY)
"""The number of a camera's state that each of them changes; -1 for the rotations, which change nine."""

GROUPS = {
    "exterior": tuple(range(BundleUnknowns.C)),
    "camera_constant": (BundleUnknowns.C,),
    "principal_point": (BundleUnknowns.CX, BundleUnknowns.CY),
    "affinity": (BundleUnknowns.AFFINITY, BundleUnknowns.SHEAR),
    "radial": (BundleUnknowns.K1, BundleUnknowns.K2, BundleUnknowns.K3),
    "decentring": (BundleUnknowns.P1, BundleUnknowns.P2),
    "time_offset": (BundleUnknowns.DELAY,),
}
"""Parameters that are chosen together; see `ReferenceBarCalibration.estimated`."""


def state_of(camera: Camera) -> Array:
    """(26,) numbers of a camera; the affinity is (fx - fy) / fy, the shear s / fy."""
    matrix = camera.matrix
    c = matrix[1, 1]
    interior = c, matrix[0, 2], matrix[1, 2], matrix[0, 0] / c - 1, matrix[0, 1] / c
    rotation = camera.camera_from_world[:3, :3].ravel()
    return np.concatenate([rotation, camera.centre, interior, camera.distortion, [0.0]])


def camera_of(state: Array, name: str, size: tuple[int, int]) -> Camera:
    """The camera of (26,) numbers."""
    c, x, y, affinity, shear = state[BundleCameraRow.INTERIOR]
    motion = np.eye(4)
    motion[:3, :3] = state[BundleCameraRow.ROTATION].reshape(3, 3)
    motion[:3, 3] = -motion[:3, :3] @ state[BundleCameraRow.CENTRE]
    matrix = np.array([[c * (1 + affinity), c * shear, x], [0.0, c, y], [0.0, 0.0, 1.0]])
    return Camera(name, size, matrix, state[BundleCameraRow.DISTORTION], motion)


def pinhole_of(state: Array) -> Array:
    """(3, 3) camera matrix with neither affinity nor shear, as resections start from."""
    c, x, y = state[BundleCameraRow.C : BundleCameraRow.AFFINITY]
    return np.array([[c, 0.0, x], [0.0, c, y], [0.0, 0.0, 1.0]])


def nominal_state(size: tuple[int, int], focal_px: float) -> Array:
    """(26,) a camera at the origin that looks along z, without distortion."""
    state = np.zeros(BundleCameraRow.N_COLUMNS)
    state[BundleCameraRow.ROTATION] = np.eye(3).ravel()
    state[BundleCameraRow.C : BundleCameraRow.AFFINITY] = focal_px, (size[0] - 1) / 2, (size[1] - 1) / 2
    return state


def moved(states: Array, steps: Array) -> Array:
    """States (V, 26) after a step (V, 17) of the unknowns."""
    steps = steps.reshape(-1, BundleUnknowns.N_UNKNOWNS)
    result: Array = states.copy()
    turns = Rotation.from_rotvec(steps[:, BundleUnknowns.TURN]).as_matrix()
    turned = turns @ states[:, BundleCameraRow.ROTATION].reshape(-1, 3, 3)
    result[:, BundleCameraRow.ROTATION] = turned.reshape(-1, 9)
    result[:, BundleCameraRow.X : BundleCameraRow.K4] += steps[:, BundleUnknowns.X : BundleUnknowns.DELAY]
    result[:, BundleCameraRow.DELAY] += steps[:, BundleUnknowns.DELAY]
    return result


def rigid_motions(states: Array) -> Array:
    """(17V, 6) steps of all cameras that turn and shift the rig as a whole: the datum that images leave open."""
    n = len(states)
    motions = np.zeros((n, BundleUnknowns.N_UNKNOWNS, 6))
    for v, state in enumerate(states):
        # the world turned by w: R' = R exp(-w), so that the step about the camera's axes is -R w
        motions[v, BundleUnknowns.TURN, :3] = -state[BundleCameraRow.ROTATION].reshape(3, 3)
        x, y, z = state[BundleCameraRow.CENTRE]
        motions[v, BundleUnknowns.CENTRE, :3] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        motions[v, BundleUnknowns.CENTRE, 3:] = np.eye(3)
    return motions.reshape(-1, 6)
