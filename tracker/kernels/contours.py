"""Occluding contours of a posed body, found and compared with edges, for `synthesis`, `similarity` and `estimation`."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.kernels.rows import WORKSPACE_ROW, SampleRow

# Where a surface grid turns away from a camera: crossings of the grid's edges, joined to pieces of contour.
#
# A point of a surface with outward normal n lies on the occluding contour of a camera at c where n . (c - p) = 0.
# The contour crosses the grid's edges where that product changes sign; the crossings of a cell are joined to a piece
# of contour (marching squares) and the pieces to chains. A row of signs is the bits of one integer, so that rows and
# cells without a crossing cost next to nothing. Every edge has a point in its middle; between the nearer two the
# surface is bent by the turn of its normals: a 9 x 16 grid is good to a fraction of a pixel.

MOST_COLUMNS = 62
"""Columns of a grid that fit into one integer."""

MOST_ROWS = 400
"""Rows of a grid whose contour has room: it crosses each row and each column twice, and two rows more must fit."""


# Visible occluding-contour samples of tapered superquadrics, without rendering a picture.
#
# The pieces of contour of each part are found on its surface grid (`contour_pieces`), cut into samples of equal
# length, bent by the turn of their normals, and tested for visibility (`occlusion`). The cost does not depend on the
# image size.


def trace_contours(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    exact: bool,
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
    counts: Integers,
) -> int:
    """Visible occluding-contour samples of many poses in all views.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        grids, planes, layout, bounds: of the surfaces, see `tracker.kernels.descent.Tracing`.
        cameras: (V, 29) from `Rig.packed`.
        sizes: (V, 2) image sizes, px.
        spacing: contour a sample stands for, px; distance at which parts touch, metres.
        exact: place pixels where the points are seen, or else where they are traced, as `score_poses` does: bent in
            the image and in space, a sample's pixel and point are up to 0.05 px apart.
        positions: (B, V, M, 5) output: pixel, image normal, contour length.
        points: (B, V, M, 3) output: world positions.
        parts, between, counts: outputs, laid out as in `Contours`.

    Returns:
        Most samples traced in a view; with M there may be more. Of these `exact` may place some outside of the image.
    """
    return native.trace_contours(
        placements,
        shapes,
        grids,
        planes,
        layout,
        bounds,
        cameras,
        sizes,
        spacing,
        exact,
        positions,
        points,
        parts,
        between,
        counts,
    )


# Directed chamfer distances between model contours and scene edges, batched over poses.


def directed_distances(
    positions: Array32,
    counts: Integers,
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    theta: float,
    reject: bool,
) -> Array:
    """Normalized directed chamfer distances in both directions (paper, eqs. 1 and 2).

    Args:
        positions: (B, V, M, 5) model samples from `Contours`.
        counts: (B, V) valid ones.
        flat, regions, scene, first: the observation, from `Observation.packed`.
        theta: distance at which a point is an outlier, px.
        reject: reject outliers as the paper does, or else clamp them at theta.

    Returns:
        (B, V, 2) px: model to scene, scene to model; NaN for a missing view.
    """
    distances = np.full((*counts.shape, 2), np.nan)
    native.directed_distances(positions, counts, flat, regions, scene, first, theta, reject, distances)
    return distances


# Nearest neighbours between model contours and scene edges whose directions agree, and their normal equations.


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
    return native.match_oriented(positions, counts, scene, first, gate, pairs)


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
    matrix, vector = np.empty((len(twists), len(twists))), np.empty(len(twists))
    samples, rules = (positions, points, parts), (px_per_observation, robust_px)
    squares, total = native.normal_equations(
        pairs, *samples, ends, scene, cameras, twists, moves, *rules, matrix, vector
    )
    return matrix, vector, squares, total


# Poses synthesized and compared with an observation in one go: no contour is written to memory.
#
# In a decomposed search most parts of the body stand still. They are traced once for all its poses; of each only the
# moving parts are traced, and tested for what they hide of the others. Parts that stand as in the pose before are not
# even drawn again: side by side with other searches of the same limb half of the moving ones do.


def moving_parts(placements: Array) -> Mask:
    """Parts (P,) whose placements (B, P, 4, 4) are not the same in all poses; all of them where B is 0 or 1."""
    moving = np.zeros(placements.shape[1], dtype=np.bool_)
    native.moving_parts(placements, moving)
    return moving


def trace_still(
    placements: Array,
    still: Mask,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
) -> tuple[Array32, Integers]:
    """Contour samples of the parts that stand still in a search, for `score_poses`; nothing else covers them here.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres; the first one counts.
        still: (P,) the parts.
        shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.

    Returns:
        (V, ROW, 13) samples, see `trace_view`; (V,) their numbers.
    """
    samples = np.zeros((len(cameras), WORKSPACE_ROW, SampleRow.N_COLUMNS), dtype=np.float32)
    counts = np.zeros(len(cameras), dtype=np.int64)
    if still.any():
        body = shapes, grids, planes, layout, bounds
        native.trace_still(placements, still, *body, cameras, sizes, spacing, samples, counts)
    return samples, counts


def score_poses(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    rule: tuple[float, bool],
    moving: Mask,
    standing: tuple[Array32, Integers],
) -> Array:
    """Directed chamfer distances of many poses; the twin is `trace_contours` and `directed_distances`.

    Args:
        placements, shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.
        flat, regions, scene, first: the observation, from `Observation.packed`.
        rule: distance at which a point is an outlier, px; reject outliers as the paper does, or else clamp them.
        moving: (P,) parts that do not stand still, at least those of `moving_parts`.
        standing: of the other parts, from `trace_still`.

    Returns:
        (B, V, 2) px: model to scene, scene to model; NaN for a missing view.
    """
    body, edges = (shapes, grids, planes, layout, bounds), (flat, regions, scene, first)
    distances = np.full((len(placements), len(cameras), 2), np.nan)
    native.score_poses(placements, *body, cameras, sizes, spacing, *edges, rule, moving, *standing, distances)
    return distances


def edge_shares(
    positions: Array32,
    parts: Integers,
    counts: Integers,
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    reach: Array32,
    near_px: tuple[float, float],
    sums: Array,
) -> None:
    """Adds up over all views what the contours of one pose and the edges leave of each other.

    Args:
        positions: (V, M, 5) contour samples from `Contours`; those of length 0 explain edges and count as none, as
            do those where the chamfer image is negative, for something hides them.
        parts: (V, M) part of each.
        counts: (V,) valid ones.
        flat, regions, scene, first, reach: the observation, from `Observation.packed`.
        near_px: how close to an edge a sample counts as explained, and how far from all samples an edge as missed.
        sums: (4, V, P) output, px: visible contour; times its distance to the edges; explained; length of edges far
            from all samples, by the part of the nearest.
    """
    native.edge_shares(positions, parts, counts, flat, regions, scene, first, reach, near_px, sums)
