"""Analysis: the edges of the images near expected contours."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from tracker.bodies.contours import Contours
from tracker.foundation.arrays import Array32, Integers, Mask, Region, frozen
from tracker.images.operations.edges import EdgeSegments, chamfer_image
from tracker.images.sight import Observation, Sight, ViewObservation
from tracker.kernels.edges import expected_distances


@runtime_checkable
class Analysis(Protocol):
    """A component that finds scene features near the expected contours."""

    def observe(self, sight: Sight, expected: Contours | None) -> Observation:
        """Scene features of all views.

        Args:
            sight: the images, and a clean plate for each view that has one.
            expected: contours of the prediction (several poses if there are several candidates); None to search
                everywhere and accept everything.

        Returns:
            One finding a view, None for missing views.
        """
        ...

    def look(self, sight: Sight, around: Contours) -> None:
        """Prepares edges near contours of an earlier frame, and leaves them in the sight; by default nothing.

        Args:
            sight: the frame to come.
            around: contours of all persons some frames before.
        """
        return


# From edge points to a view's observation; shared by the analyses.


def accepted_segments(
    found: EdgeSegments,
    samples: Array32 | None,
    accept_px: float,
    bend_px: float,
    trusted: Mask,
    outline: Mask | None = None,
) -> Mask:
    """Edge points of accepted segments (paper, section 4.2): each segment is one unit.

    Args:
        found: segments, positions in the whole image.
        samples: (M, 4) expected contours, or None to accept all reliable ones.
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
        region: of the chamfer image; its reach around it counts as well.
        reach: clamp of the chamfer image, px.
        n_scene: number of points that represent the accepted contours.
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
    """At most `most` of the points, evenly along the chains, and the contour length of each, px."""
    if len(indices) <= most:
        return frozen(indices, np.int64), np.ones(len(indices), dtype=np.float32)
    picked = indices[np.floor((np.arange(most) + 0.5) * len(indices) / most).astype(np.int64)]
    return frozen(picked, np.int64), np.full(most, len(indices) / most, dtype=np.float32)
