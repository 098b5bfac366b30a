"""Whether a contour of a mesh is seen, judged by a coarse depth picture of its view.

A surface must not hide its own contour: what is in a contour's place may be nearer than what is beside it, by as much
as a surface bulges within a cell of the picture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Array32, Mask
from tracker.kernels.compilation import compiled

_BESIDE = 1.5
"""So many cells outside of a contour is looked what is there: nearer, the cell may still show the surface itself."""

_HIDDEN_M, _COVERED_M = 0.03, 0.05
"""What is beside a contour and so much nearer to the camera hides it; at the contour itself a surface may bulge that
much towards the camera within a cell (limbs 3 cm, a trunk 5 cm)."""

VISIBLE, BETWEEN, HIDDEN = 0, 1, 2
"""What a sample is."""


class View(NamedTuple):
    """A view that meshes are traced in."""

    camera: Array
    """(29,) row of `Rig.packed`."""

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


@compiled
def _nearest(view: View, u: float, v: float) -> float:
    """Inverse depth of what is seen at a pixel, 0 for nothing."""
    height, width = view.depths.shape
    j = min(max(int(np.round(u / view.cell_px)), 0), width - 1)
    i = min(max(int(np.round(v / view.cell_px)), 0), height - 1)
    return float(view.depths[i, j])


@compiled
def covered(view: View, u: float, v: float, depth: float) -> bool:
    """Whether something at a pixel is well before a depth, metres."""
    return _nearest(view, u, v) * (depth - _COVERED_M) > 1.0


@compiled
def state_of(
    view: View, place: tuple[float, float], normal: tuple[float, float], depth: float, contact_m: float
) -> int:
    """Whether a contour is seen: judged by what is in its place, and by what is seen beside it.

    Args:
        view: with its depths.
        place: pixel.
        normal: unit image normal, outwards.
        depth: of the contour, metres.
        contact_m: distance at which surfaces touch, metres.

    Returns:
        `VISIBLE`, `BETWEEN` (seen, with another surface behind that it touches) or `HIDDEN`.
    """
    if covered(view, place[0], place[1], depth):
        return HIDDEN
    away = _BESIDE * view.cell_px
    behind = _nearest(view, place[0] + away * normal[0], place[1] + away * normal[1])
    if behind * (depth - _HIDDEN_M) > 1.0:
        return HIDDEN
    return BETWEEN if behind * (depth + contact_m) > 1.0 else VISIBLE
