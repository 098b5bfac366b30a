"""Objects seen in a calibration: bars of known length, boards of known shape, points of known position.

Each object has six unknowns; see `tracker.kernels.adjustment`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.kernels.adjustment import N_OBJECT
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


class CalibrationObjects(Protocol):
    """Objects in space with points that the cameras see."""

    @property
    def points(self) -> Array:
        """(P, 3) world positions, metres, those of an object one after another."""
        ...

    @property
    def owners(self) -> Integers:
        """(P,) the object that each point belongs to."""
        ...

    @property
    def slopes(self) -> Array:
        """(P, 3, 6) derivative of the points by the unknowns of their object."""
        ...

    @property
    def fixes_datum(self) -> bool:
        """Whether positions are known in the world, so that the cameras cannot move as a whole."""
        ...

    def determined(self, counted: Integers) -> Mask:
        """(P,) points with enough images, `counted` (P,) of each; other points say nothing."""
        ...

    def conditions(self, counted: Integers) -> tuple[Array, Array, Array]:
        """Knowledge of the objects beside their images.

        Args:
            counted: (P,) number of views that observe each point.

        Returns:
            Normal matrices (G, 6, 6), right sides (G, 6), and the weighted residuals of the conditions (K,), each
            divided by its standard deviation. Unknowns that nothing determines have a unit matrix.
        """
        ...

    def n_unknowns(self, counted: Integers) -> int:
        """Number of unknowns that the observations determine."""
        ...

    def moved(self, steps: Array) -> CalibrationObjects:
        """The objects after a step (G, 6) of their unknowns."""
        ...

    def in_world(self, motion: Array) -> CalibrationObjects:
        """The objects in another frame, which a motion (4, 4) leads to."""
        ...


@dataclass(frozen=True)
class Bars:
    """Positions of a reference bar, whose two targets are a known distance apart (Maas 1998)."""

    ends: Array
    """(G, 2, 3) metres."""

    length_m: float
    sigma_m: float
    """Standard deviation of the length, metres."""

    @property
    def points(self) -> Array:
        """(2G, 3) ends."""
        return self.ends.reshape(-1, 3)

    @property
    def owners(self) -> Integers:
        """Two points a bar."""
        return np.repeat(np.arange(len(self.ends)), 2)

    @property
    def slopes(self) -> Array:
        """The unknowns are the coordinates of the ends."""
        one = np.eye(N_OBJECT).reshape(2, 3, N_OBJECT)
        return np.ascontiguousarray(np.broadcast_to(one, (len(self.ends), 2, 3, N_OBJECT))).reshape(-1, 3, N_OBJECT)

    @property
    def fixes_datum(self) -> bool:
        """Bars give only the scale."""
        return False

    def determined(self, counted: Integers) -> Mask:
        """Ends seen from two views."""
        return np.asarray(counted >= 2)

    def conditions(self, counted: Integers) -> tuple[Array, Array, Array]:
        """The length of every bar with both ends observed."""
        determined = self.determined(counted).reshape(-1, 2)
        whole: Mask = np.asarray(determined.all(axis=1))
        along = self.ends[:, 1] - self.ends[:, 0]
        length: Array = np.asarray(np.linalg.norm(along, axis=1))
        unit = along / np.maximum(length, 1e-12)[:, None]
        slope = np.concatenate([-unit, unit], axis=1) * (whole / self.sigma_m)[:, None]
        residual: Array = np.where(whole, self.length_m - length, 0.0) / self.sigma_m
        normal = slope[:, :, None] * slope[:, None, :]
        normal += np.repeat(~determined, 3, axis=1)[:, :, None] * np.eye(N_OBJECT)
        return normal, slope * residual[:, None], residual[np.asarray(whole)]

    def n_unknowns(self, counted: Integers) -> int:
        """Three for each end seen from two views."""
        return 3 * int(self.determined(counted).sum())

    def moved(self, steps: Array) -> Bars:
        """The ends shifted."""
        return replace(self, ends=self.ends + steps.reshape(-1, 2, 3))

    def in_world(self, motion: Array) -> Bars:
        """The ends moved."""
        return replace(self, ends=transformed(motion, self.ends))

    @property
    def lengths(self) -> Array:
        """(G,) metres."""
        lengths: Array = np.asarray(np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1))
        return lengths


@dataclass(frozen=True)
class Boards:
    """Poses of a board of known shape."""

    shape: Array
    """(P, 3) points in the board's own frame, metres, for every point of every pose."""

    owners: Integers
    """(P,) pose that each point belongs to, ascending."""

    poses: Array
    """(G, 4, 4) world_from_board."""

    @property
    def points(self) -> Array:
        """(P, 3) in the world."""
        return self._turned + self.poses[self.owners, :3, 3]

    @property
    def _turned(self) -> Array:
        turned: Array = np.einsum("pij,pj->pi", self.poses[self.owners, :3, :3], self.shape)
        return turned

    @property
    def slopes(self) -> Array:
        """The unknowns are a rotation about the board's origin and a shift."""
        x, y, z = self._turned.T
        slopes = np.zeros((len(x), 3, N_OBJECT))
        slopes[:, 0, 1], slopes[:, 0, 2], slopes[:, 1, 2] = z, -y, x
        slopes[:, 1, 0], slopes[:, 2, 0], slopes[:, 2, 1] = -z, y, -x
        slopes[:, :, 3:] = np.eye(3)
        return slopes

    @property
    def fixes_datum(self) -> bool:
        """Boards give only the scale."""
        return False

    def _posed(self, counted: Integers) -> Mask:
        """(G,) poses with images of four points, from one view on: those of three fit any camera."""
        return np.asarray(np.bincount(self.owners, counted > 0, minlength=len(self.poses)) >= 4)

    def determined(self, counted: Integers) -> Mask:
        """Corners of a board that shows four or more."""
        return self._posed(counted)[self.owners]

    def conditions(self, counted: Integers) -> tuple[Array, Array, Array]:
        """None."""
        n = len(self.poses)
        normal = np.where(self._posed(counted), 0.0, 1.0)[:, None, None] * np.eye(N_OBJECT)
        return normal, np.zeros((n, N_OBJECT)), np.zeros(0)

    def n_unknowns(self, counted: Integers) -> int:
        """Six for each pose."""
        return N_OBJECT * int(self._posed(counted).sum())

    def moved(self, steps: Array) -> Boards:
        """The boards turned and shifted."""
        poses = self.poses.copy()
        poses[:, :3, :3] = Rotation.from_rotvec(steps[:, :3]).as_matrix() @ poses[:, :3, :3]
        poses[:, :3, 3] += steps[:, 3:]
        return replace(self, poses=poses)

    def in_world(self, motion: Array) -> Boards:
        """The poses moved."""
        return replace(self, poses=motion @ self.poses)


@dataclass(frozen=True)
class MeasuredPoints:
    """Points with measured positions, each with the same standard deviation in every direction."""

    positions: Array
    """(P, 3) metres, as adjusted."""

    measured: Array
    """(P, 3) metres."""

    sigma_m: float

    @property
    def points(self) -> Array:
        """(P, 3) as adjusted."""
        return self.positions

    @property
    def owners(self) -> Integers:
        """Every point is an object."""
        return np.arange(len(self.positions))

    @property
    def slopes(self) -> Array:
        """The unknowns are the coordinates; the other three are not used."""
        return np.tile(np.eye(3, N_OBJECT), (len(self.positions), 1, 1))

    @property
    def fixes_datum(self) -> bool:
        """Their positions are those of the world."""
        return True

    def determined(self, counted: Integers) -> Mask:
        """All: they were measured."""
        return np.ones(len(self.positions), dtype=np.bool_)

    def conditions(self, counted: Integers) -> tuple[Array, Array, Array]:
        """The measured coordinates."""
        seen: Mask = counted > 0
        residual = (self.measured - self.positions) / self.sigma_m
        weights = np.where(seen, self.sigma_m**-2, 1.0)
        normal = np.tile(np.eye(N_OBJECT), (len(seen), 1, 1))
        normal[:, :3, :3] *= weights[:, None, None]
        side = np.zeros((len(seen), N_OBJECT))
        side[:, :3] = np.where(seen[:, None], residual / self.sigma_m, 0.0)
        return normal, side, residual[seen].ravel()

    def n_unknowns(self, counted: Integers) -> int:
        """Three for each observed point."""
        return 3 * int((counted > 0).sum())

    def moved(self, steps: Array) -> MeasuredPoints:
        """The points shifted."""
        return replace(self, positions=self.positions + steps[:, :3])

    def in_world(self, motion: Array) -> MeasuredPoints:
        """The points moved, those measured as well."""
        moved = transformed(motion, self.positions), transformed(motion, self.measured)
        return MeasuredPoints(*moved, self.sigma_m)


def transformed(motion: Array, points: Array) -> Array:
    """Points (..., 3) after a rigid motion (4, 4)."""
    result: Array = points @ motion[:3, :3].T + motion[:3, 3]
    return result
