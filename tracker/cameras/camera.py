"""A calibrated camera: pinhole with radial and decentring distortion, or a wide lens's rational radial one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import rq
from scipy.spatial.transform import Rotation

from tracker.cameras.lens import FARTHEST_DEG, Lens
from tracker.foundation.arrays import Array, frozen, shape_fault
from tracker.foundation.errors import CalibrationError, name_fault

_PLUMB = 0.2
"""Length of the vertical in the image plane below which no side of the image is the upper one: 12 degrees off it."""


@dataclass(frozen=True)
class Camera:
    """One calibrated view, in OpenCV's convention: x right, y down, z forward.

    A point is imaged by ``x = camera_from_world X``, ``u = x/z, v = y/z``, distortion, ``matrix``;
    pixel centres lie at integer coordinates.

    Raises:
        CalibrationError: a value that no camera can have, with the reason.
    """

    name: str
    size: tuple[int, int]
    """Image width and height, px."""

    matrix: Array
    """(3, 3) intrinsic matrix, px; affinity and shear are in its first row."""

    distortion: Array
    """(8,) k1 k2 p1 p2 k3 k4 k5 k6, OpenCV's order; k4 k5 k6 are the denominator of the radial distortion and 0 except
    for wide lenses. 4 or 5 numbers are followed by zeros."""

    camera_from_world: Array
    """(4, 4) rigid motion, metres."""

    downscale: float = 1
    """Pixels of the recorded image, in both directions, that one of these averages; 0.5 of enlarged ones."""

    def __post_init__(self) -> None:
        if self.name and (unfit := name_fault(self.name)):  # one that is being calibrated may have none yet
            raise CalibrationError(f"camera {unfit}")
        lens = np.asarray(self.distortion, dtype=np.float64)
        if lens.shape in ((4,), (5,)):
            object.__setattr__(self, "distortion", np.pad(lens, (0, 8 - len(lens))))
        for field, shape in (("matrix", (3, 3)), ("distortion", (8,)), ("camera_from_world", (4, 4))):
            values = frozen(getattr(self, field))
            if fault := shape_fault(values, *shape):
                raise CalibrationError(f'camera "{self.name}": {field}: {fault}')
            if not np.isfinite(values).all():
                raise CalibrationError(f'camera "{self.name}": {field} has values that are not finite')
            object.__setattr__(self, field, values)
        self._check_intrinsics()
        self._check_rotation()

    def _check_intrinsics(self) -> None:
        width, height = self.size
        if width < 1 or height < 1:
            raise CalibrationError(f'camera "{self.name}": image size {width}x{height} px, expected at least 1x1')
        fx, fy = self.matrix[0, 0], self.matrix[1, 1]
        if fx <= 0 or fy <= 0:
            raise CalibrationError(f'camera "{self.name}": focal length {fx:g}, {fy:g} px, expected positive')
        if abs(self.matrix[2] - (0, 0, 1)).max() > 1e-9 or abs(self.matrix[1, 0]) > 1e-9:
            raise CalibrationError(
                f'camera "{self.name}": intrinsic matrix is not [[fx, s, cx], [0, fy, cy], [0, 0, 1]]'
            )
        cx, cy = self.matrix[0, 2], self.matrix[1, 2]
        if not (-width < cx < 2 * width and -height < cy < 2 * height):
            raise CalibrationError(
                f'camera "{self.name}": principal point ({cx:g}, {cy:g}) px is far outside the '
                f"{width}x{height} image: calibrated at another image size?"
            )

    def _check_rotation(self) -> None:
        rotation = self.camera_from_world[:3, :3]
        fault = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if fault > 1e-4 or np.linalg.det(rotation) < 0:
            raise CalibrationError(
                f'camera "{self.name}": the exterior orientation is not a rotation '
                f"(R R^T differs from the unit matrix by {fault:.2g}, det R = {np.linalg.det(rotation):.3f})"
            )
        if np.abs(self.camera_from_world[3] - (0, 0, 0, 1)).max() > 1e-12:
            raise CalibrationError(f'camera "{self.name}": last row of camera_from_world is not 0 0 0 1')

    @property
    def centre(self) -> Array:
        """(3,) projection centre in the world, metres."""
        rotation, translation = self.camera_from_world[:3, :3], self.camera_from_world[:3, 3]
        centre: Array = -rotation.T @ translation
        return centre

    @property
    def told_distortion(self) -> Array:
        """(5,) or (8,) the distortion as files have it: without a denominator that is 1."""
        return self.distortion if self.distortion[5:].any() else self.distortion[:5]

    @cached_property
    def _lens(self) -> Lens:
        return Lens(self.distortion)

    @property
    def reach(self) -> float:
        """Distance from the axis, in the plane z = 1, up to which the lens images anything; inf if it has no end."""
        return self._lens.reach

    @cached_property
    def turns_back_px(self) -> float | None:
        """Distance from the principal point at which the distortion turns back, px; None if outside the image."""
        return self.inside_px(self._lens.turns_back)

    def inside_px(self, distance: float) -> float | None:
        """Distance from the principal point of the image of a distance from the axis, px; None if outside."""
        width, height = self.size
        corners = np.array([(0.0, 0.0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)])
        straight = (corners - self.matrix[:2, 2]) @ np.linalg.inv(self.matrix[:2, :2]).T
        farthest = float(np.linalg.norm(straight, axis=1).max())
        end = self._lens.imaged(distance) if np.isfinite(distance) else np.inf
        return float(end * self.matrix[0, 0]) if end <= farthest else None

    def in_camera(self, points: Array) -> Array:
        """World points (..., 3) in camera coordinates (..., 3), metres."""
        moved: Array = points @ self.camera_from_world[:3, :3].T + self.camera_from_world[:3, 3]
        return moved

    def project(self, points: Array) -> Array:
        """World points (..., 3) metres to pixels (..., 2); NaN behind the camera, and beyond its `reach`."""
        local = self.in_camera(np.asarray(points, dtype=np.float64))
        depth = np.where(local[..., 2:] > 1e-9, local[..., 2:], np.nan)
        plane = local[..., :2] / depth
        if np.isfinite(self.reach):
            beyond = np.linalg.norm(plane, axis=-1, keepdims=True) > self.reach
            plane = np.where(beyond, np.nan, plane)
        pixels: Array = self._lens.distorted(plane) @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        return pixels

    def project_jacobian(self, points: Array) -> Array:
        """Derivative of `project`: points (..., 3) to (..., 2, 3), px per metre."""
        local = self.in_camera(np.asarray(points, dtype=np.float64))
        depth = local[..., 2]
        plane = local[..., :2] / depth[..., None]
        _, slope = self._lens.distort(plane)
        perspective = np.zeros((*depth.shape, 2, 3))
        perspective[..., 0, 0] = perspective[..., 1, 1] = 1 / depth
        perspective[..., :, 2] = -plane / depth[..., None]
        derivative: Array = self.matrix[:2, :2] @ slope @ perspective @ self.camera_from_world[:3, :3]
        return derivative

    def undistort(self, pixels: Array, clamped: bool = False) -> Array:
        """Pixels (..., 2) to the plane z = 1, undistorted (..., 2); beyond its `reach` NaN, or its end if `clamped`."""
        imaged = (np.asarray(pixels, dtype=np.float64) - self.matrix[:2, 2]) @ np.linalg.inv(self.matrix[:2, :2]).T
        return self._lens.undistort_clamped(imaged) if clamped else self._lens.undistort(imaged)

    def rays(self, pixels: Array, clamped: bool = False) -> Array:
        """Unit viewing directions in the world (..., 3) of pixels (..., 2); see `undistort`."""
        plane = self.undistort(pixels, clamped)
        local = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        directions: Array = local @ self.camera_from_world[:3, :3]
        return directions

    def downscaled(self, factor: float) -> Camera:
        """The camera of images averaged over `factor` x `factor` pixels, or enlarged twice, for 0.5."""
        matrix = np.array(self.matrix)
        matrix[:2] /= factor
        matrix[:2, 2] += (1 / factor - 1) / 2
        size = int(self.size[0] // factor), int(self.size[1] // factor)
        return replace(self, matrix=matrix, size=size, downscale=self.downscale * factor)

    def turned(self, quarters: int) -> Camera:
        """The camera of the images turned clockwise by so many quarter turns."""
        camera = self
        for _ in range(quarters % 4):
            width, height = camera.size
            clockwise = np.array([[0.0, -1, height - 1], [1, 0, 0], [0, 0, 1]])
            orientation = upper_triangular(clockwise @ camera.matrix, camera.distortion, camera.camera_from_world)
            camera = Camera(camera.name, (height, width), *orientation, camera.downscale)
        return camera

    @property
    def field_deg(self) -> tuple[float, float]:
        """Angles between the middles of the image's left and right, and of its upper and lower side."""
        width, height = self.size
        sides = np.array([(0, height / 2), (width - 1, height / 2), (width / 2, 0), (width / 2, height - 1)])
        rays = self.rays(sides, clamped=True)
        across, down = (float(np.degrees(np.arccos(np.clip(rays[k] @ rays[k + 1], -1, 1)))) for k in (0, 2))
        return across, down

    @property
    def quarters_to_upright(self) -> int:
        """Clockwise quarter turns after which the images stand upright; 0 if the camera looks straight up or down."""
        right, down = self.camera_from_world[:2, 2]
        if np.hypot(right, down) < _PLUMB:
            return 0
        return int(np.argmax([-down, -right, down, right]))

    @staticmethod
    def looking_at(
        name: str, size: tuple[int, int], focal_px: float, position: tuple[float, float, float], target: Array
    ) -> Camera:
        """A distortion-free camera at `position` (m) with `target` (3,) in the image centre, z up."""
        forward = np.asarray(target) - position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        motion = np.eye(4)
        motion[:3, :3] = right, np.cross(forward, right), forward
        motion[:3, 3] = -motion[:3, :3] @ np.asarray(position)
        centre = (size[0] - 1) / 2, (size[1] - 1) / 2
        matrix = np.array([[focal_px, 0, centre[0]], [0, focal_px, centre[1]], [0, 0, 1]])
        return Camera(name, size, matrix, np.zeros(5), motion)

    def rotation_vector(self) -> Array:
        """(3,) Rodrigues vector of the exterior orientation."""
        # cv2.Rodrigues loses up to 1e-5 rad near 0 and 180 degrees
        return np.asarray(Rotation.from_matrix(self.camera_from_world[:3, :3]).as_rotvec(), dtype=np.float64)


def upper_triangular(matrix: Array, distortion: Array, motion: Array) -> tuple[Array, Array, Array]:
    """The same imaging with an intrinsic matrix [[fx, s, cx], [0, fy, cy], [0, 0, 1]].

    The rest of the matrix is a turn about the optical axis, which goes to the exterior orientation. Decentring
    displaces a point x by |x|^2 d + 2 (d.x) x with d = (p2, p1), so that d turns with the plane.

    Args:
        matrix: (3, 3) with last row 0 0 1.
        distortion: (4 or more,) beginning with k1 k2 p1 p2.
        motion: (4, 4) camera_from_world.

    Returns:
        Matrix, distortion and camera_from_world.
    """
    upper, turn = rq(matrix)
    signs = np.diag(np.sign(np.diag(upper)))
    upper, turn = upper @ signs, signs @ turn
    p2, p1 = turn[:2, :2] @ distortion[[3, 2]]
    turned = np.array(motion)
    turned[:3] = turn @ motion[:3]
    lens = np.array(distortion)
    lens[[2, 3]] = p1, p2
    return np.asarray(upper / upper[2, 2]), lens, turned


_LARGEST = 1e6
"""Largest coefficient of the polynomial: a lens has some hundredths."""

_MOST_OFF_PX = 0.2
"""Tolerance between both models inside the image: what good calibrations leave."""

_BEYOND = 1e-3
"""Weight of directions outside of the image, where the polynomial is an extrapolation."""

_ROUNDS = 20
"""Rounds of weighting: the quotient is fitted by its numerator, which its denominator stretches."""


def rational_of(name: str, size: tuple[int, int], matrix: Array, fisheye: Array) -> Array:
    """The distortion (8,) of a `Camera` that images as a fisheye lens does.

    Args:
        name: of the camera, for messages.
        size: image width and height, px.
        matrix: (3, 3) intrinsic matrix of a `Camera`.
        fisheye: (4,) k1 k2 k3 k4 of OpenCV's fisheye model.

    Raises:
        CalibrationError: the lens images two directions in one place inside the image, no quotient is near it, or
            a number is none of a lens.
    """
    if np.abs(fisheye).max() > _LARGEST:
        raise CalibrationError(
            f'camera "{name}": fisheye distortion {fisheye.tolist()} found, expected numbers below {_LARGEST:g}'
        )
    angles = np.radians(np.linspace(0.1, FARTHEST_DEG, 1500))
    bent, end = _bent(name, size, matrix, fisheye, angles)
    inside, planes = angles <= end, np.tan(angles)
    lens = _fitted(planes, bent, np.where(inside, 1.0, _BEYOND))
    across = np.stack([planes[inside], np.zeros(inside.sum())], axis=-1)
    found = Lens(lens).distorted(across)[:, 0]
    off_px = float(matrix[0, 0]) * np.abs(found - bent[inside]).max()
    if not (off_px <= _MOST_OFF_PX and (np.diff(found) > 0).all()):
        raise CalibrationError(
            f'camera "{name}": a fisheye lens that no quotient of polynomials follows ({off_px:.2g} px off, at most '
            f"{_MOST_OFF_PX:g} expected): is it OpenCV's fisheye model? Else undistort the images first"
        )
    return lens


def told_end(camera: Camera) -> str | None:
    """Warning about a wide lens that ends inside the image; None for others."""
    lens = Lens(camera.distortion)
    end_px = camera.inside_px(lens.reach) if lens.reach < lens.turns_back else None
    if end_px is None:
        return None
    return (
        f'camera "{camera.name}": its lens is known to {FARTHEST_DEG:.0f} degrees from the axis, {end_px:.0f} px from '
        "the principal point, inside the image: what is farther out does not count"
    )


def _bent(name: str, size: tuple[int, int], matrix: Array, fisheye: Array, angles: Array) -> tuple[Array, float]:
    """Distances from the axis at which directions are imaged, in focal lengths, and the angle that the corners show.

    If the polynomial turns back outside of the image it is continued straight.
    """
    squares = angles**2
    k1, k2, k3, k4 = fisheye
    bent = angles * (1 + squares * (k1 + squares * (k2 + squares * (k3 + squares * k4))))
    corners = np.array([(x, y) for x in (0, size[0] - 1) for y in (0, size[1] - 1)], dtype=np.float64)
    farthest = np.linalg.norm((corners - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T, axis=1).max()
    # the image ends where its farthest corner is reached
    end = int(np.argmax(bent >= farthest)) if (bent >= farthest).any() else len(bent) - 1
    slopes = np.gradient(bent, angles)
    if (slopes[: end + 1] <= 0).any():
        raise CalibrationError(
            f'camera "{name}": its fisheye lens images two directions in one place '
            f"{matrix[0, 0] * bent[np.argmax(slopes <= 0)]:.0f} px from the principal point, inside the image: "
            "calibrate it anew with views whose corners show something, or with fewer terms"
        )
    if (slopes <= 0).any():
        bent = np.where(angles > angles[end], bent[end] + slopes[end] * (angles - angles[end]), bent)
    return bent, float(angles[end])


def _fitted(planes: Array, bent: Array, weights: Array) -> Array:
    """Distortion (8,) that brings plane coordinates nearest to their images."""
    squares, ratios = planes**2, bent / planes
    powers = squares[:, None] ** np.arange(1, 4)
    matrix = np.hstack([powers, -ratios[:, None] * powers])
    under = np.ones_like(planes)
    found = np.zeros(6)
    for _ in range(_ROUNDS):
        rows = weights * planes / under
        scaled = matrix * rows[:, None]
        lengths = np.linalg.norm(scaled, axis=0)
        found = np.linalg.lstsq(scaled / lengths, (ratios - 1) * rows, rcond=1e-14)[0] / lengths
        under = np.maximum(1 + powers @ found[3:], 1e-3)
    return np.array([found[0], found[1], 0, 0, found[2], *found[3:]])
