"""Visible occluding-contour samples of skinned meshes, without rendering a picture.

The contour of a smooth surface is where its normal is perpendicular to the line of sight. On a mesh with a normal at
each vertex that is a line across the faces whose corners differ in facing (A. Hertzmann, D. Zorin, Illustrating smooth
surfaces, SIGGRAPH 2000): unlike the edges between front and back faces it does not zigzag, so that its normals are
those of the surface. Between the vertices the surface is bent by the turn of their normals, as the superquadric
tracer does it (`tracker.kernels.contours.tracing`). Open borders of faces seen from outside are contours as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point
from tracker.kernels.rows.camera import CENTRE_X, CENTRE_Y, CENTRE_Z
from tracker.kernels.skins.depths import draw_depths, find_front, see_vertices
from tracker.kernels.skins.mesh import Mesh, motions_of, pose_mesh

_BESIDE = 1.5
"""So many cells outside of a contour is looked what is there: nearer, the cell may still show the surface itself."""

_HIDDEN_M, _COVERED_M = 0.03, 0.05
"""What is beside a contour and so much nearer to the camera hides it; at the contour itself a surface may bulge that
much towards the camera within a cell (limbs 3 cm, a trunk 5 cm)."""

_STEP_M = 1e-3
"""Of the difference that gives the direction of a contour in the image, metres."""


VISIBLE, BETWEEN, HIDDEN = 0, 1, 2
"""What a sample is."""


class View(NamedTuple):
    """A view that meshes are traced in."""

    camera: Array
    """(28,) row of `Rig.packed`."""

    width: float
    height: float
    """Of the image, px."""

    cell_px: float
    depths: Array32
    """(h, w) from `draw_depths`."""

    seen: Array32
    facing: Array32
    front: Mask
    """From `see_vertices` and `find_front`."""


class Spacing(NamedTuple):
    """How contours are cut into samples."""

    step_px: float
    """Contour that a sample stands for, px."""

    contact_m: float
    """Distance at which surfaces touch, metres."""


class Found(NamedTuple):
    """Where samples are written: one pose and view of `Contours`; further ones are dropped."""

    positions: Array32
    points: Array32
    parts: Integers
    between: Mask


class Work(NamedTuple):
    """What tracing writes to on its way."""

    over: Array
    """(P,) contour of each part passed since its last sample, px."""

    crossings: Array
    """(2, 6) point and unit normal where the contour enters and leaves a face."""

    place: Array
    """(6,) the same of a sample."""


@compiled
def _nearest(view: View, u: float, v: float) -> float:
    """Inverse depth of what is seen at a pixel, 0 for nothing."""
    height, width = view.depths.shape
    j = min(max(int(np.round(u / view.cell_px)), 0), width - 1)
    i = min(max(int(np.round(v / view.cell_px)), 0), height - 1)
    return float(view.depths[i, j])


@compiled
def _covered(view: View, u: float, v: float, depth: float) -> bool:
    """Whether something at a pixel is well before a depth, metres."""
    return _nearest(view, u, v) * (depth - _COVERED_M) > 1.0


@compiled
def _state(view: View, place: tuple[float, float], normal: tuple[float, float], depth: float, contact_m: float) -> int:
    """Whether a contour is seen: judged by what is in its place, and by what is seen beside it.

    Args:
        view: with its depths.
        place: pixel.
        normal: unit image normal, outwards.
        depth: of the contour, metres.
        contact_m: see `Spacing`.
    """
    if _covered(view, place[0], place[1], depth):
        return HIDDEN
    away = _BESIDE * view.cell_px
    behind = _nearest(view, place[0] + away * normal[0], place[1] + away * normal[1])
    if behind * (depth - _HIDDEN_M) > 1.0:
        return HIDDEN
    return BETWEEN if behind * (depth + contact_m) > 1.0 else VISIBLE


@compiled
def _write(
    view: View,
    point: tuple[float, float, float],
    normal: tuple[float, float],
    part: int,
    spacing: Spacing,
    found: Found,
    n: int,
) -> int:
    """Adds a sample if it is seen; the number of samples."""
    u, v, depth = project_point(view.camera, point[0], point[1], point[2])
    inside = -0.5 <= u <= view.width - 0.5 and -0.5 <= v <= view.height - 0.5
    if not inside or n == len(found.parts):
        return n
    state = _state(view, (u, v), normal, depth, spacing.contact_m)
    if state == HIDDEN:
        return n
    found.positions[n, 0], found.positions[n, 1] = u, v
    found.positions[n, 2], found.positions[n, 3] = normal[0], normal[1]
    found.positions[n, 4] = spacing.step_px if state == VISIBLE else 0.0
    found.points[n, 0], found.points[n, 1], found.points[n, 2] = point[0], point[1], point[2]
    found.parts[n], found.between[n] = part, state == BETWEEN
    return n + 1


@compiled
def _cross(
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
def _image_normal(
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


@compiled
def _turns_away(points: Array32, facing: Array32, face: tuple[int, int, int], camera: Array) -> bool:
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
def _bent(crossings: Array, t: float, place: Array) -> None:
    """Point and normal (6,) of the surface at a share t of the way between two crossings (2, 6)."""
    turn = 0.0
    for k in range(3):
        turn += (crossings[1, 3 + k] - crossings[0, 3 + k]) * (crossings[1, k] - crossings[0, k])
        place[3 + k] = crossings[0, 3 + k] + t * (crossings[1, 3 + k] - crossings[0, 3 + k])
    for k in range(3):
        place[k] = crossings[0, k] + t * (crossings[1, k] - crossings[0, k]) + 0.5 * t * (1.0 - t) * turn * place[3 + k]


@compiled
def _trace_faces(
    mesh: Mesh, points: Array32, normals: Array32, view: View, spacing: Spacing, work: Work, found: Found
) -> int:
    """Samples where the smooth surface turns away from the camera; their number.

    On a hollow the farther side faces the camera: such a contour is never seen.
    """
    facing, seen, n = view.facing, view.seen, 0
    for f in range(mesh.n_traced):
        p, q, r = mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2]
        a, b, c = facing[p] > 0.0, facing[q] > 0.0, facing[r] > 0.0
        if a == b and b == c:
            continue
        if a == c:
            p, q, r = q, r, p
        elif a == b:
            p, q, r = r, p, q
        before = seen[p, 2] > 0.0 and seen[q, 2] > 0.0 and seen[r, 2] > 0.0
        if not before or not _turns_away(points, facing, (p, q, r), view.camera):
            continue
        s, t = facing[p] / (facing[p] - facing[q]), facing[p] / (facing[p] - facing[r])
        u, v = seen[p, 0] + s * (seen[q, 0] - seen[p, 0]), seen[p, 1] + s * (seen[q, 1] - seen[p, 1])
        du, dv = seen[p, 0] + t * (seen[r, 0] - seen[p, 0]) - u, seen[p, 1] + t * (seen[r, 1] - seen[p, 1]) - v
        length, part = np.sqrt(du * du + dv * dv), mesh.parts[f]
        passed = spacing.step_px - work.over[part]
        work.over[part] += length
        if work.over[part] < spacing.step_px:
            continue
        if _covered(view, u + 0.5 * du, v + 0.5 * dv, 1.0 / max(seen[p, 2], seen[q, 2], seen[r, 2])):
            work.over[part] %= spacing.step_px
            continue
        _cross(points, normals, facing, (p, q), work.crossings, 0)
        _cross(points, normals, facing, (p, r), work.crossings, 1)
        while work.over[part] >= spacing.step_px:
            work.over[part] -= spacing.step_px
            _bent(work.crossings, passed / length, work.place)
            passed += spacing.step_px
            point = work.place[0], work.place[1], work.place[2]
            normal = _image_normal(view.camera, point, (work.place[3], work.place[4], work.place[5]))
            n = _write(view, point, normal, part, spacing, found, n)
    return n


@compiled
def _trace_borders(mesh: Mesh, points: Array32, view: View, spacing: Spacing, work: Work, found: Found, n: int) -> int:
    """Samples on the open borders of faces seen from outside; the number of all samples."""
    for e in range(len(mesh.borders)):
        p, q, r, f = mesh.borders[e, 0], mesh.borders[e, 1], mesh.borders[e, 2], mesh.borders[e, 3]
        if not view.front[f]:
            continue
        du, dv = float(view.seen[q, 0] - view.seen[p, 0]), float(view.seen[q, 1] - view.seen[p, 1])
        length = np.sqrt(du * du + dv * dv)
        part = mesh.parts[f]
        place = spacing.step_px - work.over[part]
        work.over[part] += length
        if work.over[part] < spacing.step_px or length <= 0.0:
            continue
        nu, nv = dv / length, -du / length
        if (view.seen[r, 0] - view.seen[p, 0]) * nu + (view.seen[r, 1] - view.seen[p, 1]) * nv > 0.0:
            nu, nv = -nu, -nv
        while work.over[part] >= spacing.step_px:
            work.over[part] -= spacing.step_px
            t = place / length
            place += spacing.step_px
            x = points[p, 0] + t * (points[q, 0] - points[p, 0])
            y = points[p, 1] + t * (points[q, 1] - points[p, 1])
            z = points[p, 2] + t * (points[q, 2] - points[p, 2])
            n = _write(view, (x, y, z), (nu, nv), part, spacing, found, n)
    return n


@compiled
def trace_skins(
    placements: Array,
    part_from_rest: Array,
    mesh: Mesh,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float, float],
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
    counts: Integers,
) -> None:
    """Visible occluding-contour samples of meshes that move with the parts of many poses, in all views.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        part_from_rest: (P, 4, 4) from the pose that the surface was measured in.
        mesh: of the scene.
        cameras: (V, 28) from `Rig.packed`.
        sizes: (V, 2) image sizes, px.
        spacing: contour a sample stands for, px; distance at which surfaces touch, metres; cells of the depth
            pictures along the longer side of an image.
        positions, points, parts, between, counts: outputs, laid out as in `Contours`.
    """
    n_vertices = len(mesh.points)
    motions = np.zeros((mesh.n_parts, 3, 4), dtype=np.float32)
    world, normals = np.zeros((n_vertices, 3), dtype=np.float32), np.zeros((n_vertices, 3), dtype=np.float32)
    seen, facing = np.zeros((n_vertices, 3), dtype=np.float32), np.zeros(n_vertices, dtype=np.float32)
    front = np.zeros(len(mesh.faces), dtype=np.bool_)
    work = Work(np.zeros(mesh.n_parts), np.zeros((2, 6)), np.zeros(6))
    lenses = cameras.astype(np.float32)
    cut = Spacing(spacing[0], spacing[1])
    for b in range(len(placements)):
        motions_of(placements, b, part_from_rest, motions)
        pose_mesh(mesh, motions, world, normals)
        for v in range(len(cameras)):
            width, height = sizes[v, 0], sizes[v, 1]
            cell_px = max(width, height) / spacing[2]
            depths = np.empty((int(height / cell_px) + 1, int(width / cell_px) + 1), dtype=np.float32)
            see_vertices(world, normals, lenses[v], seen, facing)
            find_front(mesh, seen, front)
            draw_depths(mesh, seen, front, cell_px, depths)
            view = View(cameras[v], width, height, cell_px, depths, seen, facing, front)
            found = Found(positions[b, v], points[b, v], parts[b, v], between[b, v])
            work.over[:] = 0.5 * cut.step_px
            n = _trace_faces(mesh, world, normals, view, cut, work, found)
            counts[b, v] = _trace_borders(mesh, world, view, cut, work, found, n)
