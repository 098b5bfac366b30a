"""Cameras as rows of numbers that an adjustment changes."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array
from tracker.kernels.rows import bundle_camera, bundle_unknown
from tracker.kernels.rows.bundle_unknown import N_UNKNOWNS

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
"""The unknowns of a camera in the order of `tracker.kernels.rows.bundle_unknown`."""

UNITS = ("rad",) * 3 + ("m",) * 3 + ("px",) * 3 + ("",) * 7 + ("frames",)
"""Their units; the rotations are about the camera's own axes."""

STATE_COLUMNS = (-1, -1, -1, *range(bundle_camera.X, bundle_camera.K4), bundle_camera.DELAY)
"""The number of a camera's state that each of them changes; -1 for the rotations, which change nine."""

GROUPS = {
    "exterior": tuple(range(bundle_unknown.C)),
    "camera_constant": (bundle_unknown.C,),
    "principal_point": (bundle_unknown.CX, bundle_unknown.CY),
    "affinity": (bundle_unknown.AFFINITY, bundle_unknown.SHEAR),
    "radial": (bundle_unknown.K1, bundle_unknown.K2, bundle_unknown.K3),
    "decentring": (bundle_unknown.P1, bundle_unknown.P2),
    "time_offset": (bundle_unknown.DELAY,),
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
    c, x, y, affinity, shear = state[bundle_camera.INTERIOR]
    motion = np.eye(4)
    motion[:3, :3] = state[bundle_camera.ROTATION].reshape(3, 3)
    motion[:3, 3] = -motion[:3, :3] @ state[bundle_camera.CENTRE]
    matrix = np.array([[c * (1 + affinity), c * shear, x], [0.0, c, y], [0.0, 0.0, 1.0]])
    return Camera(name, size, matrix, state[bundle_camera.DISTORTION], motion)


def pinhole_of(state: Array) -> Array:
    """(3, 3) camera matrix with neither affinity nor shear, as resections start from."""
    c, x, y = state[bundle_camera.C : bundle_camera.AFFINITY]
    return np.array([[c, 0.0, x], [0.0, c, y], [0.0, 0.0, 1.0]])


def nominal_state(size: tuple[int, int], focal_px: float) -> Array:
    """(26,) a camera at the origin that looks along z, without distortion."""
    state = np.zeros(bundle_camera.N_COLUMNS)
    state[bundle_camera.ROTATION] = np.eye(3).ravel()
    state[bundle_camera.C : bundle_camera.AFFINITY] = focal_px, (size[0] - 1) / 2, (size[1] - 1) / 2
    return state


def moved(states: Array, steps: Array) -> Array:
    """States (V, 26) after a step (V, 17) of the unknowns."""
    steps = steps.reshape(-1, N_UNKNOWNS)
    result: Array = states.copy()
    turns = Rotation.from_rotvec(steps[:, bundle_unknown.TURN]).as_matrix()
    turned = turns @ states[:, bundle_camera.ROTATION].reshape(-1, 3, 3)
    result[:, bundle_camera.ROTATION] = turned.reshape(-1, 9)
    result[:, bundle_camera.X : bundle_camera.K4] += steps[:, bundle_unknown.X : bundle_unknown.DELAY]
    result[:, bundle_camera.DELAY] += steps[:, bundle_unknown.DELAY]
    return result


def rigid_motions(states: Array) -> Array:
    """(17V, 6) steps of all cameras that turn and shift the rig as a whole: the datum that images leave open."""
    n = len(states)
    motions = np.zeros((n, N_UNKNOWNS, 6))
    for v, state in enumerate(states):
        # the world turned by w: R' = R exp(-w), so that the step about the camera's axes is -R w
        motions[v, bundle_unknown.TURN, :3] = -state[bundle_camera.ROTATION].reshape(3, 3)
        x, y, z = state[bundle_camera.CENTRE]
        motions[v, bundle_unknown.CENTRE, :3] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        motions[v, bundle_unknown.CENTRE, 3:] = np.eye(3)
    return motions.reshape(-1, 6)
