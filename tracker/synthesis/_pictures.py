"""Pictures of part numbers and depths, and what is made from them: contours, silhouettes, distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.foundation.geometry.superquadrics import box_bounds, meshes_of
from tracker.images.sight import Observation
from tracker.kernels.contours import directed_distances
from tracker.kernels.pictures import id_contours, rasterize
from tracker.kernels.regions import Lines, parts_beside, score_lines
from tracker.kernels.rows import SuperquadricRow

NEAREST_M = 0.05
"""Parts that come closer to a camera than this are not drawn, metres."""


def before_cameras(scene: Scene, placements: Array, widths: Array) -> Mask:
    """Which parts lie wholly before which cameras, with both ends within the reach of the lens.

    As `tracker.kernels.contours.solids` decides it.

    Args:
        scene: its rig and shapes.
        placements: (B, P, 4, 4) world_from_part, metres.
        widths: (P,) from `Meshes`.

    Returns:
        (B, V, P).
    """
    ends = _axis_ends(scene, placements)
    depths = [camera.in_camera(ends)[..., 2].min(axis=-1) for camera in scene.rig.cameras]
    # what a lens does not image it would lay over other things
    imaged = [np.isfinite(camera.project(ends)).all(axis=(-1, -2)) for camera in scene.rig.cameras]
    before: Mask = (np.stack(depths, axis=1) - widths > NEAREST_M) & np.stack(imaged, axis=1)
    return before


def boxes_of(scene: Scene, placements: Array, widths: Array, shown: Mask) -> Integers:
    """Part of each image (B, V, 4) outside of which a pose shows nothing: x, y, width and height, px."""
    ends = _axis_ends(scene, placements)
    boxes = np.zeros((*shown.shape[:2], 4), dtype=np.int64)
    for v, camera in enumerate(scene.rig.cameras):
        pixels, local = camera.project(ends), camera.in_camera(ends)
        depths = np.maximum(local[..., 2].min(axis=-1) - widths, NEAREST_M)
        # as `tracker.kernels.contours.solids` has it: off the axis a width is drawn out, else a tenth on top covers it
        drawn_out = (np.linalg.norm(local, axis=-1) / np.maximum(local[..., 2], NEAREST_M)).max(axis=-1).clip(min=1.1)
        reach = drawn_out * max(camera.matrix[0, 0], camera.matrix[1, 1]) * widths / depths + 2
        seen = shown[:, v, :, None]
        lows = np.where(seen, pixels.min(axis=2) - reach[..., None], np.inf).min(axis=1)
        highs = np.where(seen, pixels.max(axis=2) + reach[..., None], -np.inf).max(axis=1)
        low = np.clip(np.floor(lows), 0, camera.size).astype(np.int64)
        high = np.clip(np.ceil(highs) + 1, 0, camera.size).astype(np.int64)
        boxes[:, v, :2], boxes[:, v, 2:] = low, np.maximum(high - low, 0)
    return boxes


def ranges_of(scene: Scene, placements: Array, widths: Array, shown: Mask) -> Array:
    """Nearest and farthest depth (B, V, 2) of what a pose shows, metres, with a little room."""
    ends = _axis_ends(scene, placements)
    ranges = np.empty((*shown.shape[:2], 2))
    for v, camera in enumerate(scene.rig.cameras):
        depths = camera.in_camera(ends)[..., 2]
        ranges[:, v, 0] = np.where(shown[:, v], depths.min(axis=-1) - widths, np.inf).min(axis=1)
        ranges[:, v, 1] = np.where(shown[:, v], depths.max(axis=-1) + widths, -np.inf).max(axis=1)
    ranges[~shown.any(axis=2)] = 1.0, 2.0
    return ranges * (0.99, 1.01)


def _axis_ends(scene: Scene, placements: Array) -> Array:
    """Both ends of the parts' z axes in the world (B, P, 2, 3), metres."""
    half = scene.shapes[:, 2, None] * placements[..., :3, 2]
    centres = placements[..., :3, 3]
    return np.stack([centres - half, centres + half], axis=2)


@dataclass(frozen=True)
class Picture:
    """What a view shows inside a box of the image; around the box there is nothing."""

    ids: Integers
    """(h, w) scene-wide part number, -1 for the background."""

    depths: Array32
    """(h, w) metres, where there is a part."""

    origin: tuple[int, int] = (0, 0)
    """Pixel (x, y) of the image at the box's upper left corner."""

    def whole(self, camera: Camera) -> Integers:
        """Part numbers (H, W) of the whole image."""
        ids = np.full(camera.size[::-1], -1, dtype=np.int64)
        (x, y), (height, width) = self.origin, self.ids.shape
        ids[y : y + height, x : x + width] = self.ids
        return ids


def contours_of(scene: Scene, placements: Array, pictures: Sequence[Sequence[Picture]], contact_m: float) -> Contours:
    """Contours found in pictures.

    Args:
        scene: shapes and rig.
        placements: (B, P, 4, 4) world_from_part, metres.
        pictures: B times V.
        contact_m: distance at which parts touch, metres.
    """
    solids = solids_of(scene.shapes, placements)
    found = [
        [
            _traced(picture, camera, row, solids[b], contact_m)
            for picture, camera, row in zip(pictures[b], scene.rig.cameras, scene.rig.packed, strict=True)
        ]
        for b in range(len(placements))
    ]
    lengths = [[len(view[2]) for view in views] for views in found]
    counts = np.array(lengths, dtype=np.int64).reshape(len(placements), len(scene.rig))
    layout = (len(placements), len(scene.rig), int(counts.max(initial=1)))
    positions, points = (np.zeros((*layout, n), dtype=np.float32) for n in (5, 3))
    parts, between = np.zeros(layout, dtype=np.int64), np.zeros(layout, dtype=np.bool_)
    for b, v in np.ndindex(*layout[:2]):
        own = b, v, slice(counts[b, v])
        positions[own], points[own], parts[own], between[own] = found[b][v]
    return Contours(positions, points, parts, between, counts)


def _traced(
    picture: Picture, camera: Camera, row: Array, solids: Array, contact_m: float
) -> tuple[Array32, Array32, Integers, Mask]:
    """Samples of one picture: positions (N, 5), points (N, 3), parts (N,), between (N,)."""
    capacity = 4096
    while True:
        positions, points = (np.empty((capacity, n), dtype=np.float32) for n in (5, 3))
        parts, between = np.empty(capacity, dtype=np.int64), np.empty(capacity, dtype=np.bool_)
        frame = (*picture.origin, *camera.size)
        outputs = positions, points, parts, between
        n = id_contours(picture.ids, picture.depths, frame, row, solids, contact_m, *outputs)
        if n <= capacity:
            return positions[:n], points[:n], parts[:n], between[:n]
        capacity = n


def solids_of(shapes: Array, placements: Array) -> Array:
    """Parts (B, P, 17) as `id_contours` takes them, of shapes (P, 7) placed at (B, P, 4, 4)."""
    rotations = np.swapaxes(placements[..., :3, :3], -1, -2)
    motions = np.concatenate([rotations, -rotations @ placements[..., :3, 3:]], axis=-1) / shapes[:, :3, None]
    e1, e2 = shapes[:, SuperquadricRow.E1], shapes[:, SuperquadricRow.E2]
    rows = np.stack([shapes[:, SuperquadricRow.K1], shapes[:, SuperquadricRow.K2], 2 / e2, e2 / e1, 2 / e1], axis=-1)
    flat = motions.reshape(*placements.shape[:2], 12)
    return np.concatenate([flat, np.broadcast_to(rows, (len(placements), *rows.shape))], axis=-1)


def rasterized(scene: Scene, n_eta: int, n_omega: int) -> tuple[Picture, ...]:
    """Pictures of all views from the z-buffer on the CPU, exact and slow.

    Args:
        scene: persons, poses and rig.
        n_eta: latitudes of the parts' meshes.
        n_omega: their longitudes.
    """
    placements = scene.world_from_parts()
    meshes = meshes_of(scene.shapes, n_eta, n_omega)
    before = before_cameras(scene, placements, meshes.widths)
    boxes = boxes_of(scene, placements, meshes.widths, before)[0]
    world = meshes.points @ np.swapaxes(placements[0, :, :3, :3], -1, -2) + placements[0, :, None, :3, 3]
    starts = meshes.points.shape[1] * np.arange(len(scene.shapes))
    pictures = []
    for v, camera in enumerate(scene.rig.cameras):
        x, y, width, height = boxes[v].tolist()
        buffers = np.zeros((height, width, 4), dtype=np.float32)
        triangles = (starts[before[0, v], None, None] + meshes.triangles).reshape(-1, 3)
        pixels, depths = camera.project(world).reshape(-1, 2), camera.in_camera(world)[..., 2].ravel()
        rasterize(pixels, depths, triangles, (x, y), buffers)
        owners = np.flatnonzero(before[0, v]).repeat(len(meshes.triangles))
        empty = buffers[..., 0] == 0
        ids = np.where(empty, -1, np.append(owners, -1)[np.where(empty, -1, buffers[..., 1].astype(np.int64))])
        depths = 1 / np.where(empty, 1, buffers[..., 0])
        pictures.append(Picture(ids, np.asarray(depths, dtype=np.float32), (x, y)))
    return tuple(pictures)


def rasterized_ids(scene: Scene, n_eta: int, n_omega: int) -> tuple[Integers, ...]:
    """Scene-wide part number (H, W) seen at each pixel's centre in every view, -1 for none; see `rasterized`."""
    pictures = rasterized(scene, n_eta, n_omega)
    return tuple(picture.whole(camera) for picture, camera in zip(pictures, scene.rig.cameras, strict=True))


def distances_of(contours: Contours, observation: Observation, theta: float, reject: bool) -> Array:
    """Directed chamfer distances (B, V, 2), px, of contours; see `directed_distances`."""
    flat, layout, points, first, _ = observation.packed
    distances: Array = directed_distances(
        contours.positions, contours.counts, flat, layout, points, first, theta, reject
    )
    return distances


def misfits_of(scene: Scene, placements: Array, contours: Contours, lines: Lines) -> Array:
    """Misfits (B, V, P, 3) of contours of parts at placements (B, P, 4, 4); see `Synthesis.region_misfits`."""
    misfits = np.zeros((*contours.counts.shape, len(scene.shapes), 3))
    beside = np.empty((*contours.parts.shape, 2), dtype=np.int64)
    samples = contours.positions, contours.points, contours.parts, contours.counts
    cameras, bounds = scene.rig.packed, box_bounds(scene.shapes)
    parts_beside(placements, scene.shapes, bounds, cameras, *samples, lines.rule.step_m, beside)
    score_lines(lines, *samples, beside, cameras, misfits)
    return misfits
