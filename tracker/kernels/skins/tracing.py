"""Visible occluding-contour samples of skinned meshes, without rendering a picture.

The contour of the smooth surface (`smooth_contours`) is followed across the faces of a mesh, cut into samples of equal
length, and tested for visibility (`visibility`). Open borders of faces seen from outside are contours as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point
from tracker.kernels.skins.depths import draw_depths, find_front, see_vertices
from tracker.kernels.skins.mesh import Mesh, motions_of, pose_mesh
from tracker.kernels.skins.smooth_contours import bent, cross_edge, image_normal, turns_away
from tracker.kernels.skins.visibility import BETWEEN, HIDDEN, VISIBLE, View, covered, state_of


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
    inside = depth > 0.0 and -0.5 <= u <= view.width - 0.5 and -0.5 <= v <= view.height - 0.5
    if not inside or n == len(found.parts):
        return n
    state = state_of(view, (u, v), normal, depth, spacing.contact_m)
    if state == HIDDEN:
        return n
    found.positions[n, 0], found.positions[n, 1] = u, v
    found.positions[n, 2], found.positions[n, 3] = normal[0], normal[1]
    found.positions[n, 4] = spacing.step_px if state == VISIBLE else 0.0
    found.points[n, 0], found.points[n, 1], found.points[n, 2] = point[0], point[1], point[2]
    found.parts[n], found.between[n] = part, state == BETWEEN
    return n + 1


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
        if not before or not turns_away(points, facing, (p, q, r), view.camera):
            continue
        s, t = facing[p] / (facing[p] - facing[q]), facing[p] / (facing[p] - facing[r])
        u, v = seen[p, 0] + s * (seen[q, 0] - seen[p, 0]), seen[p, 1] + s * (seen[q, 1] - seen[p, 1])
        du, dv = seen[p, 0] + t * (seen[r, 0] - seen[p, 0]) - u, seen[p, 1] + t * (seen[r, 1] - seen[p, 1]) - v
        length, part = np.sqrt(du * du + dv * dv), mesh.parts[f]
        passed = spacing.step_px - work.over[part]
        work.over[part] += length
        if work.over[part] < spacing.step_px:
            continue
        if covered(view, u + 0.5 * du, v + 0.5 * dv, 1.0 / max(seen[p, 2], seen[q, 2], seen[r, 2])):
            work.over[part] %= spacing.step_px
            continue
        cross_edge(points, normals, facing, (p, q), work.crossings, 0)
        cross_edge(points, normals, facing, (p, r), work.crossings, 1)
        while work.over[part] >= spacing.step_px:
            work.over[part] -= spacing.step_px
            bent(work.crossings, passed / length, work.place)
            passed += spacing.step_px
            point = work.place[0], work.place[1], work.place[2]
            normal = image_normal(view.camera, point, (work.place[3], work.place[4], work.place[5]))
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
        cameras: (V, 29) from `Rig.packed`.
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
