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
from tracker.kernels.contours.occlusion import whole_blocks
from tracker.kernels.lens import bend_with_slopes, bends, lens_of
from tracker.kernels.rows import camera as at
from tracker.kernels.rows import crossing, solid
from tracker.kernels.rows.workspace import ROW

MOST_COLUMNS = 62
"""Columns of a grid that fit into one integer."""

MOST_ROWS = 400
"""Rows of a grid whose contour has room: it crosses each row and each column twice, and two rows more must fit."""


@compiled(fastmath={"contract", "nsz", "nnan", "ninf"})
def _face(planes: Array32, p: int, solids: Array32, facing: Array32, n: int) -> None:
    """Facing of part p's first n grid points: n . (c - p), metres; positive where the camera sees the surface."""
    e0, e1, e2 = solids[p, solid.CAMERA_X], solids[p, solid.CAMERA_Y], solids[p, solid.CAMERA_Z]
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
    crossings[crossing.FACING_A + i] = middle if late else f0
    crossings[crossing.FACING_B + i] = f1 if late else middle
    for k in range(6):
        crossings[crossing.AX + k * ROW + i] = grids[p, a, k]
        crossings[crossing.BX + k * ROW + i] = grids[p, b, k]


@compiled(fastmath={"contract", "nsz", "nnan", "ninf", "arcp"})
def _see(crossings: Array32, n: int, solids: Array32, p: int, camera: Array32) -> None:
    """World point and normal, pixel and unit image normal of n crossings of part p.

    The tangent plane of the contour passes through the camera and projects to the line K^-T J^-T n, J the slopes of the
    lens there.
    """
    r00, r01, r02 = solids[p, solid.R11], solids[p, solid.R12], solids[p, solid.R13]
    r10, r11, r12 = solids[p, solid.R21], solids[p, solid.R22], solids[p, solid.R23]
    r20, r21, r22 = solids[p, solid.R31], solids[p, solid.R32], solids[p, solid.R33]
    tx, ty, tz = solids[p, solid.X], solids[p, solid.Y], solids[p, solid.Z]
    one, half = np.float32(1.0), np.float32(0.5)
    flat = camera[at.FY] / camera[at.FX]
    for i in range(whole_blocks(n)):
        f0, f1 = crossings[crossing.FACING_A + i], crossings[crossing.FACING_B + i]
        t = f0 / (f0 - f1)
        x, y, z = crossings[crossing.AX + i], crossings[crossing.AY + i], crossings[crossing.AZ + i]
        a, b, c = crossings[crossing.NAX + i], crossings[crossing.NAY + i], crossings[crossing.NAZ + i]
        dx, dy, dz = crossings[crossing.BX + i] - x, crossings[crossing.BY + i] - y, crossings[crossing.BZ + i] - z
        da, db, dc = crossings[crossing.NBX + i] - a, crossings[crossing.NBY + i] - b, crossings[crossing.NBZ + i] - c
        height = half * t * (one - t) * (da * dx + db * dy + dc * dz)
        a, b, c = a + t * da, b + t * db, c + t * dc
        x, y, z = x + t * dx + height * a, y + t * dy + height * b, z + t * dz + height * c
        wx, wy, wz = (
            r00 * x + r01 * y + r02 * z + tx,
            r10 * x + r11 * y + r12 * z + ty,
            r20 * x + r21 * y + r22 * z + tz,
        )
        nx, ny, nz = r00 * a + r01 * b + r02 * c, r10 * a + r11 * b + r12 * c, r20 * a + r21 * b + r22 * c
        crossings[crossing.X + i], crossings[crossing.Y + i], crossings[crossing.Z + i] = wx, wy, wz
        crossings[crossing.NX + i], crossings[crossing.NY + i], crossings[crossing.NZ + i] = nx, ny, nz
        nearness = one / (camera[at.R31] * wx + camera[at.R32] * wy + camera[at.R33] * wz + camera[at.TZ])
        u = (camera[at.R11] * wx + camera[at.R12] * wy + camera[at.R13] * wz + camera[at.TX]) * nearness
        v = (camera[at.R21] * wx + camera[at.R22] * wy + camera[at.R23] * wz + camera[at.TY]) * nearness
        crossings[crossing.U + i], crossings[crossing.V + i] = u, v
        crossings[crossing.NU + i] = camera[at.R11] * nx + camera[at.R12] * ny + camera[at.R13] * nz
        crossings[crossing.NV + i] = camera[at.R21] * nx + camera[at.R22] * ny + camera[at.R23] * nz
    lens = lens_of(camera)
    # in a loop of its own: views without distortion, most simulated ones, do without 4 % of the time of a pose
    if bends(lens):
        for i in range(whole_blocks(n)):
            u, v, a, both, b = bend_with_slopes(lens, crossings[crossing.U + i], crossings[crossing.V + i], one)
            c, d = crossings[crossing.NU + i], crossings[crossing.NV + i]
            crossings[crossing.U + i], crossings[crossing.V + i] = u, v
            crossings[crossing.NU + i], crossings[crossing.NV + i] = b * c - both * d, a * d - both * c
    for i in range(whole_blocks(n)):
        u, v = crossings[crossing.U + i], crossings[crossing.V + i]
        crossings[crossing.U + i] = camera[at.FX] * u + camera[at.SHEAR] * v + camera[at.CX]
        crossings[crossing.V + i] = camera[at.FY] * v + camera[at.CY]
        c = crossings[crossing.NU + i] * flat
        d = crossings[crossing.NV + i] - camera[at.SHEAR] / camera[at.FY] * c
        norm = one / np.sqrt(c * c + d * d)
        crossings[crossing.NU + i], crossings[crossing.NV + i] = c * norm, d * norm


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
                du = crossings[crossing.U + after] - crossings[crossing.U + here]
                dv = crossings[crossing.V + after] - crossings[crossing.V + here]
                pieces[n_pieces, 0], pieces[n_pieces, 1] = here, after
                crossings[crossing.LENGTH + n_pieces] = np.sqrt(du * du + dv * dv)
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
        solids: (P, 48) parts in the view, see `tracker.kernels.contours.solids`.
        camera: (29,) row of `Rig.packed`, single precision.
        facing, ids, links: workspace (R C,), (3, C) and (ROW, 2).
        crossings: (25 ROW,) output, see `tracker.kernels.rows.crossing`.
        pieces: (ROW, 2) output: crossings, in the order of the contour.

    Returns:
        Number of pieces.
    """
    n_rows, n_columns = layout
    _face(planes, p, solids, facing, n_rows * n_columns)
    eye = solids[p, solid.CAMERA_X], solids[p, solid.CAMERA_Y], solids[p, solid.CAMERA_Z]
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
