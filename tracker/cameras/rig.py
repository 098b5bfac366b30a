"""A rig: V calibrated cameras in fixed order, and the multi-view geometry between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.triangulation import triangulate
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.errors import CalibrationError, nearest

CAMERAS = "cameras"
"""In place of an axis: the direction about which all cameras are upright."""

AXES = ("x", "y", "z", "-x", "-y", "-z")
"""Directions that may be up in the world of another program."""

# No two lenses are as near, files are rounded to less. With 1 cm, cameras 10 cm apart before a body of 20 m, which is
# started in a world eleven times smaller, were refused, and a close pair before a hand.
_ONE_PLACE_M = 1e-3

# Of two cameras the rows of the images are level about some direction, however they are held.
_LEAST_UPRIGHT = 3
# RMS sine by which rows rise: of upright cameras 0.00 to 0.02, of a room whose cameras were turned by hand 0.17.
_LEVEL = 0.07
# RMS sine between the rows of cameras that look to different sides.
_APART = 0.3


@dataclass(frozen=True)
class Rig:
    """Calibrated cameras in fixed order; the order names the views everywhere.

    Raises:
        CalibrationError: no camera, a name given twice, or two cameras at one place.
    """

    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        if not self.cameras:
            raise CalibrationError("the rig has no camera, expected at least one")
        for i, one in enumerate(self.cameras):
            for other in self.cameras[:i]:
                if one.name == other.name:
                    raise CalibrationError(f'two cameras are called "{one.name}", expected different names')
                if np.linalg.norm(one.centre - other.centre) < _ONE_PLACE_M:
                    raise CalibrationError(
                        f'cameras "{other.name}" and "{one.name}" stand at one place (closer than 1 mm): '
                        "was one calibration copied over the other?"
                    )

    @property
    def names(self) -> tuple[str, ...]:
        """Camera names in order."""
        return tuple(camera.name for camera in self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def index(self, name: str) -> int:
        """Position of the camera called `name`.

        Raises:
            CalibrationError: no such camera.
        """
        if name not in self.names:
            raise CalibrationError(f'no camera "{name}" in the rig; {nearest(name, self.names)}')
        return self.names.index(name)

    def select(self, names: tuple[str, ...]) -> Rig:
        """The rig of the named cameras, in the order of `names`."""
        return Rig(tuple(self.cameras[self.index(name)] for name in names))

    def downscaled(self, factor: float) -> Rig:
        """The rig of images averaged over `factor` x `factor` pixels, or enlarged twice, for 0.5."""
        return Rig(tuple(camera.downscaled(factor) for camera in self.cameras))

    @property
    def likely_up(self) -> str:
        """The axis of the world that points up in the images of most cameras: `z`, `-y`, ...

        Right where most cameras stand upright; of cameras on their side it says nothing.
        """
        upwards = np.median([-camera.camera_from_world[1, :3] for camera in self.cameras], axis=0)
        axis = int(np.argmax(np.abs(upwards)))
        return ("-" if upwards[axis] < 0 else "") + "xyz"[axis]

    @property
    def probable_up(self) -> Array:
        """(3,) direction of the world that is up as far as the cameras tell: `held_up`, else the axis `likely_up`."""
        return _axis(self.likely_up) if self.held_up is None else self.held_up

    @cached_property
    def held_up(self) -> Array | None:
        """(3,) direction of the world about which all cameras are upright, as tripods hold them; None if there is none.

        Three cameras or more that look to different sides tell it, however they are tilted: the rows of their images
        are level then.
        """
        rows = np.stack([camera.camera_from_world[0, :3] for camera in self.cameras])
        shares, axes = np.linalg.eigh(rows.T @ rows / len(rows))
        if len(rows) < _LEAST_UPRIGHT or shares[0] > _LEVEL**2 or shares[1] < _APART**2:
            return None
        upwards = -np.sum([camera.camera_from_world[1, :3] for camera in self.cameras], axis=0)
        return frozen(axes[:, 0] * np.sign(axes[:, 0] @ upwards))

    @cached_property
    def middle(self) -> Array:
        """(3,) point nearest to all viewing axes, metres; 3 m before the cameras if they are parallel."""
        axes = np.stack([camera.camera_from_world[2, :3] for camera in self.cameras])
        centres = np.stack([camera.centre for camera in self.cameras])
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        if np.linalg.cond(across.sum(axis=0)) > 1e3:
            return frozen(centres.mean(axis=0) + 3.0 * axes.mean(axis=0))
        return frozen(np.linalg.solve(across.sum(axis=0), np.einsum("vij,vj->i", across, centres)))

    def with_up(self, up: str, floor_m: float = 0.0) -> Rig:
        """The rig in a world whose z axis is up.

        Args:
            up: the axis that is up in this one, one of `AXES`; what is level there is turned as little as can be.
                "cameras": the direction about which all of them are upright, `held_up`.
            floor_m: where the floor is along it, metres; z is 0 there.

        Raises:
            CalibrationError: no such axis.
        """
        if up not in (*AXES, CAMERAS):
            raise CalibrationError(f'"{up}" is no axis that can be up; {nearest(up, (*AXES, CAMERAS))}')
        if up == CAMERAS and self.held_up is None:
            raise CalibrationError(
                'up = "cameras": no direction about which all cameras are upright, expected three that look to '
                "different sides; name an axis"
            )
        return self.standing(_axis(up) if self.held_up is None or up != CAMERAS else self.held_up, floor_m)

    def standing(self, up: Array, floor_m: float = 0.0) -> Rig:
        """The rig in a world whose z axis is up, turned as little as can be.

        Args:
            up: (3,) unit vector that is up in this one.
            floor_m: where the floor is along it, metres; z is 0 there.
        """
        new_from_old = np.eye(4)
        new_from_old[:3, :3] = _least_turn(up)
        new_from_old[2, 3] = -floor_m
        old_from_new = np.linalg.inv(new_from_old)
        return Rig(tuple(replace(one, camera_from_world=one.camera_from_world @ old_from_new) for one in self.cameras))

    def project(self, points: Array) -> Array:
        """World points (..., 3) to pixels in all views (V, ..., 2)."""
        return np.stack([camera.project(points) for camera in self.cameras])

    def triangulate(self, pixels: Array, sigma_px: float = 1.0) -> tuple[Array, Array]:
        """Points from their images in two or more views.

        Args:
            pixels: (V, N, 2), NaN where a view does not show the point.
            sigma_px: standard deviation of an image coordinate.

        Returns:
            World points (N, 3) metres and their covariances (N, 3, 3) m^2; NaN with fewer than two views.
        """
        return triangulate(self.cameras, pixels, sigma_px)

    def epipolar_line(self, pixel: Array, source: int, target: int, n_points: int = 64) -> Array:
        """Image in view `target` of the viewing ray of a pixel in view `source`.

        Args:
            pixel: (2,) px in the source view.
            source: index of the view the pixel is in.
            target: index of the view to draw in.
            n_points: samples along the ray, from 0.3 to 30 m, spaced evenly in inverse depth.

        Returns:
            (M, 2) px, only points in front of the target camera; a curve where the lens distorts.
        """
        camera = self.cameras[source]
        ray = camera.rays(np.asarray(pixel, dtype=np.float64))
        depths = 1 / np.linspace(1 / 0.3, 1 / 30.0, n_points)
        line = self.cameras[target].project(camera.centre + depths[:, None] * ray)
        return line[np.isfinite(line).all(axis=1)]

    @cached_property
    def packed(self) -> Array:
        """(V, 29) one row a camera for compiled kernels; `tracker.kernels.rows.CameraRow` names the columns."""
        rows = [
            np.concatenate(
                [
                    camera.camera_from_world[:3].ravel(),
                    camera.centre,
                    camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]],
                    camera.distortion[:5],
                    camera.matrix[0, 1:2],
                    camera.distortion[5:],
                    [camera.reach**2],
                ]
            )
            for camera in self.cameras
        ]
        return frozen(rows)

    @cached_property
    def sizes(self) -> Array:
        """(V, 2) image widths and heights, px."""
        return frozen([camera.size for camera in self.cameras])


def _axis(name: str) -> Array:
    """(3,) unit vector of an axis, for instance `-y`."""
    axis: Array = np.eye(3)["xyz".index(name[-1])]
    return -axis if name[0] == "-" else axis


def _least_turn(up: Array) -> Array:
    """(3, 3) smallest rotation that takes a unit vector to z (Rodrigues); a half turn about x for -z."""
    across, along = np.cross(up, (0.0, 0.0, 1.0)), float(up[2])
    if along < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = across
    skew = np.array([[0.0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: Array = np.eye(3) + skew + skew @ skew / (1 + along)
    return turn
