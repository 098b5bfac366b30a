"""Many poses in all views drawn into one picture on the graphics card, and scored there."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.foundation.errors import RenderError
from tracker.foundation.geometry.superquadrics import Meshes
from tracker.images.sight import Observation
from tracker.synthesis._graphics import library, unusable
from tracker.synthesis._pictures import Picture, boxes_of, ranges_of, solids_of

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


_SHADERS = Path(__file__).parent / "_shaders"
# GL_CLIP_DISTANCE0, which moderngl does not name.
_CLIP_DISTANCE0 = 0x3000
# The first with compute shaders.
_VERSION = 430
# To begin with; what does not fit is drawn again with more.
_EDGES_PER_TILE = 4096

# storage bindings, as in the shaders
_VERTICES, _PLACEMENTS, _CAMERAS, _TILES, _SOLIDS, _VIEWS, _CHAMFER, _POINTS, _EDGES, _SCORES, _INSTANCES = range(11)


class Atlas:
    """A context on a graphics card with its programs and buffers; belongs to one thread of one process."""

    def __init__(self, device: int) -> None:
        moderngl = library("moderngl", "egl")
        try:
            self._context = moderngl.create_context(
                require=_VERSION, standalone=True, backend="egl", device_index=device
            )
        except Exception as error:
            raise unusable("egl", error) from error
        self._stores: dict[int, Any] = {}
        self._targets: tuple[Any, ...] = ()
        self._draw: tuple[Any, ...] = ()
        self._kept: dict[str, object] = {}
        with self._context:
            self._build(moderngl)

    def _build(self, moderngl: Any) -> None:
        """Compiles the programs and sets what never changes."""
        context, head = self._context, f"#version {_VERSION} core\n"
        self.renderer = str(context.info["GL_RENDERER"])
        """What draws, in the driver's words."""
        self.side = int(context.info["GL_MAX_TEXTURE_SIZE"])
        """Largest width and height of a picture, px."""
        text = {path.name: path.read_text(encoding="utf-8") for path in _SHADERS.iterdir() if path.is_file()}
        lens = head + text["lens.glsl"]
        self._parts = context.program(lens + text["parts.vert"], fragment_shader=head + text["parts.frag"])
        self._score = context.compute_shader(lens + text["edges.glsl"] + text["score.comp"])
        context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        # rows of the picture run downwards: what is anticlockwise in the image is clockwise here
        context.cull_face = "front"
        for plane in range(4):
            context.enable_direct(_CLIP_DISTANCE0 + plane)

    def pictures(self, scene: Scene, placements: Array, meshes: Meshes, batch: Batch) -> list[list[Picture]]:
        """What a batch's poses look like: B times V pictures."""
        with self._context:
            target = self._drawn(scene, placements, meshes, batch)
            area = (0, 0, *batch.size)
            ids = target.read(viewport=area, components=1, alignment=1, dtype="u2")
            windows = target.read(viewport=area, components=1, attachment=-1, alignment=1, dtype="f4")
        shape = batch.size[::-1]
        numbers = np.frombuffer(ids, dtype=np.uint16).reshape(shape)
        inverse = np.frombuffer(windows, dtype=np.float32).reshape(shape)
        pairs = zip(batch.tiles.tolist(), batch.ranges.tolist(), strict=True)
        cut = [_cut(numbers, inverse, tile, depths) for tile, depths in pairs]
        n_views = len(scene.rig)
        return [cut[i : i + n_views] for i in range(0, len(cut), n_views)]

    def scores(
        self,
        scene: Scene,
        placements: Array,
        meshes: Meshes,
        batch: Batch,
        against: tuple[Observation, float, float],
    ) -> Array:
        """Directed distances (B, V, 2) of a batch's poses, px; only they leave the card.

        Args:
            scene: its rig and shapes.
            placements: (B, P, 4, 4) of the batch's poses.
            meshes: the parts.
            batch: what to draw where.
            against: the observation, the distance of an outlier (px), the distance at which parts touch (m).
        """
        observation, theta, contact_m = against
        with self._context:
            self._drawn(scene, placements, meshes, batch)
            self._observe(scene, observation)
            self._store(_SOLIDS, solids_of(scene.shapes, placements), np.float32)
            settings = {"ids": 0, "windows": 1, "n_parts": len(scene.shapes)}
            _set(self._score, **settings, contact_m=contact_m, theta=theta)
            self._targets[0].use(0)
            self._targets[1].use(1)
            found = self._scored(len(batch.tiles))
        return found[:, :2].reshape(-1, len(scene.rig), 2)

    def _scored(self, n_tiles: int) -> Array:
        """Scores (T, 4) of the tiles; tiles with more edges than there was room for are scored again."""
        capacity = _EDGES_PER_TILE
        while True:
            self._room(_EDGES, 8 * n_tiles * capacity)
            self._room(_SCORES, 16 * n_tiles)
            _set(self._score, capacity=capacity)
            self._score.run(n_tiles)
            self._context.memory_barrier()
            found = np.frombuffer(self._stores[_SCORES].read(16 * n_tiles), dtype=np.float32).reshape(n_tiles, 4)
            most = int(found[:, 2].max(initial=0))
            if most <= capacity:
                return found.astype(np.float64)
            capacity = most

    def _drawn(self, scene: Scene, placements: Array, meshes: Meshes, batch: Batch) -> Any:
        """Draws a batch; returns the framebuffer."""
        target = self._target(batch.size)
        draw = self._draw_of(meshes)
        self._store(_PLACEMENTS, placements[..., :3, :], np.float32)
        self._store(_CAMERAS, scene.rig.packed, np.float32)
        # the shaders take the depths as the bits of floats
        depths = np.pad(batch.ranges, [(0, 0), (0, 2)]).astype(np.float32).view(np.int32)
        self._store(_TILES, np.concatenate([batch.tiles, depths], axis=1), np.int32)
        self._store(_INSTANCES, batch.instances, np.int32)
        sizes = {"n_vertices": meshes.points.shape[1], "n_parts": len(scene.shapes)}
        _set(self._parts, atlas=batch.size, **sizes)
        target.viewport = (0, 0, *batch.size)
        target.use()
        target.clear(viewport=target.viewport)
        if len(batch.instances):
            draw.render(instances=len(batch.instances))
        return target

    def _draw_of(self, meshes: Meshes) -> Any:
        """What draws parts, kept for the meshes last used."""
        if self._kept.get("meshes") is not meshes:
            for old in self._draw:
                old.release()
            self._store(_VERTICES, meshes.points, np.float32)
            triangles = self._context.buffer(meshes.triangles.astype(np.int32).tobytes())
            self._draw = self._context.vertex_array(self._parts, [], index_buffer=triangles), triangles
            self._kept["meshes"] = meshes
        return self._draw[0]

    def _target(self, size: tuple[int, int]) -> Any:
        """A framebuffer at least this large: part numbers from 1, and depth."""
        if self._targets:
            have = self._targets[2].size
            if have[0] >= size[0] and have[1] >= size[1]:
                return self._targets[2]
            size = max(size[0], have[0]), max(size[1], have[1])
            for old in reversed(self._targets):
                old.release()
        ids = self._context.texture(size, 1, dtype="u2")
        ids.filter = 0x2600, 0x2600  # integers are never interpolated
        depths = self._context.depth_texture(size)
        depths.compare_func = ""
        self._targets = ids, depths, self._context.framebuffer([ids], depths)
        return self._targets[2]

    def _observe(self, scene: Scene, observation: Observation) -> None:
        """Puts an observation on the card, unless it is there from the last call."""
        if self._kept.get("observation") is not observation or self._kept.get("rig") is not scene.rig:
            flat, layout, points, first, _ = observation.packed
            self._store(_CHAMFER, flat, np.float32)
            self._store(_POINTS, np.pad(points[:, [0, 1, 4]], [(0, 0), (0, 1)]), np.float32)
            views = [scene.rig.sizes, layout, first[:-1, None], first[1:, None]]
            self._store(_VIEWS, np.concatenate(views, axis=1), np.int32)
            self._kept |= {"observation": observation, "rig": scene.rig}
        for binding in (_CHAMFER, _POINTS, _VIEWS):
            self._stores[binding].bind_to_storage_buffer(binding)

    def _store(self, binding: int, values: NDArray[Any], dtype: Any) -> None:
        """Writes values where a shader finds them."""
        data = np.ascontiguousarray(values, dtype=dtype).tobytes()
        self._room(binding, len(data))
        self._stores[binding].write(data)

    def _room(self, binding: int, n_bytes: int) -> None:
        """A storage buffer of at least so many bytes."""
        store = self._stores.get(binding)
        if store is None or store.size < n_bytes:
            if store is not None:
                store.release()
            store = self._stores[binding] = self._context.buffer(reserve=max(n_bytes, 64))
        store.bind_to_storage_buffer(binding)


def _cut(numbers: NDArray[np.uint16], inverse: Array32, tile: list[int], range_m: list[float]) -> Picture:
    """The picture of one tile; `inverse` goes from 0 to 1 with the inverse depth."""
    (x, y, _, _, left, top, width, height), (near, far) = tile, range_m
    area = slice(y, y + height), slice(x, x + width)
    depths = near * far / (far + (near - far) * inverse[area])
    return Picture(numbers[area].astype(np.int64) - 1, depths.astype(np.float32), (left, top))


def _set(program: Any, **values: object) -> None:
    for name, value in values.items():
        program[name].value = value


_HELD = threading.local()


def atlas_on(device: int) -> Atlas:
    """The atlas of this thread and process on a device; made on first use, never pickled.

    Raises:
        RenderError: there is no graphics library, or none that can do this.
    """
    # a context does not survive a fork
    if getattr(_HELD, "process", None) != os.getpid():
        _HELD.process, _HELD.atlases = os.getpid(), {}
    if device not in _HELD.atlases:
        _HELD.atlases[device] = Atlas(device)
    atlas: Atlas = _HELD.atlases[device]
    return atlas
