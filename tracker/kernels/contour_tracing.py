"""Occluding contours of tapered superquadrics, traced on their surface grids and tested for visibility.

A point of a surface with outward normal n lies on the occluding contour of a camera at c where n . (c - p) = 0.
Every part carries a grid of surface points and normals; the contour crosses the grid's edges where that product
changes sign, and the crossings of a cell are joined to a piece of contour (marching squares). The surface
between grid points is interpolated quadratically, the pieces are bent by the turn of their normals, so that a
9 x 16 grid is good to a fraction of a pixel and the cost does not depend on the image size.

Arrays are indexed here, never sliced, in the inner loops: a slice costs a reference count.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.occlusion import blocks_ray, inside_value
from tracker.kernels.projection import project_point


@njit(cache=True, nogil=True, error_model="numpy")
def _root(s0: float, sm: float, s1: float) -> float:
    """Where the quadratic through s0, sm, s1 at 0, 1/2, 1 is zero; s0 and s1 have different signs."""
    a, b = 2.0 * (s0 + s1) - 4.0 * sm, 4.0 * sm - 3.0 * s0 - s1
    linear = s0 / (s0 - s1)
    square = b * b - 4.0 * a * s0
    if abs(a) <= 1e-6 * abs(b) or square < 0.0:
        return linear
    half = -0.5 * (b + np.copysign(np.sqrt(square), b))
    if half != 0.0:
        t = s0 / half
        if 0.0 <= t <= 1.0:
            return t
    t = half / a
    return t if 0.0 <= t <= 1.0 else linear


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(
    grids: Array32, p: int, ends: tuple[int, int, int, int], eye: tuple[float, float, float], out: Array, i: int
) -> None:
    """Writes point and normal where a grid edge of part p meets the contour to out[i] (6,)."""
    r0, c0, r1, c1 = ends
    rm, cm = (r0 + r1) // 2, c0 if c0 == c1 else c0 + 1
    s0 = sm = s1 = 0.0
    for k in range(3):
        s0 += grids[p, r0, c0, 3 + k] * (eye[k] - grids[p, r0, c0, k])
        sm += grids[p, rm, cm, 3 + k] * (eye[k] - grids[p, rm, cm, k])
        s1 += grids[p, r1, c1, 3 + k] * (eye[k] - grids[p, r1, c1, k])
    t = _root(s0, sm, s1)
    w0, wm, w1 = (1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)
    for k in range(6):
        out[i, k] = w0 * grids[p, r0, c0, k] + wm * grids[p, rm, cm, k] + w1 * grids[p, r1, c1, k]


@njit(cache=True, nogil=True, error_model="numpy")
def _find_crossings(
    grids: Array32, planes: Array32, p: int, eye: tuple[float, float, float], facing: Array32, out: Array, ids: Integers
) -> int:
    """Crossings of part p's grid edges with the contour: their number; `ids` (2, R, C) says which edge has which."""
    e0, e1, e2 = np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])
    for i in range(facing.size):
        facing[i] = planes[p, 0, i] * e0 + planes[p, 1, i] * e1 + planes[p, 2, i] * e2 - planes[p, 3, i]
    _, n_rows, n_columns = ids.shape
    n = 0
    for r in range(n_rows):
        for c in range(n_columns):
            after = c + 1 if c + 1 < n_columns else 0
            here = facing[r * n_columns + c] > 0.0
            ids[0, r, c] = ids[1, r, c] = -1
            if here != (facing[r * n_columns + after] > 0.0):
                _cross(grids, p, (2 * r, 2 * c, 2 * r, 2 * after), eye, out, n)
                ids[0, r, c] = n
                n += 1
            if r + 1 < n_rows and here != (facing[(r + 1) * n_columns + c] > 0.0):
                _cross(grids, p, (2 * r, 2 * c, 2 * r + 2, 2 * c), eye, out, n)
                ids[1, r, c] = n
                n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _join(ids: Integers, pieces: Integers) -> int:
    """Joins the crossings of each grid cell: pairs in `pieces` (N, 2), and their number."""
    _, n_rows, n_columns = ids.shape
    n = 0
    for r in range(n_rows - 1):
        for c in range(n_columns):
            after = c + 1 if c + 1 < n_columns else 0
            waiting = -1
            for met in (ids[0, r, c], ids[1, r, after], ids[0, r + 1, c], ids[1, r, c]):
                if met < 0:
                    continue
                if waiting < 0:
                    waiting = met
                else:
                    pieces[n, 0], pieces[n, 1] = waiting, met
                    n += 1
                    waiting = -1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _to_world(placements: Array, b: int, p: int, crossings: Array, n: int, camera: Array, world: Array) -> None:
    """Crossings of part p in the world (n, 8): point, unit normal and pixel."""
    for i in range(n):
        x, y, z = crossings[i, 0], crossings[i, 1], crossings[i, 2]
        nx, ny, nz = crossings[i, 3], crossings[i, 4], crossings[i, 5]
        scale = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
        for r in range(3):
            a0, a1, a2 = placements[b, p, r, 0], placements[b, p, r, 1], placements[b, p, r, 2]
            world[i, r] = a0 * x + a1 * y + a2 * z + placements[b, p, r, 3]
            world[i, 3 + r] = scale * (a0 * nx + a1 * ny + a2 * nz)
        world[i, 6], world[i, 7], _ = project_point(camera, world[i, 0], world[i, 1], world[i, 2])


@njit(cache=True, nogil=True, error_model="numpy")
def _bend(world: Array, i: int, j: int, t: float, sample: Array) -> None:
    """World point and unit normal (6,) at fraction t of a contour piece, bent by the turn of its normals."""
    length = turn = 0.0
    for k in range(3):
        normal = (1.0 - t) * world[i, 3 + k] + t * world[j, 3 + k]
        sample[3 + k] = normal
        length += normal * normal
        turn += (world[j, 3 + k] - world[i, 3 + k]) * (world[j, k] - world[i, k])
    length = 1.0 / np.sqrt(length)
    height = 0.5 * t * (1.0 - t) * turn
    for k in range(3):
        sample[3 + k] *= length
        sample[k] = (1.0 - t) * world[i, k] + t * world[j, k] + height * sample[3 + k]


@njit(cache=True, nogil=True, error_model="numpy")
def _prepare(placements: Array, b: int, shapes: Array, bounds: Array, solids: Array) -> None:
    """Fills the columns 0-11 and 15-20 of `solids` for one pose."""
    for p in range(len(shapes)):
        for r in range(3):
            shift = 0.0
            for k in range(3):
                solids[p, 4 * r + k] = placements[b, p, k, r] / shapes[p, r]
                shift -= placements[b, p, k, r] * placements[b, p, k, 3]
            solids[p, 4 * r + 3] = shift / shapes[p, r]
        e1, e2 = shapes[p, 3], shapes[p, 4]
        solids[p, 15], solids[p, 16], solids[p, 17] = bounds[1, p], shapes[p, 5], shapes[p, 6]
        solids[p, 18], solids[p, 19], solids[p, 20] = 2.0 / e2, e2 / e1, 2.0 / e1


@njit(cache=True, nogil=True, error_model="numpy")
def _see(
    placements: Array, b: int, shapes: Array, bounds: Array, camera: Array, margin_m: float, solids: Array
) -> None:
    """Fills the columns 12-14 and 21-28 of `solids` for one view.

    In the image a part is its axis with a width: 21-22 one end of the axis, 23-24 the axis divided by its squared
    length, 25-26 the axis, 27 the squared width around it, px, and 28 the nearest depth, metres, -1 for a part that
    is not wholly before the camera. `margin_m` is added to the width.
    """
    for p in range(len(shapes)):
        for r in range(3):
            solids[p, 12 + r] = (
                solids[p, 4 * r] * camera[12]
                + solids[p, 4 * r + 1] * camera[13]
                + solids[p, 4 * r + 2] * camera[14]
                + solids[p, 4 * r + 3]
            )
        x, y, z = placements[b, p, 0, 3], placements[b, p, 1, 3], placements[b, p, 2, 3]
        half = shapes[p, 2]
        ax, ay, az = half * placements[b, p, 0, 2], half * placements[b, p, 1, 2], half * placements[b, p, 2, 2]
        u0, v0, d0 = project_point(camera, x - ax, y - ay, z - az)
        u1, v1, d1 = project_point(camera, x + ax, y + ay, z + az)
        width = bounds[2, p] + margin_m
        depth = min(d0, d1) - width
        du, dv = u1 - u0, v1 - v0
        square = du * du + dv * dv + 1e-9
        solids[p, 21], solids[p, 22], solids[p, 23], solids[p, 24] = u0, v0, du / square, dv / square
        solids[p, 25], solids[p, 26] = du, dv
        # A tenth on top covers perspective and lens distortion across the width of a part.
        solids[p, 27] = (1.1 * camera[15] * width / max(depth, 0.05)) ** 2
        solids[p, 28] = depth if depth > 0.05 else -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _beside(solids: Array, q: int, u: float, v: float) -> float:
    """Squared distance of a pixel from the axis of part q, px^2."""
    x, y = u - solids[q, 21], v - solids[q, 22]
    t = min(max(x * solids[q, 23] + y * solids[q, 24], 0.0), 1.0)
    x, y = x - t * solids[q, 25], y - t * solids[q, 26]
    return x * x + y * y


@njit(cache=True, nogil=True, error_model="numpy")
def _neighbours(p: int, solids: Array, radius: float, listed: Integers) -> int:
    """Parts that may cover or touch part p, which lies within a sphere of that radius, metres; their number."""
    n = 0
    u, v = solids[p, 21] + 0.5 * solids[p, 25], solids[p, 22] + 0.5 * solids[p, 26]
    own = 0.5 * np.sqrt(solids[p, 25] ** 2 + solids[p, 26] ** 2) + np.sqrt(solids[p, 27])
    for q in range(len(solids)):
        if q == p or solids[q, 28] < 0.0 or solids[q, 28] > solids[p, 28] + 2.0 * radius + 0.1:
            continue
        if np.sqrt(_beside(solids, q, u, v)) < own + np.sqrt(solids[q, 27]):
            listed[n] = q
            n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _cover(solids: Array, listed: Integers, n: int, sample: Array, pixel: tuple[float, float], contact_m: float) -> int:
    """2 if another part covers the sample (6,), 1 if one touches its outer side, else 0."""
    outcome = 0
    wx, wy, wz = sample[0], sample[1], sample[2]
    for k in range(n):
        q = listed[k]
        if _beside(solids, q, pixel[0], pixel[1]) > solids[q, 27]:
            continue
        x = solids[q, 0] * wx + solids[q, 1] * wy + solids[q, 2] * wz + solids[q, 3]
        y = solids[q, 4] * wx + solids[q, 5] * wy + solids[q, 6] * wz + solids[q, 7]
        z = solids[q, 8] * wx + solids[q, 9] * wy + solids[q, 10] * wz + solids[q, 11]
        if blocks_ray(solids, q, x, y, z):
            # What covers this sample most often covers the next one.
            listed[k], listed[0] = listed[0], q
            return 2
        if outcome == 0 and x * x + y * y + z * z < 4.0 * solids[q, 15]:
            nx, ny, nz = contact_m * sample[3], contact_m * sample[4], contact_m * sample[5]
            x += solids[q, 0] * nx + solids[q, 1] * ny + solids[q, 2] * nz
            y += solids[q, 4] * nx + solids[q, 5] * ny + solids[q, 6] * nz
            z += solids[q, 8] * nx + solids[q, 9] * ny + solids[q, 10] * nz
            if inside_value(solids, q, x, y, z) < 1.0:
                outcome = 1
    return outcome


@njit(cache=True, nogil=True, error_model="numpy")
def _write(
    camera: Array, sample: Array, pixel: tuple[float, float], weight: float, at: tuple[int, int, int], out: Array32
) -> None:
    """Writes pixel, image normal and weight of a sample (6,) to out[at] (5,).

    The tangent plane of the contour passes through the camera and projects to the line K^-T n.
    """
    b, v, n = at
    nx = camera[0] * sample[3] + camera[1] * sample[4] + camera[2] * sample[5]
    ny = camera[4] * sample[3] + camera[5] * sample[4] + camera[6] * sample[5]
    nx /= camera[15]
    ny = (ny - camera[24] * nx) / camera[16]
    norm = 1.0 / np.sqrt(nx * nx + ny * ny)
    out[b, v, n, 0], out[b, v, n, 1], out[b, v, n, 4] = pixel[0], pixel[1], weight
    out[b, v, n, 2], out[b, v, n, 3] = nx * norm, ny * norm


@njit(cache=True, nogil=True, error_model="numpy")
def trace_contours(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
    counts: Integers,
) -> None:
    """Visible occluding-contour samples of many poses in all views.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        grids: (P, 2 R - 1, 2 C, 6) surface points and normals; even rows and columns are the grid, odd ones
            the middles of its edges; the first and last row are the poles.
        planes: (P, 4, R C) normals of the grid points and their product with the points.
        bounds: (3, P) radii of bounding spheres, metres; reaches of bounding ellipsoids, squared, in units of
            the half extents; largest distances of the surface from the z axis, metres.
        cameras: (V, 25) from `Rig.packed`.
        sizes: (V, 2) image sizes, px.
        spacing: longest contour a sample stands for, px; distance at which parts touch, metres.
        positions: (B, V, M, 5) output: pixel, image normal, contour length.
        points: (B, V, M, 3) output: world positions.
        parts, between, counts: outputs, laid out as in `Contours`.
    """
    n_parts, capacity = len(shapes), parts.shape[2]
    n_rows, n_columns = (grids.shape[1] + 1) // 2, grids.shape[2] // 2
    solids, sample = np.zeros((n_parts, 29)), np.zeros(6)
    facing = np.zeros(n_rows * n_columns, dtype=np.float32)
    crossings, world = np.zeros((2 * facing.size, 6)), np.zeros((2 * facing.size, 8))
    ids = np.zeros((2, n_rows, n_columns), dtype=np.int64)
    pieces, listed = np.zeros((2 * facing.size, 2), dtype=np.int64), np.zeros(n_parts, dtype=np.int64)
    for b in range(len(placements)):
        _prepare(placements, b, shapes, bounds, solids)
        for v in range(len(cameras)):
            camera = cameras[v]
            _see(placements, b, shapes, bounds, camera, spacing[1], solids)
            n = 0
            for p in range(n_parts):
                if solids[p, 28] < 0.0:
                    continue
                eye = solids[p, 12] * shapes[p, 0], solids[p, 13] * shapes[p, 1], solids[p, 14] * shapes[p, 2]
                n_crossings = _find_crossings(grids, planes, p, eye, facing, crossings, ids)
                n_pieces = _join(ids, pieces)
                _to_world(placements, b, p, crossings, n_crossings, camera, world)
                n_listed = _neighbours(p, solids, bounds[0, p], listed)
                for k in range(n_pieces):
                    i, j = pieces[k, 0], pieces[k, 1]
                    length = np.sqrt((world[j, 6] - world[i, 6]) ** 2 + (world[j, 7] - world[i, 7]) ** 2)
                    n_samples = int(np.ceil(length / spacing[0]))
                    for m in range(n_samples):
                        _bend(world, i, j, (m + 0.5) / n_samples, sample)
                        x, y, _ = project_point(camera, sample[0], sample[1], sample[2])
                        if x < -0.5 or y < -0.5 or x > sizes[v, 0] - 0.5 or y > sizes[v, 1] - 0.5:
                            continue
                        cover = _cover(solids, listed, n_listed, sample, (x, y), spacing[1])
                        if cover == 2 or n == capacity:
                            continue
                        weight = 0.0 if cover == 1 else length / n_samples
                        _write(camera, sample, (x, y), weight, (b, v, n), positions)
                        points[b, v, n, 0], points[b, v, n, 1], points[b, v, n, 2] = sample[0], sample[1], sample[2]
                        parts[b, v, n] = p
                        between[b, v, n] = cover == 1
                        n += 1
            counts[b, v] = n
