"""Colours learnt along the lines across contours: on both sides of them, and of what hides them."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.kernels.regions.colours import Picture, Tables
from tracker.kernels.regions.lines import Samples


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
    changed = np.zeros(tables.inside.shape[:2], dtype=np.bool_)
    counted, rule = (beside, cameras, half_extents, useful), (step_m, news)
    native.learn_lines(picture, samples, *counted, *rule, posteriors, tables, changed)
    return changed


def longest_lines(samples: Samples, cameras: Array, step_m: float, longest_px: Array) -> None:
    """How far from a view's contour colours are learnt, px, with the pixel that the last step is rounded to.

    Args:
        samples: contour samples of one pose.
        cameras: (V, 29) from `Rig.packed`.
        step_m: see `Rule`.
        longest_px: (V,) output.
    """
    native.longest_lines(samples, cameras, step_m, longest_px)
