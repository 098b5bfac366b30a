"""Coarse depth pictures of meshes: what is in front, so that contours behind it are dropped."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array32, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.lens import bend, beyond_reach, lens_of
from tracker.kernels.rows.camera import (
    CENTRE_X,
    CENTRE_Y,
    CENTRE_Z,
    CX,
    CY,
    FX,
    FY,
    R11,
    R12,
    R13,
    R21,
    R22,
    R23,
    R31,
    R32,
    R33,
    SHEAR,
    TX,
    TY,
    TZ,
)
from tracker.kernels.skins.mesh import Mesh

_NEAREST_M = 0.05
"""What comes closer to a camera than this is not drawn, metres; as other renderers have it."""

_SLACK = np.float32(-0.01)
"""Share of a triangle by which it is drawn larger: no cell between two of them stays empty."""


@compiled(fastmath={"contract", "nsz", "arcp"})
def see_vertices(points: Array32, normals: Array32, camera: Array32, seen: Array32, facing: Array32) -> None:
    """Where vertices are seen, and whether the surface faces the camera there.

    In single precision; the twin is `project_point`.

    Args:
        points, normals: (N, 3) from `pose_mesh`.
        camera: (29,) row of `Rig.packed`, single precision.
        seen: (N, 3) output: pixel and inverse depth, 1 / m, 0 behind the camera and beyond its reach.
        facing: (N,) output: product of the normal and the way to the camera, positive where it faces it.
    """
    one, zero, nearest = np.float32(1.0), np.float32(0.0), np.float32(_NEAREST_M)
    lens = lens_of(camera)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        a = camera[R11] * x + camera[R12] * y + camera[R13] * z + camera[TX]
        b = camera[R21] * x + camera[R22] * y + camera[R23] * z + camera[TY]
        depth = camera[R31] * x + camera[R32] * y + camera[R33] * z + camera[TZ]
        inverse = one / max(depth, nearest)
        a, b = a * inverse, b * inverse
        u, v = bend(lens, a, b, one)
        seen[i, 0] = camera[FX] * u + camera[SHEAR] * v + camera[CX]
        seen[i, 1] = camera[FY] * v + camera[CY]
        seen[i, 2] = zero if (depth <= nearest) | beyond_reach(camera, a, b) else inverse
        facing[i] = (
            normals[i, 0] * (camera[CENTRE_X] - x)
            + normals[i, 1] * (camera[CENTRE_Y] - y)
            + normals[i, 2] * (camera[CENTRE_Z] - z)
        )


@compiled
def find_front(mesh: Mesh, seen: Array32, front: Mask) -> None:
    """Which faces (T,) are seen from outside, given where the vertices are; all of a face is before the camera."""
    for f in range(len(mesh.faces)):
        p, q, r = mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2]
        one = (seen[q, 0] - seen[p, 0]) * (seen[r, 1] - seen[p, 1])
        other = (seen[q, 1] - seen[p, 1]) * (seen[r, 0] - seen[p, 0])
        front[f] = one < other and min(seen[p, 2], seen[q, 2], seen[r, 2]) > 0.0


@compiled(fastmath={"contract", "nsz", "arcp"})
def draw_depths(mesh: Mesh, seen: Array32, front: Mask, cell_px: float, depths: Array32) -> None:
    """Draws the faces seen from outside into a coarse picture of inverse depths.

    Args:
        mesh: the mesh.
        seen, front: from `see_vertices` and `find_front`.
        cell_px: size of a cell, px; cell (i, j) is the value at pixel (cell_px j, cell_px i).
        depths: (h, w) output: the largest inverse depth at each cell, 0 where there is nothing.
    """
    height, width = depths.shape
    depths[:] = np.float32(0.0)
    scale, one, zero = np.float32(1.0 / cell_px), np.float32(1.0), np.float32(0.0)
    most_x, most_y = np.float32(width - 1), np.float32(height - 1)
    for f in range(len(mesh.faces)):
        if not front[f]:
            continue
        p, q, r = mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2]
        x0, y0, z0 = seen[p, 0] * scale, seen[p, 1] * scale, seen[p, 2]
        x1, y1 = seen[q, 0] * scale - x0, seen[q, 1] * scale - y0
        x2, y2 = seen[r, 0] * scale - x0, seen[r, 1] * scale - y0
        z1, z2 = seen[q, 2] - z0, seen[r, 2] - z0
        left, right = x0 + min(x1, x2, zero), x0 + max(x1, x2, zero)
        top, bottom = y0 + min(y1, y2, zero), y0 + max(y1, y2, zero)
        if right < zero or bottom < zero or left > most_x or top > most_y:
            continue
        low_x, high_x = int(np.ceil(max(left, zero))), int(min(right, most_x))
        low_y, high_y = int(np.ceil(max(top, zero))), int(min(bottom, most_y))
        if low_x > high_x or low_y > high_y:
            continue
        inverse = one / (x1 * y2 - y1 * x2)
        a_x, b_x = y2 * inverse, -y1 * inverse
        for i in range(low_y, high_y + 1):
            dy = np.float32(i) - y0
            a_0, b_0 = -dy * x2 * inverse, dy * x1 * inverse
            for j in range(low_x, high_x + 1):
                dx = np.float32(j) - x0
                a, b = a_0 + dx * a_x, b_0 + dx * b_x
                if a >= _SLACK and b >= _SLACK and a + b <= one - _SLACK:
                    near = z0 + a * z1 + b * z2
                    depths[i, j] = max(depths[i, j], near)
