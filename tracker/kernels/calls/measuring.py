"""The kernels of what is measured without tracking: matching, calibration."""

from __future__ import annotations

from tracker.kernels.adjustment.bundle import reduce_normal, residuals_of
from tracker.kernels.adjustment.ray_intersection import intersect_rays
from tracker.kernels.calls import B1, F4, F8, I8, Call, frozen, own
from tracker.kernels.patches.bending import bending_shifts
from tracker.kernels.patches.growth import grow, push_all
from tracker.kernels.patches.keys import cut_keys, key_side, match_keys
from tracker.kernels.patches.matching import N_FOUND, match_patches
from tracker.kernels.rows import bundle_camera, camera


def matching_calls() -> list[Call]:
    """As `tracking_calls`, for least squares matching."""
    image = frozen(F4, 1), 1, 1
    rule, noise = (2, 1, 0.01, 1.0, 0.0, False), (1.0, 1.0, frozen(F4, 1))
    heap, state = (own(F8, 4), own(I8, 4), own(I8, 1)), (own(F8, 1, N_FOUND), own(I8, 1), own(I8, 1))
    meeting = own(F8, 1, 0, 2), own(F8, 1, 0, 3), own(F8, 0, 3), own(F8, 0, 3, 3), own(F8, 0)
    growing = (
        (image, image),
        (1, 1, 1),
        (*state, own(I8, 1)),
        heap,
        (rule, rule),
        (noise, (1.0, 1.0, 0.5, 2.0)),
        (1, 1),
    )
    return [
        (match_patches, (image, image, own(F8, 0, 2), own(F8, 0, N_FOUND), own(I8, 0), rule, noise)),
        (push_all, (heap, (1, 1, 1), *state)),
        (grow, growing),
        (key_side, (2,)),
        (cut_keys, (image, own(I8, 0, 2), 2, own(F4, 0, 81), own(B1, 0))),
        (match_keys, (own(F4, 0, 81), own(I8, 0), image, own(F8, 0, N_FOUND), own(I8, 0), rule, noise)),
        (bending_shifts, (own(F8, 0, 1, 2), own(I8, 0, 1), own(F8, 0, 2, 2), own(B1, 0), 2)),
        (intersect_rays, (frozen(F8, 1, camera.N_COLUMNS), *meeting)),
    ]


def calibration_calls() -> list[Call]:
    """As `tracking_calls`, for the bundle adjustment."""
    images_of = own(I8, 0), own(I8, 0), own(F8, 0, 2), own(F8, 0, 2), own(F8, 0)
    bars = own(F8, 0, 3), own(F8, 0, 3, 6), own(I8, 1), own(F8, 0, 6, 6), own(F8, 0, 6)
    reduced = own(F8, 17, 17), own(F8, 17), own(F8, 0, 6, 6), own(F8, 0, 6), own(F8, 0, 1, 6, 17)
    return [
        (residuals_of, (own(F8, 1, bundle_camera.N_COLUMNS), bars[0], images_of, images_of[2])),
        (reduce_normal, (own(F8, 1, bundle_camera.N_COLUMNS), bars, images_of, 0.0, reduced)),
    ]
