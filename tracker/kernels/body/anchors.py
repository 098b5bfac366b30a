"""Places on parts that are followed in images: how far from there parts carry them, and the equations that bring them.

Places lie on the surface where a viewing ray met it, so they are surest across that ray.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Integers, Mask


class Carried(NamedTuple):
    """N places on parts of a scene, and where an image shows them."""

    views: Integers
    """(N,) whose image."""

    parts: Integers
    """(N,) of the scene."""

    places: Array
    """(N, 3) in the part's frame, metres."""

    normals: Array
    """(N, 3) unit vectors out of the surface, in the part's frame."""

    rays: Array
    """(N, 3) unit vectors along the ray by which the place was found, in the part's frame."""

    depths_m: Array
    """(N,) standard deviation of the place along that ray, metres."""

    pixels: Array
    """(N, 2) where the image shows it."""

    variances: Array
    """(N,) of the pixel in either axis, px^2."""


def gaps_of(placements: Array, cameras: Array, carried: Carried, most_m: float, gaps: Array) -> None:
    """How far from where they are shown poses carry the places, px; no more than a distance on the body.

    Args:
        placements: (B, P, 4, 4) world_from_part.
        cameras: (V, 29) from `Rig.packed`.
        carried: the places.
        most_m: that distance, metres; also of what lies behind the camera.
        gaps: (B, N) output.
    """
    native.gaps_of(placements, cameras, carried, most_m, gaps)


def residuals_of(placements: Array, cameras: Array, carried: Carried, slide_m: float, found: Array) -> None:
    """Where a pose carries the places, less where they are shown.

    Args:
        placements: (1, P, 4, 4) world_from_part.
        cameras: (V, 29) from `Rig.packed`.
        carried: the places.
        slide_m: standard deviation of a place across its ray, for clothes slide, metres.
        found: (N, 10) output, a row each; `tracker.kernels.rows.carried_place` names the columns.
    """
    native.residuals_of(placements, cameras, carried, slide_m, found)


def anchor_equations(
    placements: Array, carried: Carried, found: Array, weights: Array, ends: Integers, twists: Array, moves: Mask
) -> tuple[Array, Array, float, float]:
    """Normal equations that bring the places to where they are shown.

    By wrenches, see native/body/wrenches.hpp.

    Args:
        placements: (1, P, 4, 4) world_from_part.
        carried: the places.
        found: (N, 10) from `residuals_of`.
        weights: (N,) px^-2.
        ends: (P,) last parameter that moves each part, -1 for the world; -2 for parts that do not count.
        twists: (dof, 6) spatial twists of the parameters.
        moves: (dof, dof + 1) from `BodyModel.moves`.

    Returns:
        J^T W J (dof, dof), J^T W r (dof,), sum of w r^2 and sum of w; each place has two residuals.
    """
    matrix, vector = np.empty((len(twists), len(twists))), np.empty(len(twists))
    sums = native.anchor_equations(placements, carried, found, weights, ends, twists, moves, matrix, vector)
    return matrix, vector, *sums
