"""The kernels of what tells more of a pose than contours: colours, and what is followed from image to image."""

from __future__ import annotations

from tracker.kernels.body.anchors import Carried, anchor_equations, gaps_of
from tracker.kernels.body.anchors import residuals_of as anchor_residuals
from tracker.kernels.body.rays import meet_parts
from tracker.kernels.calls import B1, F4, F8, I2, I8, U1, Call, frozen, own
from tracker.kernels.images.appearance import mark_appearance
from tracker.kernels.pictures.nearest import draw_nearest, project_surfaces
from tracker.kernels.rows import camera


def region_calls() -> list[Call]:
    """As `tracking_calls`, for the evidence of colours."""
    slopes, looked_up = (own(U1, 1, 1),) * 2, (frozen(U1, 1), frozen(U1, 256), frozen(U1, 16))
    return [(mark_appearance, (own(U1, 1, 1, 3), *slopes, (0, 0), (0, 0, 0), looked_up, own(U1, 1, 1, 3)))]


def motion_calls() -> list[Call]:
    """As `tracking_calls`, for what is followed from image to image."""
    places = own(F8, 0, 3), own(F8, 0, 3), own(F8, 0, 3), own(F8, 0)
    carried = Carried(own(I8, 0), own(I8, 0), *places, own(F8, 0, 2), own(F8, 0))
    placed, cameras, found = own(F8, 1, 1, 4, 4), frozen(F8, 1, camera.N_COLUMNS), own(F8, 0, 10)
    chains, seen = (own(I8, 1), own(F8, 1, 6), frozen(B1, 1, 2)), own(F8, 1, 3, 4)
    return [
        (gaps_of, (placed, cameras, carried, 0.1, own(F8, 1, 0))),
        (anchor_residuals, (placed, cameras, carried, 0.01, found)),
        (anchor_equations, (placed, carried, found, own(F8, 0), *chains)),
        (meet_parts, (placed[0], frozen(F8, 1, 7), own(F8, 3), own(F8, 0, 3), own(I8, 0), found)),
        (project_surfaces, (placed[0], frozen(F8, 1, 4, 3), own(B1, 1), cameras[0], seen)),
        (draw_nearest, (seen, frozen(I8, 0, 3), (0, 0), own(F4, 1, 1), own(I2, 1, 1))),
    ]
