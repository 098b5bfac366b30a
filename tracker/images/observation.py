"""What the images of one frame show: edge points, segments, chamfer images, silhouettes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tracker.foundation.arrays import Array32, Integers, Mask, frozen

HIDDEN = -1e6
"""In a chamfer image: what is there is hidden. So far below any distance that interpolating it leaves it negative."""


@dataclass(frozen=True)
class ViewObservation:
    """Findings of one view; positions are in pixels of the whole image."""

    edges: Array32
    """(N, 2) edge points, px; of segments that may be accepted."""

    directions: Array32
    """(N, 2) unit image gradient at the edge points: across the edge, towards the brighter side."""

    segments: Integers
    """(N,) constant-curvature segment of each edge point."""

    accepted: Mask
    """(N,) whether the point's segment was accepted into the filtered scene edge map; single points of an accepted
    segment that the background explains are left out."""

    scene: Integers
    """(S,) indices of the edge points that stand for the accepted contours, evenly thinned."""

    scene_weights: Array32
    """(S,) contour length each of them stands for, px; less for edges that matter less."""

    origin: tuple[int, int]
    """Pixel (x, y) of the chamfer image's upper left corner."""

    distance: Array32
    """(h, w) chamfer image: distance to the nearest accepted edge point, px; clamped at its reach. `HIDDEN` where
    something stands before the persons."""

    reach: float
    """Value of the chamfer image outside its region, px."""

    silhouette: Mask | None = None
    """(H, W) the region whose outline the edges are, where they are one."""

    def hidden_by(self, occluder: Mask) -> ViewObservation:
        """The same where something stands before the persons (H, W): contours there count for nothing."""
        (x, y), (height, width) = self.origin, self.distance.shape
        part = occluder[y : y + height, x : x + width]
        return replace(self, distance=frozen(np.where(part, np.float32(HIDDEN), self.distance), np.float32))


class PackedEdges(NamedTuple):
    """All views end to end, for compiled kernels."""

    images: Array32
    """Chamfer images, px."""

    regions: Integers
    """(V, 5) where each lies in `images`; `tracker.kernels.rows.RegionRow` names the columns."""

    points: Array32
    """(S, 5) scene points, each view's sorted by y; `tracker.kernels.rows.ScenePointRow` names the columns."""

    first: Integers
    """(V + 1,) first point of each view."""

    reach: Array32
    """(V,) reach of the chamfer images, px."""


@dataclass(frozen=True)
class Observation:
    """Findings of all V views; None for a view that is missing in this frame."""

    views: tuple[ViewObservation | None, ...]

    @cached_property
    def packed(self) -> PackedEdges:
        """The observation as flat arrays for compiled kernels."""
        images, layout, points, first, reach = [], [], [], [0], []
        start = 0
        for view in self.views:
            if view is None:
                layout.append((start, 0, 0, 0, 0))
                first.append(first[-1])
                reach.append(0.0)
                continue
            height, width = view.distance.shape
            images.append(view.distance.ravel())
            layout.append((start, *view.origin, width, height))
            start += width * height
            columns = view.edges[view.scene], view.directions[view.scene], view.scene_weights[:, None]
            rows = np.concatenate(columns, axis=1)
            points.append(rows[np.argsort(rows[:, 1], kind="stable")])
            first.append(first[-1] + len(rows))
            reach.append(view.reach)
        empty = np.zeros(0, dtype=np.float32)
        flat = np.concatenate([empty, *images])  # its own already: megabytes, not to be copied once more
        flat.setflags(write=False)
        scene = np.concatenate(points) if points else empty.reshape(0, 5)
        return PackedEdges(
            flat,
            frozen(layout, np.int64),
            frozen(scene, np.float32),
            frozen(first, np.int64),
            frozen(reach, np.float32),
        )

    @cached_property
    def packed_segments(self) -> Integers:
        """(S,) the segment of each row of `packed.points`; of other views they have other numbers."""
        segments, start = [np.zeros(0, dtype=np.int64)], 0
        for view in self.views:
            if view is not None and len(view.scene):
                order = np.argsort(view.edges[view.scene][:, 1], kind="stable")
                numbers = view.segments[view.scene][order]
                segments.append(numbers + start)
                start += int(numbers.max()) + 1
        found: Integers = frozen(np.concatenate(segments), np.int64)
        return found
