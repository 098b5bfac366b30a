"""Where the poses of a search are drawn in one large picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.errors import RenderError
from tracker.foundation.geometry.superquadric_meshes import Meshes
from tracker.synthesis._meshes import boxes_of, ranges_of

_MOST_TILES = 2048
"""Keeps the lists of edges under the 128 MiB that every card can hold in one buffer."""


@dataclass(frozen=True)
class Batch:
    """Poses of a search that fill one picture: a tile for every pose and view, as large as the largest box."""

    poses: slice
    size: tuple[int, int]
    """Width and height of the picture, px."""

    tiles: Integers
    """(B V, 8) x, y in the picture; view; pose in the batch; x, y, width, height of the box in the view, px."""

    ranges: Array
    """(B V, 2) nearest and farthest depth of what a tile shows, metres."""

    instances: Integers
    """(N, 2) tile and part of everything to draw."""


def batches(scene: Scene, placements: Array, meshes: Meshes, shown: Mask, side: int) -> Iterator[Batch]:
    """Divides poses among pictures.

    Args:
        scene: its rig and shapes.
        placements: (B, P, 4, 4) world_from_part, metres.
        meshes: the parts.
        shown: (B, V, P) which parts to draw in which views.
        side: largest width and height of a picture, px.

    Raises:
        RenderError: a view is larger than a picture can be.
    """
    n_poses, n_views, _ = shown.shape
    boxes = boxes_of(scene, placements, meshes.widths, shown)
    ranges = ranges_of(scene, placements, meshes.widths, shown)
    width, height = np.maximum(boxes[..., 2:].reshape(-1, 2).max(axis=0, initial=1), 1).tolist()
    n_columns, n_rows = side // width, side // height
    each = min(n_columns * n_rows, max(_MOST_TILES, n_views)) // n_views
    if each < 1:
        raise RenderError(f"{n_views} views of {width}x{height} px do not fit into a picture of {side}x{side} px")
    for first in range(0, n_poses, each):
        poses = slice(first, min(first + each, n_poses))
        n_tiles = (poses.stop - first) * n_views
        number = np.arange(n_tiles)
        columns = min(n_columns, n_tiles)
        corners = np.stack([number % columns * width, number // columns * height, number % n_views, number // n_views])
        tiles = np.concatenate([corners.T, boxes[poses].reshape(n_tiles, 4)], axis=1)
        instances = np.argwhere(shown[poses].reshape(n_tiles, -1))
        size = columns * width, -(-n_tiles // columns) * height
        yield Batch(poses, size, tiles, ranges[poses].reshape(n_tiles, 2), instances)
