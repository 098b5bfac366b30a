"""Shifts of the contour: where along its normal does a part's colour end?

Shifting the contour along a line by d leaves the places up to d inside. The posterior of d, flat a priori, has a mean
and a variance: one equation of the pose.
"""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.kernels.regions.colours import Picture
from tracker.kernels.regions.lines import Looks, Rule, Samples


def find_shifts(
    picture: Picture,
    looks: Looks,
    samples: Samples,
    beside: Integers,
    cameras: Array,
    wanted: Mask,
    rule: Rule,
    shifts: Array32,
) -> None:
    """How far the contour has to move along its normal at each sample of one pose.

    Args:
        picture, looks: colours seen and known.
        samples: contour samples; those of weight 0 are left out.
        beside: (V, M, 2) parts seen at the `SPOTS`.
        cameras: (V, 29) from `Rig.packed`.
        wanted: (P,) parts whose samples count.
        rule: how lines are read.
        shifts: (V, M, 3) output: mean shift, px, outwards; its inverse variance, 1/px^2; 1 where the line supports a
            contour there, 0.3 where its best place is the end of the line. All 0 for the others.
    """
    native.find_shifts(picture, looks, samples, beside, cameras, wanted, rule, shifts)
