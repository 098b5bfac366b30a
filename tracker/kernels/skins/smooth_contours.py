"""The contour of the smooth surface that a mesh stands for, face by face.

The contour of a smooth surface is where its normal is perpendicular to the line of sight. On a mesh with a normal at
each vertex that is a line across the faces whose corners differ in facing (A. Hertzmann, D. Zorin, Illustrating smooth
surfaces, SIGGRAPH 2000): unlike the edges between front and back faces it does not zigzag, so that its normals are
those of the surface. Between the vertices the surface is bent by the turn of their normals, as the superquadric
tracer does it (`tracker.kernels.contours.tracing`).
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point
from tracker.kernels.rows.camera import CENTRE_X, CENTRE_Y, CENTRE_Z

_STEP_M = 1e-3
"""Of the difference that gives the direction of a contour in the image, metres."""


@compiled
def turns_away(points: Array32, facing: Array32, face: tuple[int, int, int], camera: Array) -> bool:
    """Whether the surface of a face turns away from the camera along the line of sight; on a hollow it turns to it."""
    p, q, r = face
    aa = ab = bb = av = bv = 0.0
    for k in range(3):
        a, b = points[q, k] - points[p, k], points[r, k] - points[p, k]
        sight = points[p, k] - camera[CENTRE_X + k]
        aa += a * a
        ab += a * b
        bb += b * b
        av += a * sight
        bv += b * sight
    # the line of sight in the plane of the face, in its two edges, times a positive number
    one, other = bb * av - ab * bv, aa * bv - ab * av
    return one * (facing[q] - facing[p]) + other * (facing[r] - facing[p]) < 0.0


@compiled
def cross_edge(
    points: Array32, normals: Array32, facing: Array32, ends: tuple[int, int], crossings: Array, row: int
) -> None:
    """Where the contour crosses an edge: point and unit normal of the surface bent between its ends, in a row (6,)."""
    i, j = ends
    t = facing[i] / (facing[i] - facing[j])
    length2 = turn = 0.0
    for k in range(3):
        move, change = points[j, k] - points[i, k], normals[j, k] - normals[i, k]
        crossings[row, k], crossings[row, 3 + k] = points[i, k] + t * move, normals[i, k] + t * change
        length2 += crossings[row, 3 + k] ** 2
        turn += move * change
    scale = 1.0 / np.sqrt(max(length2, 1e-12))
    for k in range(3):
        crossings[row, 3 + k] *= scale
        crossings[row, k] += 0.5 * t * (1.0 - t) * turn * scale * crossings[row, 3 + k]


@compiled
def bent(crossings: Array, t: float, place: Array) -> None:
    """Point and normal (6,) of the surface at a share t of the way between two crossings (2, 6)."""
    turn = 0.0
    for k in range(3):
        turn += (crossings[1, 3 + k] - crossings[0, 3 + k]) * (crossings[1, k] - crossings[0, k])
        place[3 + k] = crossings[0, 3 + k] + t * (crossings[1, 3 + k] - crossings[0, 3 + k])
    for k in range(3):
        place[k] = crossings[0, k] + t * (crossings[1, k] - crossings[0, k]) + 0.5 * t * (1.0 - t) * turn * place[3 + k]


@compiled
def image_normal(
    camera: Array, point: tuple[float, float, float], normal: tuple[float, float, float]
) -> tuple[float, float]:
    """Unit image normal of a contour: perpendicular to the image of its tangent, which is to normal and sight."""
    x, y, z = point
    dx, dy, dz = x - camera[CENTRE_X], y - camera[CENTRE_Y], z - camera[CENTRE_Z]
    a, b, c = normal[1] * dz - normal[2] * dy, normal[2] * dx - normal[0] * dz, normal[0] * dy - normal[1] * dx
    step = _STEP_M / np.sqrt(max(a * a + b * b + c * c, 1e-12))
    u0, v0, _ = project_point(camera, x - step * a, y - step * b, z - step * c)
    u1, v1, _ = project_point(camera, x + step * a, y + step * b, z + step * c)
    du, dv = u1 - u0, v1 - v0
    length = np.sqrt(max(du * du + dv * dv, 1e-12))
    return -dv / length, du / length
