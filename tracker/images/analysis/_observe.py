"""From edge points to a view's observation; shared by the analyses."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Array32, Integers, Mask, Region, frozen
from tracker.images.observation import ViewObservation
from tracker.images.operations.edges import EdgeSegments, chamfer_image
from tracker.kernels.edges import expected_distances


def accepted_segments(
    found: EdgeSegments,
    samples: Array32 | None,
    accept_px: float,
    bend_px: float,
    trusted: Mask,
    outline: Mask | None = None,
) -> Mask:
    """Which edge points belong to accepted segments (paper, section 4.2): each segment is one unit.

    Args:
        found: segments, positions in the whole image.
        samples: (M, 4) expected contours, or None to accept whatever is trusted.
        accept_px: largest directed chamfer distance of an accepted segment, px.
        bend_px: distance that a right angle between the directions counts, px.
        trusted: (N,) points that the background does not explain.
        outline: (N,) points on the outline of the foreground; segments along it are accepted wherever they are,
            so that a limb the prediction has missed is not thrown away.

    Returns:
        (N,) mask.
    """
    if len(found.points) == 0:
        return np.zeros(0, dtype=np.bool_)
    count = np.maximum(np.bincount(found.segments, minlength=found.n_segments), 1)
    share = np.bincount(found.segments, trusted, found.n_segments) / count
    keep = share >= 0.5
    if samples is not None:
        # With a background known, most edges are out already.
        left = slice(None) if keep.all() else np.flatnonzero(keep[found.segments])
        points, directions = found.points[left], found.directions[left]
        distances = expected_distances(points, directions, samples, bend_px, 4 * accept_px)
        mean = np.bincount(found.segments[left], distances, found.n_segments) / count
        near = mean <= accept_px
        if outline is not None:
            near |= np.bincount(found.segments, outline, found.n_segments) / count >= 0.7
        keep &= near
    accepted: Mask = keep[found.segments] & trusted
    return accepted


def view_observation(
    found: EdgeSegments, accepted: Mask, region: Region, reach: float, n_scene: int
) -> ViewObservation:
    """Chamfer image and thinned scene points of the accepted edges.

    Args:
        found: segments, positions in the whole image.
        accepted: (N,) points of accepted segments.
        region: where the chamfer image is made; grown by its reach it covers all that it can say.
        reach: clamp of the chamfer image, px.
        n_scene: number of points that stand for the accepted contours.
    """
    x, y, width, height = region
    offset = np.array([x, y], dtype=np.float32)
    distance = chamfer_image(found.points[accepted] - offset, (width, height), reach)
    scene, weights = thinned(np.flatnonzero(accepted), n_scene)
    return ViewObservation(
        edges=found.points,
        directions=found.directions,
        segments=found.segments,
        accepted=accepted,
        scene=scene,
        scene_weights=weights,
        origin=(x, y),
        distance=distance,
        reach=reach,
    )


def thinned(indices: Integers, most: int) -> tuple[Integers, Array32]:
    """At most `most` of the points, evenly along the chains, and the contour length each stands for, px."""
    if len(indices) <= most:
        return frozen(indices, np.int64), np.ones(len(indices), dtype=np.float32)
    picked = indices[np.floor((np.arange(most) + 0.5) * len(indices) / most).astype(np.int64)]
    return frozen(picked, np.int64), np.full(most, len(indices) / most, dtype=np.float32)
