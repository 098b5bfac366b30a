"""Compiled synthesis on the CPU: traces occluding contours without rendering pictures."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Array32, Integers, Mask, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.geometry.superquadrics import spread, surface
from tracker.images.sight import Observation
from tracker.kernels.contours import MOST_COLUMNS, MOST_ROWS, moving_parts, score_poses, trace_contours, trace_still
from tracker.kernels.descent import Tracing
from tracker.kernels.pictures import fill_parts
from tracker.kernels.regions import Lines, score_regions
from tracker.synthesis._skins import PartIds, fill_skins, ids_of_poses, skinned_parts, with_skins

# A part shows about 2 n_eta pieces, long ones cut at step_px: 64 were never reached at the default step.
_SAMPLES_PER_PART = 64

# Grid for pictures. Chords lie inside: at 720 x 576 silhouettes are 0.2 % smaller than those of a very fine grid, and
# with 9 x 16 half a percent.
_FINE = (13, 24)
FINEST = (2 * _FINE[0] - 1, 2 * _FINE[1])
"""The same for which part each pixel shows."""


@component
class CpuSynthesis:
    """Contour tracer of the superquadric model; needs no graphics library."""

    threads: ClassVar[bool] = True
    """Whether several threads may ask at once."""

    step_px: float = pydantic.Field(default=8.0, gt=0)
    """Longest piece of contour that one sample stands for, px."""

    contact_m: float = pydantic.Field(default=0.02, ge=0)
    """An edge whose outer side is this close to another part is an edge between parts, metres."""

    n_eta: int = pydantic.Field(default=9, ge=5, le=MOST_ROWS)
    """Latitudes of the surface grid."""

    n_omega: int = pydantic.Field(default=16, ge=8, le=MOST_COLUMNS)
    """Longitudes of the surface grid."""

    search_steps: float = pydantic.Field(default=52.0, gt=0)
    """A sample in a search stands for the longer side of the smallest image divided by this, px: scores of many poses
    correlate to 0.9995 with those of samples four times as dense."""

    search_n_eta: int = pydantic.Field(default=6, ge=5, le=MOST_ROWS)
    """Latitudes of the surface grid in a search."""

    search_n_omega: int = pydantic.Field(default=12, ge=8, le=MOST_COLUMNS)
    """Longitudes of the surface grid in a search."""

    def contours(
        self, scene: Scene, person: int | None = None, poses: Array | None = None, coarse: bool = False
    ) -> Contours:
        """Visible occluding contours; see `tracker.synthesis.Synthesis.contours`."""
        placements = scene.world_from_parts(person, poses)
        if coarse or not scene.has_skins:
            return self._of_parts(scene, placements, coarse)
        bare = not all(skinned_parts(scene))
        parts = self._of_parts(scene, placements, coarse) if bare else None
        return with_skins(parts, scene, placements, (self.step_px, self.contact_m))

    def _of_parts(self, scene: Scene, placements: Array, coarse: bool) -> Contours:
        """Contours of all superquadrics; fine ones are kept for some poses, because they are needed again.

        What is expected in a frame is where refinements begin, and what is found there where the frame ends.
        """
        if coarse:
            return self._drawn(scene, placements, coarse)
        sampling = np.array([self.n_eta, self.n_omega, self.step_px, self.contact_m])
        told = b"".join(values.tobytes() for values in (scene.shapes, scene.rig.packed, scene.rig.sizes, sampling))
        keys = [told + placed.tobytes() for placed in placements]
        kept = _TRACED.get(keys[0]) if len(keys) == 1 else None
        if kept is not None:
            return kept
        found = self._drawn(scene, placements, coarse)
        for b, key in enumerate(keys):
            _TRACED[key] = found if len(keys) == 1 else found.pose(b)
        while len(_TRACED) > _MOST_TRACED:
            _TRACED.popitem(last=False)
        return found

    def _drawn(self, scene: Scene, placements: Array, coarse: bool) -> Contours:
        """Contours of all superquadrics, found now."""
        capacity = _SAMPLES_PER_PART * len(scene.shapes)
        found, most = self._traced(scene, placements, capacity, coarse)
        while most == capacity:
            capacity *= 2
            found, most = self._traced(scene, placements, capacity, coarse)
        return found

    def _sampling(self, scene: Scene, coarse: bool) -> tuple[tuple[int, int], tuple[float, float]]:
        """Latitudes and longitudes of the surface grid; longest piece of contour, px, and contact, metres."""
        if not coarse:
            return (self.n_eta, self.n_omega), (self.step_px, self.contact_m)
        step_px = float(scene.rig.sizes.max(axis=1).min()) / self.search_steps
        return (self.search_n_eta, self.search_n_omega), (step_px, self.contact_m)

    def _traced(self, scene: Scene, placements: Array, capacity: int, coarse: bool) -> tuple[Contours, int]:
        """Contours with room for so many samples in a view, further ones are dropped; and most that were traced."""
        grid, spacing = self._sampling(scene, coarse)
        grids, planes, bounds = _grids(scene.shapes, *grid)
        layout = (len(placements), len(scene.rig), capacity)
        positions = np.empty((*layout, 5), dtype=np.float32)
        points = np.empty((*layout, 3), dtype=np.float32)
        parts = np.empty(layout, dtype=np.int64)
        between = np.empty(layout, dtype=np.bool_)
        counts = np.zeros(layout[:2], dtype=np.int64)
        most = trace_contours(
            placements,
            scene.shapes,
            grids,
            planes,
            grid,
            bounds,
            scene.rig.packed,
            scene.rig.sizes,
            spacing,
            not coarse,
            positions,
            points,
            parts,
            between,
            counts,
        )
        return Contours(positions, points, parts, between, counts), most

    def tracing(self, scene: Scene) -> Tracing | None:
        """What compiled refinements trace fine contours by; None where they are of persons' own skins."""
        if scene.has_skins:
            return None
        grid, spacing = self._sampling(scene, coarse=False)
        grids, planes, bounds = _grids(scene.shapes, *grid)
        return Tracing(scene.shapes, grids, planes, grid, bounds, scene.rig.packed, scene.rig.sizes, spacing)

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        """Chamfer distances without contours; see `tracker.synthesis.Synthesis.directed_distances`."""
        grid, spacing = self._sampling(scene, coarse=True)
        grids, planes, bounds = _grids(scene.shapes, *grid)
        flat, regions, points, first, _ = observation.packed
        placements = scene.world_from_parts(person, poses)
        moving = moving_parts(placements)
        seen = scene.shapes, grids, planes, grid, bounds, scene.rig.packed, scene.rig.sizes, spacing
        standing = _standing(placements, ~moving, seen)
        rule = theta, reject
        directed: Array = score_poses(placements, *seen, flat, regions, points, first, rule, moving, standing)
        return directed

    def region_misfits(self, scene: Scene, person: int, poses: Array, lines: Lines) -> Array:
        """Misfits of colours without contours; see `tracker.synthesis.Synthesis.region_misfits`."""
        grid, spacing = self._sampling(scene, coarse=True)
        grids, planes, bounds = _grids(scene.shapes, *grid)
        misfits: Array = score_regions(
            scene.world_from_parts(person, poses),
            scene.shapes,
            grids,
            planes,
            grid,
            bounds,
            scene.rig.packed,
            scene.rig.sizes,
            spacing,
            lines,
        )
        return misfits

    def silhouettes(self, scene: Scene) -> tuple[Mask, ...]:
        """The region each view's persons cover; see `tracker.synthesis.Synthesis.silhouettes`."""
        grids, _, _ = _grids(scene.shapes, *_FINE)
        placements = scene.world_from_parts()[0]
        if scene.has_skins:
            bare = ~skinned_parts(scene)
            placements, grids = placements[bare], frozen(grids[bare], np.float32)
        masks = tuple(np.zeros(camera.size[::-1], dtype=np.bool_) for camera in scene.rig.cameras)
        for row, mask in zip(scene.rig.packed, masks, strict=True):
            fill_parts(placements, grids, _FINE, row, mask)
        if scene.has_skins:
            fill_skins(scene, masks)
        return masks

    def part_ids(self, scene: Scene) -> tuple[Integers, ...]:
        """The part seen at every pixel; see `tracker.synthesis.Synthesis.part_ids`."""
        (ids,) = ids_of_poses(scene, None, None, *FINEST)
        return tuple(view.astype(np.int64) for view in ids)

    def ids_of_poses(self, scene: Scene, person: int, poses: Array) -> Iterator[tuple[PartIds, ...]]:
        """The same for poses (B, dof) of a person, one after the other; what stands still in all is drawn once."""
        return ids_of_poses(scene, person, poses, *FINEST)


_TRACED: OrderedDict[bytes, Contours] = OrderedDict()
"""Fine contours of the poses traced last, by all that they depend on."""

# Two predictions of three are refined, two steps each, before anything is asked for again.
_MOST_TRACED = 8

_Standing = tuple[Array32, Integers]
"""Samples of parts that stand still in a search, and their numbers."""

_STANDING: dict[bytes, _Standing] = {}


def _standing(placements: Array, still: Mask, seen: tuple[Any, ...]) -> _Standing:
    """Contours of the parts that stand still, kept for the last batch of poses: a search asks for the same ones again.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        still: (P,) the parts.
        seen: shapes, grids, planes, layout, bounds, cameras, image sizes and spacing, see `trace_still`.
    """
    shapes, _, _, layout, _, cameras, sizes, spacing = seen
    told = still, placements[:1, still], shapes, cameras, sizes, np.array([*layout, *spacing])
    key = b"".join(values.tobytes() for values in told)
    found = _STANDING.get(key)
    if found is None:
        found = trace_still(placements, still, *seen)
        _STANDING.clear()
        _STANDING[key] = found
    return found


def _grids(shapes: Array, n_eta: int, n_omega: int) -> tuple[Array32, Array32, Array]:
    """Surface grids, their tangent planes and bounds of all parts, kept for the shapes last used."""
    return _make_grids(shapes.tobytes(), n_eta, n_omega)


@lru_cache(maxsize=8)
def _make_grids(shapes: bytes, n_eta: int, n_omega: int) -> tuple[Array32, Array32, Array]:
    grids, planes, radii, reaches, widths = [], [], [], [], []
    for shape in np.frombuffer(shapes).reshape(-1, 7):
        eta, omega = spread(shape, 2 * n_eta - 1, 2 * n_omega)
        points, normals = surface(shape, eta[:, None], omega[None, :])
        products = (points * normals).sum(axis=-1, keepdims=True)
        grids.append(np.concatenate([points, normals, products], axis=-1).reshape(-1, 7))
        corners = normals[::2, ::2].reshape(-1, 3)
        planes.append([*corners.T, (corners * points[::2, ::2].reshape(-1, 3)).sum(axis=1)])
        radii.append(np.linalg.norm(points, axis=-1).max())
        # 4 % more than the grid's farthest point covers the surface between the points
        reaches.append(1.04 * ((points / shape[:3]) ** 2).sum(axis=-1).max())
        widths.append(1.02 * np.linalg.norm(points[..., :2], axis=-1).max())
    return frozen(grids, np.float32), frozen(planes, np.float32), frozen([radii, reaches, widths])
