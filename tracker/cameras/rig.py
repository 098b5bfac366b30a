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

# No two lenses are as near, files are rounded to less. With 1 cm, cameras 10 cm apart before a body of 20 m, whose
# start uses a world eleven times smaller, were refused, and a close pair before a hand.
_ONE_PLACE_M = 1e-3

# For two cameras the rows of the images are level about some direction in any case.
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
        """(3,) upward direction of the world, as far as the cameras show it: `held_up`, else the axis `likely_up`."""
        return _axis(self.likely_up) if self.held_up is None else self.held_up

    @cached_property
    def held_up(self) -> Array | None:
        """(3,) direction of the world about which all cameras are upright, as tripods hold them; None if there is none.

        Three cameras or more that look to different sides show it, at any tilt: the rows of their images are level
        then.
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


# The world that a rig brings with it: which way is up, and where the floor is on which persons are looked for.

_SURELY_UP = 0.75
"""Share of a whole vector that the mean of the cameras' up directions has, to be taken for the world's up."""

_LEAST_UP = 0.3
"""Vertical share of the up direction of most cameras, below which they are held sideways, or z is not up."""

_TURNED_DEG = 15.0
"""Angle between z and the cameras' upward direction from which on a warning is given. Well-calibrated rooms have 0 to
12, a desk whose board lay obliquely in the first picture 28."""

_BELOW_M = 0.1
"""A lens lower than this is below a floor that is really there."""

_LOW_M = 0.2
"""Height of the point that the cameras face, too low for persons: they face 0.6 to 1.3 m, a desk whose board is the
world's origin 0.07 m."""


# See docs/lab/facing.md.
_OPPOSITE_DEG = 135.0
"""Angle from which on two cameras see a scene from opposite sides: at 150 degrees persons were begun turned round."""


def told_world(rig: Rig) -> str:
    """One line: where the calibration has the floor, and the cameras above it."""
    heights = [float(camera.centre[2]) for camera in rig.cameras]
    return (
        f"the calibration's world: z is up, the floor z = 0; cameras stand {min(heights):.2f} to {max(heights):.2f} m "
        f"above it and look at a place {float(rig.middle[2]):.2f} m above it"
    )


def world_doubts(rig: Rig) -> tuple[str, ...]:
    """Warnings about the world of a rig, in one line each, with the command that corrects it."""
    if up := _up_doubt(rig):
        return (up,)
    turned = _turned_doubt(rig)
    floor = _floor_doubt(rig.with_up(CAMERAS) if turned else rig, f" --up {CAMERAS}" if turned else "")
    return tuple(filter(None, (turned, floor, _opposite_doubt(rig))))


def _up_doubt(rig: Rig) -> str:
    """Warning that another axis than z is up; with a question mark if only the images show it."""
    upwards = np.array([-camera.camera_from_world[1, :3] for camera in rig.cameras])
    mean, likely = upwards.mean(axis=0), rig.likely_up
    turn = (
        f"`bodytrack rig convert THIS rig.toml --up {likely} --floor Z` turns it, Z is where the floor is on that axis"
    )
    hung = ", or hang upside down" if likely == "-z" else ""
    if likely != "z" and np.abs(mean).max() > _SURELY_UP:
        return (
            f"the cameras are upright with the rig's {likely} axis up, expected z{hung}: the search would expect "
            f"persons lying; {turn}"
        )
    if np.median(upwards[:, 2]) < _LEAST_UP:
        what = f"is the world's z axis up? If {likely} is: {turn}" if likely != "z" else "is the world's z axis up?"
        return f"most cameras are tilted or upside down: {what}"
    return ""


def _turned_doubt(rig: Rig) -> str:
    up = rig.held_up
    turned_deg = 0.0 if up is None else float(np.degrees(np.arccos(np.clip(up[2], -1, 1))))
    if turned_deg < _TURNED_DEG:
        return ""
    return (
        f"the rig is turned: all cameras are upright about a direction {turned_deg:.0f} degrees off its z axis; did "
        "the board that is the world's origin lie obliquely? The search would expect persons leaning: "
        f"`bodytrack rig convert THIS rig.toml --up {CAMERAS}` turns it"
    )


def _floor_doubt(rig: Rig, turn: str) -> str:
    low = min(rig.cameras, key=lambda camera: float(camera.centre[2]))
    height_m, looked_at_m = float(low.centre[2]), float(rig.middle[2])
    if height_m >= -_BELOW_M and looked_at_m >= _LOW_M:
        return ""
    found = (
        f"{low.name} is {-height_m:.2f} m below the floor: is z up and the origin on it?"
        if height_m < -_BELOW_M
        else f"the cameras look at a place {looked_at_m:.2f} m above the floor: is the origin on it?"
    )
    return (
        f"{found} The search for persons uses z = 0. If the floor is lower, measure how high the lens of {low.name} is "
        f"above it, in metres: `bodytrack rig convert THIS rig.toml{turn} --floor Z`, where Z is {height_m:.2f} less "
        "that height"
    )


def opposite_deg(rig: Rig) -> float:
    """How far apart the only two cameras stand that face each other, seen from between them, degrees; 0 where none do.

    What they see of a person is nearly mirrored: they do not tell who faces where.
    """
    if len(rig) != 2:
        return 0.0
    one, other = (camera.centre - rig.middle for camera in rig.cameras)
    apart_deg = np.degrees(np.arccos(np.clip(one @ other / np.linalg.norm(one) / np.linalg.norm(other), -1, 1)))
    return float(apart_deg) if apart_deg >= _OPPOSITE_DEG else 0.0


def _opposite_doubt(rig: Rig) -> str:
    """That the only two cameras face each other."""
    apart_deg = opposite_deg(rig)
    if not apart_deg:
        return ""
    return (
        f"{' and '.join(rig.names)} face each other, {apart_deg:.0f} degrees apart: their outlines are nearly the same "
        "and hardly tell who faces where; look at the overlay, and film at 60 to 120 degrees, or with a third camera"
    )


# How high persons are shown, as the cameras alone tell, and how much smaller or larger images should be for that.

# See docs/lab/filmed_otherwise.md.
KEPT_PX = 300.0
"""Height that persons keep in images that are averaged, px. Search ranges for edges and limits of errors are in pixels,
chosen on images that show persons some 270 px high. A rendered jump of a woman shown at least 620 px high was tracked
26 mm off (16 with offsets removed), and 14 (6) at half the size, in a seventh of the time."""

SMALL_PX = 200.0
"""Images are enlarged twice where persons are less high. 140 px high a dance and getting up were tracked 25 mm (19) and
26 mm (21) off, with a joint off in 16 of 140 frames; the same images enlarged: 18 (11), 19 (12), and none."""

_MOST_ENLARGED = 4e6
"""Pixels that enlarged images may have: time and memory grow with them."""

_LEAST_SIDE_PX = 480
"""Shorter side that images keep: cameras close by show parts of persons."""

_STATURE_M = 1.7
"""Stature of a person: the filmed person is not known yet, and a child's images are averaged no further."""


def shown_px(rig: Rig) -> float:
    """Height of a person who stands upright where the axes of the cameras meet, in the view that shows it smallest.

    Args:
        rig: the cameras; views that have the place behind them have no say.

    Returns:
        px; 0 where no view has it before it.
    """
    depths = np.array([camera.in_camera(rig.middle)[2] for camera in rig.cameras])
    focal_px = np.array([camera.matrix[1, 1] for camera in rig.cameras])
    before = depths > 0
    return float((_STATURE_M * focal_px[before] / depths[before]).min()) if before.any() else 0.0


def fitting_downscale(rig: Rig) -> float:
    """Pixels in both directions that one may average for tracking persons; 1 for as recorded, 0.5 for twice as large.

    Args:
        rig: the cameras of the images as recorded.
    """
    largest = max(camera.size[0] * camera.size[1] for camera in rig.cameras)
    if 0 < shown_px(rig) < SMALL_PX and 4 * largest <= _MOST_ENLARGED:
        return 0.5
    shorter_px = min(min(camera.size) for camera in rig.cameras)
    return max(1, int(min(shown_px(rig) / KEPT_PX, shorter_px / _LEAST_SIDE_PX)))
