"""Where followed points come from: measured surfaces, and places given by hand."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers
from tracker.following.points import NewPoints
from tracker.lsm.surface import Surface


def points_of_surface(surface: Surface) -> NewPoints:
    """Every measured point of a surface; patches across views are as they were matched."""
    pixels = surface.points.pixels
    n_views, n = pixels.shape[:2]
    across, variances = np.tile(np.eye(2), (n_views, n, 1, 1)), np.zeros((n_views, n, 3))
    for v, field in enumerate(surface.fields):
        if field is not None:
            cells = field.cells_of(pixels[surface.template])
            across[v] = field.matches.affine[cells]
            variances[v] = field.found[cells][:, 9:12]
    step = next(field.step_px for field in surface.fields if field is not None)
    return NewPoints(pixels, across, variances, surface.points.points, surface.points.covariances, step)


def points_of_image(pixels: Array) -> NewPoints:
    """Places (M, 2) px of a single view: 2-D mode."""
    n = len(pixels)
    unit, unknown = np.tile(np.eye(2), (1, n, 1, 1)), np.full((n, 3), np.nan)
    places = np.asarray(pixels, dtype=np.float64)[None]
    return NewPoints(places, unit, np.zeros((1, n, 3)), unknown, np.full((n, 3, 3), np.nan))


def chosen_evenly(n: int, wanted: int, seed: int = 0) -> Integers:
    """Rows of `wanted` of n points, spread at random but always the same."""
    order = np.random.default_rng(seed).permutation(n)
    return np.sort(order[:wanted])
