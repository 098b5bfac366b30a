"""Planes through two cameras that touch a foreground: they touch the other view's, too, at the same moment."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, Mask

_AT_BORDER_RAD = 1e-3
"""A plane that touches what the border of the image cuts, to so much, does not touch the person there."""

Tangents = dict[tuple[int, int], Array]
"""Two views -> (2, T, 2): in each of them, in each frame, the angles of the first and the last plane that touch."""


def tangents(rig: Rig, regions: Sequence[Sequence[Mask | None]], factor: int) -> Tangents:
    """Angles of the epipolar planes that touch the foregrounds, for all pairs of views, radians.

    A point of the surface where such a plane touches it is on the outline of both views (a frontier point), so that the
    angles of both views are the same at the same moment, whatever moves (Sinha & Pollefeys 2004).

    Args:
        rig: V cameras of the whole images.
        regions: T x V small foregrounds (h, w); None where nothing is shown.
        factor: pixels of an image to one of a region.

    Returns:
        NaN where nothing is shown, where the border of the image cuts it, and where a camera is seen inside.
    """
    pixels = [[None if region is None else np.flatnonzero(region) for region in row] for row in regions]
    shapes = [next((shown.shape for row in regions if (shown := row[v]) is not None), None) for v in range(len(rig))]
    rays = [None if shape is None else _rays(rig, v, shape, factor) for v, shape in enumerate(shapes)]
    found: Tangents = {}
    for one, other in itertools.combinations(range(len(rig)), 2):
        across = _across(rig, one, other)
        ends = np.full((2, len(regions), 2), np.nan)
        for k, v in enumerate((one, other)):
            if (shape := shapes[v]) is not None and (directions := rays[v]) is not None:
                angles = np.arctan2(directions @ across[1], directions @ across[0])
                border = _border(shape)
                for t, row in enumerate(pixels):
                    if (numbers := row[v]) is not None:
                        ends[k, t] = _touching(angles, numbers, border)
        found[one, other] = ends
    return found


def _rays(rig: Rig, view: int, shape: tuple[int, ...], factor: int) -> Array:
    """Directions (h * w, 3) in the world of the pixels of a small image."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2) * factor + (factor - 1) / 2
    return rig.cameras[view].rays(pixels, clamped=True)


def _across(rig: Rig, one: int, other: int) -> Array:
    """Two directions (2, 3) across the line of two cameras; the first one shows to where all cameras look."""
    centres = rig.cameras[one].centre, rig.cameras[other].centre
    along = (centres[1] - centres[0]) / np.linalg.norm(centres[1] - centres[0])
    aside = rig.middle - centres[0]
    aside = aside - along * (aside @ along)
    aside /= np.linalg.norm(aside)
    return np.stack([aside, np.cross(along, aside)])


def _border(shape: tuple[int, ...]) -> Mask:
    border = np.ones(shape, dtype=np.bool_)
    border[1:-1, 1:-1] = False
    return border.ravel()


def _touching(angles: Array, shown: Integers, border: Mask) -> tuple[float, float]:
    """The first and the last angle of some pixels; NaN where the border cuts them off, or they lie all around."""
    seen = angles[shown]
    first, last = float(seen.min()), float(seen.max())
    if last - first > np.pi:
        return np.nan, np.nan
    cut = seen[border[shown]]
    if len(cut):
        first = np.nan if cut.min() <= first + _AT_BORDER_RAD else first
        last = np.nan if cut.max() >= last - _AT_BORDER_RAD else last
    return first, last
