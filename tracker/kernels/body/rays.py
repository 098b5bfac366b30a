"""Where viewing rays first meet the surface of a part that is known to be seen there."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.rows import met_place, superquadric

# Of a ray through the sphere around a part; between two of them the crossing is halved so often: 0.1 mm at 1 m.
_STEPS, _HALVINGS = 32, 10

_BESIDE_M = 1e-4
"""Distance of the places that a gradient is taken between, metres."""


@compiled
def inside_outside(shape: Array, x: float, y: float, z: float) -> float:
    """Inside-outside function of a part at a point in its frame, metres.

    The twin is `tracker.geometry.superquadrics.inside_outside`.
    """
    height = z / shape[superquadric.A3]
    clamped = min(max(height, -1.0), 1.0)
    u = abs(x / (shape[superquadric.A1] * (1.0 + shape[superquadric.K1] * clamped)))
    v = abs(y / (shape[superquadric.A2] * (1.0 + shape[superquadric.K2] * clamped)))
    e1, e2 = shape[superquadric.E1], shape[superquadric.E2]
    around: float = (u ** (2.0 / e2) + v ** (2.0 / e2)) ** (e2 / e1) + abs(height) ** (2.0 / e1)
    return around


@compiled
def meet_parts(placements: Array, shapes: Array, centre: Array, rays: Array, parts: Integers, found: Array) -> None:
    """The first crossing of each ray with one part.

    Args:
        placements: (P, 4, 4) world_from_part.
        shapes: (P, 7) packed superquadrics.
        centre: (3,) where the rays start, metres.
        rays: (N, 3) unit vectors in the world.
        parts: (N,) which part each of them is to meet.
        found: (N, 10) output, a row each; `tracker.kernels.rows.met_place` names the columns.
    """
    for n in range(len(parts)):
        p = parts[n]
        shape = shapes[p]
        ox = oy = oz = dx = dy = dz = 0.0
        for k in range(3):
            start = centre[k] - placements[p, k, 3]
            ox += placements[p, k, 0] * start
            oy += placements[p, k, 1] * start
            oz += placements[p, k, 2] * start
            dx += placements[p, k, 0] * rays[n, k]
            dy += placements[p, k, 1] * rays[n, k]
            dz += placements[p, k, 2] * rays[n, k]
        wide = shape[superquadric.A1] * (1.0 + abs(shape[superquadric.K1]))
        deep = shape[superquadric.A2] * (1.0 + abs(shape[superquadric.K2]))
        radius = np.sqrt(wide**2 + deep**2 + shape[superquadric.A3] ** 2)
        far = near = max(-(ox * dx + oy * dy + oz * dz) - radius, 0.0)
        met = False
        for i in range(1, _STEPS + 1):
            near = far + 2.0 * radius / _STEPS * i
            if inside_outside(shape, ox + near * dx, oy + near * dy, oz + near * dz) < 1.0:
                met, far = True, near - 2.0 * radius / _STEPS
                break
        found[n] = 0.0
        if not met:
            continue
        for _ in range(_HALVINGS):
            half = 0.5 * (near + far)
            if inside_outside(shape, ox + half * dx, oy + half * dy, oz + half * dz) < 1.0:
                near = half
            else:
                far = half
        x, y, z = ox + near * dx, oy + near * dy, oz + near * dz
        h = _BESIDE_M
        nx = inside_outside(shape, x + h, y, z) - inside_outside(shape, x - h, y, z)
        ny = inside_outside(shape, x, y + h, z) - inside_outside(shape, x, y - h, z)
        nz = inside_outside(shape, x, y, z + h) - inside_outside(shape, x, y, z - h)
        length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
        place, normal, ray = (x, y, z), (nx / length, ny / length, nz / length), (dx, dy, dz)
        for k in range(3):
            found[n, met_place.X + k] = place[k]
            found[n, met_place.NORMAL_X + k] = normal[k]
            found[n, met_place.RAY_X + k] = ray[k]
        found[n, met_place.FACING] = -(nx * dx + ny * dy + nz * dz) / length
