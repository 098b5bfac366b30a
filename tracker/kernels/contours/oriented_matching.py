"""Nearest neighbours between model contours and scene edges whose directions agree, and their normal equations."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask


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
