"""Where a surface grid turns away from a camera: crossings of the grid's edges, joined to pieces of contour.

A point of a surface with outward normal n lies on the occluding contour of a camera at c where n . (c - p) = 0.
The contour crosses the grid's edges where that product changes sign; the crossings of a cell are joined to a piece
of contour (marching squares) and the pieces to chains. A row of signs is the bits of one integer, so that rows and
cells without a crossing cost next to nothing. Every edge has a point in its middle; between the nearer two the
surface is bent by the turn of its normals: a 9 x 16 grid is good to a fraction of a pixel.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array32, Integers
from tracker.kernels.bits import lowest_bit
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import ROW, whole_blocks

MOST_COLUMNS = 62
"""Columns of a grid that fit into one integer."""

CROSSING_ROWS = 25
"""Rows of the crossings: of the two ends of half an edge 0-5 and 6-11 point and normal, 12-13 facing; of the crossing
14-16 world point, 17-19 world normal, 20-21 pixel, 22-23 unit image normal; 24 length of each piece, px."""


@compiled(fastmath={"contract", "nsz", "nnan", "ninf"})
def _face(planes: Array32, p: int, solids: Array32, facing: Array32, n: int) -> None:
    """Facing of part p's first n grid points: n . (c - p), metres; positive where the camera sees the surface."""
    e0, e1, e2 = solids[p, 41], solids[p, 42], solids[p, 43]
    for i in range(n):
        facing[i] = planes[p, 0, i] * e0 + planes[p, 1, i] * e1 + planes[p, 2, i] * e2 - planes[p, 3, i]


@compiled
def _signs(facing: Array32, start: int, n_columns: int) -> int:
    """The signs of a row of facings as bits."""
    bits = 0
    for c in range(n_columns):
        bits |= int(facing[start + c] > 0.0) << c
    return bits


@compiled(fastmath={"contract", "nsz"})
def _take(
    grids: Array32,
    p: int,
    nodes: tuple[int, int, int],
    ends: tuple[float, float],
    eye: tuple[float, float, float],
    crossings: Array32,
    i: int,
) -> None:
    """Takes up crossing i: the half of a grid edge (first end, middle, second end) in which the facing changes."""
    n0, nm, n1 = nodes
    f0, f1 = ends
    middle = grids[p, nm, 3] * eye[0] + grids[p, nm, 4] * eye[1] + grids[p, nm, 5] * eye[2] - grids[p, nm, 6]
    late = (middle > 0.0) == (f0 > 0.0)
    a, b = (nm if late else n0), (n1 if late else nm)
    crossings[12 * ROW + i] = middle if late else f0
    crossings[13 * ROW + i] = f1 if late else middle
    for k in range(6):
        crossings[k * ROW + i] = grids[p, a, k]
        crossings[(6 + k) * ROW + i] = grids[p, b, k]


@compiled(fastmath={"contract", "nsz", "nnan", "ninf", "arcp"})
def _see(crossings: Array32, n: int, solids: Array32, p: int, camera: Array32) -> None:
    """World point and normal, pixel and unit image normal of n crossings of part p.

    The tangent plane of the contour passes through the camera and projects to the line K^-T n.
    """
    r00, r01, r02 = solids[p, 29], solids[p, 30], solids[p, 31]
    r10, r11, r12 = solids[p, 32], solids[p, 33], solids[p, 34]
    r20, r21, r22 = solids[p, 35], solids[p, 36], solids[p, 37]
    tx, ty, tz = solids[p, 38], solids[p, 39], solids[p, 40]
    one, half, two = np.float32(1.0), np.float32(0.5), np.float32(2.0)
    flat = camera[16] / camera[15]
    for i in range(whole_blocks(n)):
        f0, f1 = crossings[12 * ROW + i], crossings[13 * ROW + i]
        t = f0 / (f0 - f1)
        x, y, z = crossings[i], crossings[ROW + i], crossings[2 * ROW + i]
        a, b, c = crossings[3 * ROW + i], crossings[4 * ROW + i], crossings[5 * ROW + i]
        dx, dy, dz = crossings[6 * ROW + i] - x, crossings[7 * ROW + i] - y, crossings[8 * ROW + i] - z
        da, db, dc = crossings[9 * ROW + i] - a, crossings[10 * ROW + i] - b, crossings[11 * ROW + i] - c
        height = half * t * (one - t) * (da * dx + db * dy + dc * dz)
        a, b, c = a + t * da, b + t * db, c + t * dc
        x, y, z = x + t * dx + height * a, y + t * dy + height * b, z + t * dz + height * c
        wx, wy, wz = (
            r00 * x + r01 * y + r02 * z + tx,
            r10 * x + r11 * y + r12 * z + ty,
            r20 * x + r21 * y + r22 * z + tz,
        )
        nx, ny, nz = r00 * a + r01 * b + r02 * c, r10 * a + r11 * b + r12 * c, r20 * a + r21 * b + r22 * c
        crossings[14 * ROW + i], crossings[15 * ROW + i], crossings[16 * ROW + i] = wx, wy, wz
        crossings[17 * ROW + i], crossings[18 * ROW + i], crossings[19 * ROW + i] = nx, ny, nz
        nearness = one / (camera[8] * wx + camera[9] * wy + camera[10] * wz + camera[11])
        u = (camera[0] * wx + camera[1] * wy + camera[2] * wz + camera[3]) * nearness
        v = (camera[4] * wx + camera[5] * wy + camera[6] * wz + camera[7]) * nearness
        r2 = u * u + v * v
        radial = one + r2 * (camera[19] + r2 * (camera[20] + r2 * camera[23]))
        uu = u * radial + two * camera[21] * u * v + camera[22] * (r2 + two * u * u)
        vv = v * radial + camera[21] * (r2 + two * v * v) + two * camera[22] * u * v
        crossings[20 * ROW + i] = camera[15] * uu + camera[24] * vv + camera[17]
        crossings[21 * ROW + i] = camera[16] * vv + camera[18]
        sx = (camera[0] * nx + camera[1] * ny + camera[2] * nz) * flat
        sy = camera[4] * nx + camera[5] * ny + camera[6] * nz - camera[24] / camera[16] * sx
        norm = one / np.sqrt(sx * sx + sy * sy)
        crossings[22 * ROW + i], crossings[23 * ROW + i] = sx * norm, sy * norm


@compiled
def _join(met: tuple[int, int, int, int], links: Integers) -> None:
    """Links the crossings of a cell, -1 where a side has none, two by two."""
    waiting = -1
    for k in range(4):
        here = met[k]
        if here < 0:
            continue
        if waiting < 0:
            waiting = here
            continue
        links[waiting, 0 if links[waiting, 0] < 0 else 1] = here
        links[here, 0 if links[here, 0] < 0 else 1] = waiting
        waiting = -1


@compiled
def _chain(links: Integers, n: int, pieces: Integers, crossings: Array32) -> int:
    """Walks along the linked crossings: pieces in the order of the contour, with their lengths; their number."""
    n_pieces = 0
    for first in range(n):
        before, here = -1, first
        while here >= 0 and links[here, 0] != -2:
            after = links[here, 0] if links[here, 0] != before else links[here, 1]
            links[here, 0] = -2
            if after >= 0:
                du = crossings[20 * ROW + after] - crossings[20 * ROW + here]
                dv = crossings[21 * ROW + after] - crossings[21 * ROW + here]
                pieces[n_pieces, 0], pieces[n_pieces, 1] = here, after
                crossings[24 * ROW + n_pieces] = np.sqrt(du * du + dv * dv)
                n_pieces += 1
            before, here = here, after
    return n_pieces


@compiled
def find_pieces(
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    p: int,
    solids: Array32,
    camera: Array32,
    facing: Array32,
    ids: Integers,
    links: Integers,
    crossings: Array32,
    pieces: Integers,
) -> int:
    """Pieces of the occluding contour of part p in one view, whether anything hides them or not.

    Args:
        grids: (P, F, 7) surface points, normals and their product; F = (2 R - 1) (2 C) nodes, row by row, of which
            the even rows and columns are the grid, the odd ones the middles of its edges.
        planes: (P, 4, R C) normals of the grid points and their product with the points.
        layout: R, C.
        p: the part.
        solids: (P, 48) parts in the view, see `tracker.kernels.contours.occlusion`.
        camera: (25,) row of `Rig.packed`, single precision.
        facing, ids, links: workspace (R C,), (3, C) and (ROW, 2).
        crossings: (25 ROW,) output, see `CROSSING_ROWS`.
        pieces: (ROW, 2) output: crossings, in the order of the contour.

    Returns:
        Number of pieces.
    """
    n_rows, n_columns = layout
    _face(planes, p, solids, facing, n_rows * n_columns)
    eye = solids[p, 41], solids[p, 42], solids[p, 43]
    wide, last = 2 * n_columns, n_columns - 1
    everything = (1 << n_columns) - 1
    # All points of a pole are one.
    above = everything if facing[0] > 0.0 else 0
    along_above = n = 0
    for r in range(1, n_rows):
        start, node = r * n_columns, 2 * r * wide
        row = _signs(facing, start, n_columns)
        if r == n_rows - 1:
            row = everything if facing[start] > 0.0 else 0
        if (row == above and (row == 0 or row == everything)) or n + 2 * n_columns > ROW:
            along_above, above = 0, row
            continue
        here, over = r & 1, 1 - (r & 1)
        along = row ^ ((row >> 1) | ((row & 1) << last))
        left = along
        while left:
            c = lowest_bit(left)
            left &= left - 1
            after = c + 1 if c < last else 0
            nodes = node + 2 * c, node + 2 * c + 1, node + 2 * after
            _take(grids, p, nodes, (facing[start + c], facing[start + after]), eye, crossings, n)
            ids[here, c] = n
            links[n, 0] = links[n, 1] = -1
            n += 1
        down = row ^ above
        left = down
        while left:
            c = lowest_bit(left)
            left &= left - 1
            nodes = node - 2 * wide + 2 * c, node - wide + 2 * c, node + 2 * c
            _take(grids, p, nodes, (facing[start - n_columns + c], facing[start + c]), eye, crossings, n)
            ids[2, c] = n
            links[n, 0] = links[n, 1] = -1
            n += 1
        left = along | along_above | down | (down >> 1) | ((down & 1) << last)
        while left:
            c = lowest_bit(left)
            left &= left - 1
            after = c + 1 if c < last else 0
            met = (
                ids[over, c] if along_above >> c & 1 else -1,
                ids[2, after] if down >> after & 1 else -1,
                ids[here, c] if along >> c & 1 else -1,
                ids[2, c] if down >> c & 1 else -1,
            )
            _join(met, links)
        above, along_above = row, along
    _see(crossings, n, solids, p, camera)
    return _chain(links, n, pieces, crossings)
