"""Nearest neighbours between model contours and scene edges whose directions agree, and their normal equations."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_along
from tracker.kernels.rows import sample, scene_point

_COLUMN_PX, _N_COLUMNS = 32.0, 64
"""Width and number of the columns of an image whose last find tells where to look next."""


@compiled
def _nearest(
    rows: Array32,
    span: tuple[int, int, int],
    query: tuple[float, float, float, float],
    gate: tuple[float, float],
    likely: int,
) -> int:
    """Index of the row (x, y, direction x, y) nearest to the query whose direction agrees, -1 if there is none.

    The search goes up and down from the query until rows are farther away in y alone than the best found.

    Args:
        rows: sorted by y.
        span: which of them: the first, the first that is not above the query, the end.
        query: position and direction.
        gate: largest distance, px, and smallest cosine.
        likely: a row that may be near; what is farther off than it is not looked at. -1 for none.
    """
    x, y, nx, ny = query
    radius, cosine = gate
    best, found = radius * radius, -1
    low, start, high = span
    if likely >= 0 and abs(nx * rows[likely, 2] + ny * rows[likely, 3]) >= cosine:
        dx, dy = rows[likely, 0] - x, rows[likely, 1] - y
        # A little more, so that the row itself, or an equal one before it, is found as it would be without.
        best = min(best, (dx * dx + dy * dy) * 1.00001 + 1e-9)
    for i in range(start, high):
        dy = rows[i, 1] - y
        if dy * dy >= best:
            break
        dx = rows[i, 0] - x
        distance = dx * dx + dy * dy
        if distance < best and abs(nx * rows[i, 2] + ny * rows[i, 3]) >= cosine:
            best, found = distance, i
    for i in range(start - 1, low - 1, -1):
        dy = rows[i, 1] - y
        if dy * dy >= best:
            break
        dx = rows[i, 0] - x
        distance = dx * dx + dy * dy
        if distance < best and abs(nx * rows[i, 2] + ny * rows[i, 3]) >= cosine:
            best, found = distance, i
    return found


@compiled
def _column(x: float) -> int:
    return int(min(max(x / _COLUMN_PX, 0.0), _N_COLUMNS - 1.0))


@compiled
def match_oriented(
    positions: Array32, counts: Integers, scene: Array32, first: Integers, gate: tuple[float, float], pairs: Integers
) -> int:
    """Oriented nearest neighbours from the model to the scene and from the scene to the model.

    Args:
        positions: (V, M, 5) model samples of one pose; those of weight 0 are not matched.
        counts: (V,) valid ones.
        scene, first: scene points from `Observation.packed`, each view's sorted by y.
        gate: largest distance, px, and smallest cosine between the directions (modulo sign).
        pairs: (N, 4) output: view, model sample, scene point, 0 for model to scene or 1 for scene to model.

    Returns:
        Number of pairs found.
    """
    n = 0
    likely = np.empty((2, _N_COLUMNS), dtype=np.int64)
    for v in range(len(counts)):
        order = np.argsort(positions[v, : counts[v], 1])
        model = np.zeros((counts[v], 4), dtype=np.float32)
        samples = np.zeros(counts[v], dtype=np.int64)
        n_model = 0
        for m in order:
            if positions[v, m, sample.LENGTH] > 0.0:
                for k in range(4):
                    model[n_model, k] = positions[v, m, k]
                samples[n_model] = m
                n_model += 1
        likely[:] = -1
        start = first[v]
        for i in range(n_model):
            query = (model[i, 0], model[i, 1], model[i, 2], model[i, 3])
            while start < first[v + 1] and scene[start, scene_point.Y] < query[1]:
                start += 1
            column = _column(query[0])
            found = _nearest(scene, (first[v], start, first[v + 1]), query, gate, likely[0, column])
            if found >= 0:
                likely[0, column] = found
                if n < len(pairs):
                    pairs[n, 0], pairs[n, 1], pairs[n, 2], pairs[n, 3] = v, samples[i], found, 0
                    n += 1
        start = 0
        for s in range(first[v], first[v + 1]):
            query = scene[s, scene_point.X], scene[s, scene_point.Y], scene[s, scene_point.DX], scene[s, scene_point.DY]
            while start < n_model and model[start, 1] < query[1]:
                start += 1
            column = _column(query[0])
            found = _nearest(model, (0, start, n_model), query, gate, likely[1, column])
            if found >= 0:
                likely[1, column] = found
                if n < len(pairs):
                    pairs[n, 0], pairs[n, 1], pairs[n, 2], pairs[n, 3] = v, samples[found], s, 1
                    n += 1
    return n


@compiled
def _chains(moves: Mask) -> tuple[Integers, Integers]:
    """For each last parameter, the parameters that move what hangs on it (J, dof), and how many (J,)."""
    dof, n_ends = moves.shape
    chains, lengths = np.zeros((n_ends, dof), dtype=np.int64), np.zeros(n_ends, dtype=np.int64)
    for j in range(n_ends):
        for d in range(dof):
            if moves[d, j]:
                chains[j, lengths[j]] = d
                lengths[j] += 1
    return chains, lengths


@compiled(fastmath={"contract", "nsz"})
def normal_equations(
    pairs: Integers,
    positions: Array32,
    points: Array32,
    parts: Integers,
    ends: Integers,
    scene: Array32,
    cameras: Array,
    twists: Array,
    moves: Mask,
    px_per_observation: float,
    robust_px: float,
) -> tuple[Array, Array, float, float]:
    """Normal equations of the point-to-contour residuals, robustly weighted (Geman & McClure).

    The twin is `Correspondences.residual` with J^T W J and J^T W r.

    Args:
        pairs: (N, 4) from `match_oriented`.
        positions, points: (V, M, 5), (V, M, 3) model samples of one pose.
        parts: (V, M) their scene-wide parts.
        ends: (P,) last parameter that moves each part; -2 for parts of other persons, whose pairs do not count.
        scene: (S, 5) scene points from `Observation.packed`.
        cameras: (V, 29) from `Rig.packed`.
        twists: (dof, 6) spatial twists of the parameters.
        moves: (dof, dof + 1) from `BodyModel.moves`.
        px_per_observation: contour length that counts as one observation, px.
        robust_px: residual at which a pair's weight has fallen to a quarter, px.

    Returns:
        J^T W J (dof, dof), J^T W r (dof,), sum of w r^2 and sum of w.
    """
    dof = len(twists)
    matrix, vector, row = np.zeros((dof, dof)), np.zeros(dof), np.zeros(dof)
    chains, lengths = _chains(moves)
    squares = total = 0.0
    for i in range(len(pairs)):
        view, m, s = pairs[i, 0], pairs[i, 1], pairs[i, 2]
        end = ends[parts[view, m]]
        if end < -1:
            continue
        x, y, z = float(points[view, m, 0]), float(points[view, m, 1]), float(points[view, m, 2])
        nu, nv = float(positions[view, m, 2]), float(positions[view, m, 3])
        length = positions[view, m, sample.LENGTH] if pairs[i, 3] == 0 else scene[s, scene_point.WEIGHT]
        u, v, sx, sy, sz = project_along(cameras, view, (x, y, z), (nu, nv))
        residual = (u - scene[s, scene_point.X]) * nu + (v - scene[s, scene_point.Y]) * nv
        weight = length / px_per_observation / (1.0 + (residual / robust_px) ** 2) ** 2
        n = lengths[end]
        for k in range(n):
            d = chains[end, k]
            w0, w1, w2 = twists[d, 3], twists[d, 4], twists[d, 5]
            row[k] = (
                sx * (twists[d, 0] + w1 * z - w2 * y)
                + sy * (twists[d, 1] + w2 * x - w0 * z)
                + sz * (twists[d, 2] + w0 * y - w1 * x)
            )
        for k in range(n):
            d, weighted = chains[end, k], weight * row[k]
            vector[d] += weighted * residual
            for j in range(k + 1):
                matrix[d, chains[end, j]] += weighted * row[j]
        squares += weight * residual * residual
        total += weight
    for a in range(dof):
        for c in range(a):
            matrix[c, a] = matrix[a, c]
    return matrix, vector, squares, total
