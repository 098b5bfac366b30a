"""Points of a body in many poses beside 2-D detections of them: which detection, with which sides, and how far."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point
from tracker.kernels.rows.camera import FX

_NEAREST_M = 0.1
"""What is closer to a camera, behind it or beyond its reach has no image that a keypoint could be of, metres."""


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
    """(B, V, L) share of an outlier that a keypoint counts, 0 to 1 and what its exchange costs; see `loss_of`."""


@compiled
def loss_of(gap_u: float, gap_w: float, reach_px: float) -> float:
    """Geman and McClure's loss of a gap, s^2 / (1 + s^2): half of an outlier at the reach, 1 far off."""
    square = (gap_u * gap_u + gap_w * gap_w) / (reach_px * reach_px)
    return square / (1.0 + square)


@compiled
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
    n_points = points.shape[1]
    pixels, reaches = np.empty((n_points, 2)), np.empty(n_points)
    losses, exchanged = np.empty(n_points), np.zeros(n_points, dtype=np.int64)
    gains = np.empty(n_limbs)
    for b in range(points.shape[0]):
        for v in range(cameras.shape[0]):
            for k in range(n_points):
                pixels[k, 0], pixels[k, 1], depth = project_point(
                    cameras[v], points[b, k, 0], points[b, k, 1], points[b, k, 2]
                )
                matches.px_per_m[b, v, k] = cameras[v, FX] / max(depth, _NEAREST_M)
                reaches[k] = reach[0] * matches.px_per_m[b, v, k] if depth > _NEAREST_M else 0.0
            least = np.inf
            for n in range(detected.first[v], detected.first[v + 1]):
                _compare(detected, n, (pixels, reaches), reach[1], gains, losses, exchanged)
                if losses.sum() < least:
                    least = losses.sum()
                    _write(detected.found[n], exchanged, (pixels, reaches), losses, (b, v), matches)


@compiled
def _compare(
    detected: Detected,
    n: int,
    seen: tuple[Array, Array],
    exchange_costs: float,
    gains: Array,
    losses: Array,
    exchanged: Integers,
) -> None:
    """Losses (L,) of one detection, and which keypoint (L,) means each point: its own or that of the other side.

    `seen` are the pixels (L, 2) of the points and their reaches (L,) px, 0 of those that are not before the camera.
    """
    found, other = detected.found[n], detected.other
    gains[:] = 0.0
    for k in range(len(losses)):
        losses[k] = _loss(found, k, seen, k)
        if detected.limbs[k] >= 0:
            gains[detected.limbs[k]] += losses[k] - _loss(found, other[k], seen, k) - exchange_costs
    for k in range(len(losses)):
        exchanged[k] = k
        if detected.limbs[k] >= 0 and gains[detected.limbs[k]] > 0.0:
            exchanged[k] = other[k]
            losses[k] = _loss(found, other[k], seen, k) + exchange_costs


@compiled
def _loss(found: Array, keypoint: int, seen: tuple[Array, Array], k: int) -> float:
    """Loss of a keypoint as the image of a point; one that was not found, or of no image, is as bad as an outlier."""
    pixels, reaches = seen
    if found[keypoint, 2] <= 0.0 or reaches[k] <= 0.0:
        return 1.0
    return loss_of(pixels[k, 0] - found[keypoint, 0], pixels[k, 1] - found[keypoint, 1], reaches[k])


@compiled
def _write(
    found: Array,
    exchanged: Integers,
    seen: tuple[Array, Array],
    losses: Array,
    place: tuple[int, int],
    matches: Matches,
) -> None:
    (b, v), (pixels, reaches) = place, seen
    for k in range(len(losses)):
        keypoint = found[exchanged[k]]
        there = keypoint[2] > 0.0 and reaches[k] > 0.0
        matches.weights[b, v, k] = keypoint[2] if there else 0.0
        matches.gaps[b, v, k, 0] = pixels[k, 0] - keypoint[0] if there else 0.0
        matches.gaps[b, v, k, 1] = pixels[k, 1] - keypoint[1] if there else 0.0
        matches.losses[b, v, k] = losses[k]
