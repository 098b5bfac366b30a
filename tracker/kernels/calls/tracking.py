"""The kernels that every tracking needs: a body's own surface."""

from __future__ import annotations

from tracker.kernels.calls import B1, F4, F8, I8, Call, frozen, own
from tracker.kernels.rows import camera
from tracker.kernels.skins.filling import fill_mesh
from tracker.kernels.skins.mesh import Mesh
from tracker.kernels.skins.tracing import trace_skins


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
