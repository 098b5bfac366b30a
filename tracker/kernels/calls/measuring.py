"""The kernels of what is measured without tracking: matching, calibration."""

from __future__ import annotations

from tracker.kernels.adjustment.bundle import reduce_normal, residuals_of
from tracker.kernels.adjustment.ray_intersection import intersect_rays
from tracker.kernels.calls import F8, I8, Call, frozen, own
from tracker.kernels.rows import bundle_camera, camera


def matching_calls() -> list[Call]:
    """As `tracking_calls`, for what is followed or measured on surfaces."""
    meeting = own(F8, 1, 0, 2), own(F8, 1, 0, 3), own(F8, 0, 3), own(F8, 0, 3, 3), own(F8, 0)
    return [(intersect_rays, (frozen(F8, 1, camera.N_COLUMNS), *meeting))]


def calibration_calls() -> list[Call]:
    """As `tracking_calls`, for the bundle adjustment."""
    images_of = own(I8, 0), own(I8, 0), own(F8, 0, 2), own(F8, 0, 2), own(F8, 0)
    bars = own(F8, 0, 3), own(F8, 0, 3, 6), own(I8, 1), own(F8, 0, 6, 6), own(F8, 0, 6)
    reduced = own(F8, 17, 17), own(F8, 17), own(F8, 0, 6, 6), own(F8, 0, 6), own(F8, 0, 1, 6, 17)
    return [
        (residuals_of, (own(F8, 1, bundle_camera.N_COLUMNS), bars[0], images_of, images_of[2])),
        (reduce_normal, (own(F8, 1, bundle_camera.N_COLUMNS), bars, images_of, 0.0, reduced)),
    ]
