"""Colours learnt along the lines across contours: on both sides of them, and of what hides them."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Image, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.regions.colours import HIDDEN, N_COLOURS, Picture, Tables, colour_at, learn_colours
from tracker.kernels.regions.lines import BACKGROUND, DEEPEST, NEAR, Samples, pixels_per_metre

_LEARNT_INSIDE, _LEARNT_OUTSIDE = 12, 22
"""Steps inside and outside whose colours are learnt."""


@compiled
def learn_lines(
    picture: Picture,
    samples: Samples,
    beside: Integers,
    cameras: Array,
    half_extents: Array,
    useful: Mask,
    step_m: float,
    news: float,
    posteriors: Image,
    tables: Tables,
) -> Mask:
    """Learns the colours on both sides of contours, and those of what hides them.

    Args:
        picture: colours seen.
        samples: contour samples of one pose.
        beside: (V, M, 2) parts seen at the `SPOTS`; a part's pixels are not the background.
        cameras: (V, 29) from `Rig.packed`.
        half_extents: (P,) metres, see `Looks`.
        useful: (V, M) samples to learn from.
        step_m: see `Rule`.
        news: weight of what is seen now.
        posteriors: (V, P, 4096) of the frame before: a line that shows a hider inside teaches how that looks.
        tables: in and out.

    Returns:
        (V, P) tables that changed.
    """
    n_views, n_parts = tables.inside.shape[:2]
    changed = np.zeros((n_views, n_parts), dtype=np.bool_)
    inside, outside = np.zeros(N_COLOURS, dtype=np.int64), np.zeros(N_COLOURS, dtype=np.int64)
    hidden = np.zeros(N_COLOURS, dtype=np.int64)
    for v in range(n_views):
        hidden[:] = 0
        for p in range(n_parts):
            inside[:] = 0
            outside[:] = 0
            n = 0
            for m in range(samples.counts[v]):
                if samples.parts[v, m] == p and useful[v, m]:
                    _count_line(
                        picture,
                        samples,
                        beside,
                        cameras,
                        half_extents,
                        step_m,
                        v,
                        m,
                        posteriors,
                        inside,
                        outside,
                        hidden,
                    )
                    n += 1
            if n > 0:
                changed[v, p] = learn_colours(inside, news, tables.inside[v, p])
                changed[v, p] |= learn_colours(outside, news, tables.outside[v, p])
        if learn_colours(hidden, news, tables.hiders[v]):
            changed[v] = True
    return changed


@compiled
def longest_lines(samples: Samples, cameras: Array, step_m: float, longest_px: Array) -> None:
    """How far from a view's contour colours are learnt, px, with the pixel that the last step is rounded to.

    Args:
        samples: contour samples of one pose.
        cameras: (V, 29) from `Rig.packed`.
        step_m: see `Rule`.
        longest_px: (V,) output.
    """
    for v in range(len(longest_px)):
        longest_px[v] = 1.0
        for m in range(samples.counts[v]):
            x, y, z = samples.points[v, m, 0], samples.points[v, m, 1], samples.points[v, m, 2]
            step_px = max(pixels_per_metre(cameras[v], x, y, z) * step_m, 1.0)
            longest_px[v] = max(longest_px[v], _LEARNT_OUTSIDE * step_px + 1.0)


@compiled
def _count_line(
    picture: Picture,
    samples: Samples,
    beside: Integers,
    cameras: Array,
    half_extents: Array,
    step_m: float,
    v: int,
    m: int,
    posteriors: Image,
    inside: Integers,
    outside: Integers,
    hidden: Integers,
) -> None:
    """Counts the colours on both sides of one sample, or those inside as the hider's where most of them are."""
    x, y, nu, nv = (
        samples.positions[v, m, 0],
        samples.positions[v, m, 1],
        samples.positions[v, m, 2],
        samples.positions[v, m, 3],
    )
    p = samples.parts[v, m]
    size = pixels_per_metre(cameras[v], samples.points[v, m, 0], samples.points[v, m, 1], samples.points[v, m, 2])
    step = max(size * step_m, 1.0)
    deep = DEEPEST * size * half_extents[p]
    n_inside = n_hidden = 0
    for k in range(1, _LEARNT_INSIDE + 1):
        if k * step > deep:
            break
        colour = colour_at(picture, v, x - nu * k * step, y - nv * k * step)
        if colour >= 0:
            n_inside += 1
            n_hidden += 1 if posteriors[v, p, colour] == HIDDEN else 0
    covered = 2 * n_hidden > n_inside
    for k in range(1, _LEARNT_INSIDE + 1):
        if k * step > deep:
            break
        colour = colour_at(picture, v, x - nu * k * step, y - nv * k * step)
        if colour >= 0 and covered:
            hidden[colour] += 1
        elif colour >= 0 and posteriors[v, p, colour] != HIDDEN:
            inside[colour] += 1
    if covered:
        return
    for k in range(2, _LEARNT_OUTSIDE + 1):
        near = k < NEAR
        if (beside[v, m, 0] if near else beside[v, m, 1]) != BACKGROUND:
            continue
        colour = colour_at(picture, v, x + nu * k * step, y + nv * k * step)
        if colour >= 0:
            outside[colour] += 1
