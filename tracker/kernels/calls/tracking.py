"""The kernels that every tracking needs: poses, contours, edges, pictures, and a body's own surface."""

from __future__ import annotations

from tracker.kernels.calls import B1, F4, F8, I8, Call, frozen, own
from tracker.kernels.pictures.coverage import cover_shares, cover_still, covered_sums
from tracker.kernels.pictures.id_contours import id_contours
from tracker.kernels.pictures.rasterization import rasterize
from tracker.kernels.pictures.rods import covered_by_rods
from tracker.kernels.pictures.silhouettes import fill_parts
from tracker.kernels.rows import camera
from tracker.kernels.skins.filling import fill_mesh
from tracker.kernels.skins.mesh import Mesh
from tracker.kernels.skins.tracing import trace_skins


def tracking_calls() -> list[Call]:
    """The kernels of the tracking with arguments of the types used; read-only arrays are types of their own."""
    lens, lenses = frozen(F8, camera.N_COLUMNS), own(F8, 1, camera.N_COLUMNS)
    depths = own(F4, 1, 1)
    spots, weighted = frozen(F4, 1, 9 * 16, 3), (frozen(I8, 1, 3), frozen(F4, 0, 2))
    still = own(B1, 0), own(F8, 1, 2)
    traced = (own(F4, 1, 5), own(F4, 1, 3), own(I8, 1), own(B1, 1))
    return [
        (fill_parts, (own(F8, 1, 4, 4), frozen(F4, 1, 17 * 32, 7), (9, 16), lens, own(B1, 1, 1))),
        (cover_still, (own(F8, 1, 1, 4, 4), own(B1, 1), spots, (9, 16), lenses, *weighted)),
        (covered_sums, (own(F8, 0, 1, 4, 4), own(B1, 1), spots, (9, 16), lenses, *weighted, still)),
        (cover_shares, (own(B1, 1, 1), 1, depths)),
        (cover_shares, (frozen(B1, 1, 1), 1, depths)),
        (covered_by_rods, (own(F4, 0, 1, 2), own(F4, 0, 1, 2), depths, own(F4, 1, 2), own(F8, 1))),
        (rasterize, (own(F8, 0, 2), own(F8, 0), own(I8, 0, 3), (0, 0), own(F4, 1, 1, 4))),
        (id_contours, (own(I8, 1, 1), depths, (0, 0, 1, 1), lens, own(F8, 1, 17), 0.02, *traced)),
    ]


def skin_calls() -> list[Call]:
    """As `tracking_calls`, for bodies whose own surface is known."""
    vertices = frozen(F4, 0, 3), frozen(F4, 0, 3), frozen(I8, 0, 1), frozen(F4, 0, 1)
    mesh = Mesh(*vertices, frozen(I8, 0, 3), frozen(I8, 0), frozen(I8, 0, 4), 0, 1)
    samples = own(F4, 0, 1, 1, 5), own(F4, 0, 1, 1, 3), own(I8, 0, 1, 1), own(B1, 0, 1, 1), own(I8, 0, 1)
    rig = frozen(F8, 1, camera.N_COLUMNS), frozen(F8, 1, 2)
    return [
        (trace_skins, (own(F8, 0, 1, 4, 4), frozen(F8, 1, 4, 4), mesh, *rig, (8.0, 0.02, 240.0), *samples)),
        (fill_mesh, (own(F8, 0, 3), frozen(I8, 0, 3), rig[0][0], own(B1, 1, 1))),
    ]
