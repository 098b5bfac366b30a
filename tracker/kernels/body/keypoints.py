"""Points of a body in many poses beside 2-D detections of them: which detection, with which sides, and how far."""

from __future__ import annotations

from typing import NamedTuple

import tracker._native as native
from tracker.foundation.arrays import Array, Integers


class Detected(NamedTuple):
    """What a detector found in V views, of L keypoints that mean points of a body."""

    found: Array
    """(N, L, 3) pixel and confidence of N detections, those of a view after one another; confidence 0: not found."""

    first: Integers
    """(V + 1,) first detection of each view, and N."""

    other: Integers
    """(L,) keypoint of the other side; itself where there is none."""

    limbs: Integers
    """(L,) number of the limb whose sides are exchanged together; -1 for keypoints without a side."""


class Matches(NamedTuple):
    """Room for what is found, of B poses."""

    gaps: Array
    """(B, V, L, 2) from keypoint to point of the body, px; 0 where the weight is."""

    weights: Array
    """(B, V, L) confidences; 0 where there is no keypoint, or the point is not before the camera."""

    px_per_m: Array
    """(B, V, L) size of a metre at the point of the body."""

    losses: Array
    """(B, V, L) share of an outlier that a keypoint counts, 0 to 1 and what its exchange costs.

    Geman and McClure's loss of a gap, s^2 / (1 + s^2): half of an outlier at the reach, 1 far off.
    """


def match_keypoints(
    points: Array, cameras: Array, detected: Detected, n_limbs: int, reach: tuple[float, float], matches: Matches
) -> None:
    """Takes in each view the detection of least loss for each pose, limb by limb with the sides of less loss.

    Args:
        points: (B, L, 3) of the body, metres.
        cameras: (V, 29) from `Rig.packed`.
        detected: what was found.
        n_limbs: limbs with sides.
        reach: distance of half a loss, metres; and what it costs to exchange a keypoint's side, share of an outlier.
        matches: written.
    """
    native.match_keypoints(points, cameras, detected, n_limbs, reach, matches)
