"""Points in the scene with measured positions: every camera by resection, all of them in one adjustment."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
import pydantic
from scipy.spatial.transform import Rotation

from tracker.cameras.calibration._adjustment import Adjustment, Calibrated, Measure
from tracker.cameras.calibration._bundle import Observations, State
from tracker.cameras.calibration._objects import MeasuredPoints, nominal_state, pinhole_of
from tracker.cameras.calibration._report import advice
from tracker.cameras.calibration._self_calibration import chosen_unknowns, self_calibrated
from tracker.cameras.calibration._world import focal_fault, read_points
from tracker.cameras.frame import Views
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import FilePath, component
from tracker.foundation.errors import CalibrationError
from tracker.foundation.progress import Progress
from tracker.kernels.rows import BundleCameraRow

__all__ = ["ScenePointsCalibration"]

Group = Literal["camera_constant", "principal_point", "affinity", "radial", "decentring"]

# Twice the three that a resection needs: OpenCV's iterative start wants six if they are not in a plane.
_FEWEST_POINTS = 6
# The interior is only roughly known then; wrong points are off by more, the adjustment finds the rest.
_RESECTION_PX = 25.0


@component
class ScenePointsCalibration:
    """Calibration from points of known position, clicked or detected in the views; they are the world frame."""

    points: FilePath
    """CSV: columns x, y, z in metres and VIEW_u, VIEW_v in px, empty where a view does not show the point."""

    focal_px: float = pydantic.Field(gt=0)
    """Focal length of all cameras to about 10 %, px."""

    sigma_px: float = pydantic.Field(default=0.5, gt=0)
    """Expected standard deviation of an image coordinate, px."""

    sigma_m: float = pydantic.Field(default=0.002, gt=0)
    """Standard deviation of a measured coordinate, metres."""

    estimated: tuple[Group, ...] = ("camera_constant", "principal_point", "radial")
    """Parameters to determine beside the exterior orientation; those that cannot be are named and held."""

    def calibrate(self, views: Views, progress: Progress) -> Calibrated:
        """Reads the points and adjusts; see `tracker.cameras.calibration.Calibration.calibrate`."""
        positions, pixels = read_points(self.points, views.names)
        progress("adjusting", 0, 1)
        frame = next(iter(views.frames()))
        adjustment = self._adjusted(positions, pixels, views)
        progress("adjusting", 1, 1)
        moved = adjustment.state.objects.points - positions
        seen: Mask = np.asarray(np.isfinite(pixels).all(axis=2).any(axis=0))
        rms = 1000 * float(np.sqrt(np.mean(moved[seen] ** 2)))
        pictures = {name: image for name, image in zip(views.names, frame.images, strict=True) if image is not None}
        return Calibrated(
            kind="scene_points",
            adjustment=adjustment,
            n_objects=int(seen.sum()),
            measures=(Measure("correction of the measured points", rms, "mm", "RMS of a coordinate"),),
            advice=advice(adjustment, "points", int(seen.sum())),
            world=f"points of {self.points.name}",
            pictures=pictures,
            scale=f"the positions in {self.points.name}",
            points=np.where(seen[:, None], adjustment.state.objects.points, np.nan),
        )

    def _adjusted(self, positions: Array, pixels: Array, views: Views) -> Adjustment:
        if not np.isfinite(positions).all():
            raise CalibrationError(f"{self.points}: a point has no x, y or z")
        cameras = []
        for name, size, seen in zip(views.names, views.sizes, pixels, strict=True):
            if fault := focal_fault(self.focal_px, name, size):
                raise CalibrationError(fault)
            cameras.append(self._resected(name, nominal_state(size, self.focal_px), positions, seen))
        numbers, shown = np.nonzero(np.isfinite(pixels).all(axis=2).T)
        images = np.ascontiguousarray(np.swapaxes(pixels, 0, 1)[numbers, shown])
        observations = Observations(shown, numbers, images, np.zeros_like(images))
        start = State(np.stack(cameras), MeasuredPoints(positions, positions, self.sigma_m))
        wanted = chosen_unknowns(self.estimated, len(cameras))
        pairs = list(zip(views.names, views.sizes, strict=True))
        return self_calibrated(start, observations, wanted, self.sigma_px, pairs)

    def _resected(self, name: str, camera: Array, positions: Array, pixels: Array) -> Array:
        """The camera (26,) turned and placed by the points it shows."""
        seen = np.isfinite(pixels).all(axis=1)
        if seen.sum() < _FEWEST_POINTS:
            raise CalibrationError(
                f'view "{name}": {int(seen.sum())} points are seen in it, expected at least {_FEWEST_POINTS}'
            )
        matrix = pinhole_of(camera)
        cv2.setRNGSeed(1)
        done, turn, shift, fitting = cv2.solvePnPRansac(
            positions[seen], pixels[seen], matrix, None, iterationsCount=500, reprojectionError=_RESECTION_PX,
            flags=cv2.SOLVEPNP_SQPNP,
        )  # fmt: skip
        if not done or fitting is None or len(fitting) < _FEWEST_POINTS:
            raise CalibrationError(
                f'view "{name}": its pixels do not fit the positions of the points: are they in the same order, in '
                "metres, and the focal length right to 10 %?"
            )
        chosen = fitting.ravel()
        turn, shift = cv2.solvePnPRefineLM(positions[seen][chosen], pixels[seen][chosen], matrix, None, turn, shift)
        rotation = Rotation.from_rotvec(turn.ravel()).as_matrix()
        camera[BundleCameraRow.ROTATION], camera[BundleCameraRow.CENTRE] = rotation.ravel(), -rotation.T @ shift.ravel()
        return camera
