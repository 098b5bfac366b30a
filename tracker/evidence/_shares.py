"""Common parts of several kinds of evidence: share of contours on edges, and pictures."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.bodies.contours import Contours
from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array, Image, Mask
from tracker.images.sight import Observation
from tracker.kernels.contours import edge_shares

Distances = tuple[float, Array]


def shares(
    contours: Contours, observation: Observation, n_parts: int, near_px: tuple[float, float], distances: Distances
) -> Account:
    """The account of the first pose, of all parts of the scene.

    Args:
        contours: of the model; samples of weight 0 do not count.
        observation: the edges.
        n_parts: parts of the scene.
        near_px: how close to an edge a sample counts as explained, and how far from all samples an edge as missed.
        distances: of the whole and of each view (V,), NaN if it is missing, px.
    """
    distance_px, per_view_px = distances
    sums, (flat, regions, scene, first, reach) = np.empty((4, len(contours.counts[0]), n_parts)), observation.packed
    samples = contours.positions[0], contours.parts[0], contours.counts[0]
    edge_shares(*samples, flat, regions, scene, first, reach, near_px, sums)
    visible, distance, explained, missed = sums.sum(axis=1)
    seen = np.where(visible > 0, visible, np.nan)
    return Account(distance_px, per_view_px, distance / seen, visible, explained, missed, sums[[0, 2, 3]])


def over_views(per_view: Array, nothing: float) -> Array:
    """Mean over the views that are not missing: (B, V) -> (B,); `nothing` if none is left."""
    present = np.isfinite(per_view)
    n_present = present.sum(axis=1)
    total = np.where(present, per_view, 0.0).sum(axis=1)
    mean: Array = np.where(n_present > 0, total / np.maximum(n_present, 1), nothing)
    return mean


# Pictures that several kinds of evidence draw alike.

UNKNOWN = (150, 80, 0)
"""BGR, a dark blue: unknown."""

# BGR: near enough, and too far.
_NEAR, _FAR = (80, 220, 80), (40, 40, 230)


def gaps_picture(image: Image, shown: Array, carried: Array, wrong: Mask) -> Image:
    """Points where the image shows them, each with a line to its position by the pose, on the darkened image.

    Args:
        image: (H, W, 3) BGR.
        shown: (N, 2) px.
        carried: (N, 2) positions by the pose, px.
        wrong: (N,) points too far away, drawn red; the others are green.
    """
    picture: Image = (0.5 * image).astype(np.uint8)
    there = np.isfinite(shown).all(axis=1) & np.isfinite(carried).all(axis=1)
    # no line is longer than this, or OpenCV's whole numbers overflow
    ends = np.clip(np.rint(np.stack([shown, carried], axis=1)[there]), -(2.0**15), 2.0**15).astype(int)
    for (a, b), off in zip(ends.tolist(), wrong[there], strict=True):
        shade = _FAR if off else _NEAR
        cv2.line(picture, a, b, shade, 1, cv2.LINE_AA)
        cv2.circle(picture, a, 2, shade, -1, cv2.LINE_AA)
    return picture
