"""The kernels of what tells more of a pose than contours: what is followed from image to image."""

from __future__ import annotations

from tracker.kernels.calls import B1, F4, F8, I2, I8, Call, frozen, own
from tracker.kernels.pictures.nearest import draw_nearest, project_surfaces
from tracker.kernels.rows import camera


def motion_calls() -> list[Call]:
    """As `tracking_calls`, for what is followed from image to image."""
    placed, cameras, seen = own(F8, 1, 4, 4), frozen(F8, 1, camera.N_COLUMNS), own(F8, 1, 3, 4)
    return [
        (project_surfaces, (placed, frozen(F8, 1, 4, 3), own(B1, 1), cameras[0], seen)),
        (draw_nearest, (seen, frozen(I8, 0, 3), (0, 0), own(F4, 1, 1), own(I2, 1, 1))),
    ]
