"""Departures in a frame that poses have to cover, and the part that they leave bare."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial

import cv2
import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask, Region, frozen
from tracker.foundation.geometry.superquadrics import spread, surface
from tracker.images.sight import Sight
from tracker.kernels.contours import moving_parts
from tracker.kernels.pictures import cover_still, covered_sums
from tracker.kernels.rows import CameraRow, SuperquadricRow
from tracker.synthesis.cpu import CpuSynthesis

# Grid of a part when it is filled: chords of 5 x 8 points lie inside, 3 % more covers the same area.
_GRID, _GROWN = (5, 8), 1.03


@dataclass(frozen=True, eq=False)
class SmallPictures:
    """Two pictures of each of V views, all views end to end."""

    factor: int
    """Pixels of an image for one of the small pictures, along each side."""

    regions: Integers
    """(V, 3) start in `pictures`, width and height; width 0 without a picture."""

    pictures: Array32
    """(N, 2) values summed over covered pixels, 0 to 1."""

    _still: dict[bytes, tuple[Mask, Array]] = field(init=False, default_factory=dict, repr=False)
    """Cover of parts that stand still in the last batch of poses: the next batch of a search has the same ones."""

    def covered_by(self, asked: Comparison, poses: Array) -> Array:
        """(B, V, 2) sums of the two pictures over what poses (B, dof) cover."""
        placements, shapes, cameras = asked.placements(poses), asked.scene.shapes, asked.scene.rig.packed
        grids, rows, moving = _grids(shapes.tobytes()), _small(cameras, self.factor), moving_parts(placements)
        key = b"".join((shapes.tobytes(), moving.tobytes(), placements[:1, ~moving].tobytes()))
        if key not in self._still:
            self._still.clear()
            self._still[key] = cover_still(placements, ~moving, grids, _GRID, rows, self.regions, self.pictures)
        sums: Array = covered_sums(
            placements, moving, grids, _GRID, rows, self.regions, self.pictures, self._still[key]
        )
        return sums


def _small(cameras: Array, factor: int) -> Array:
    """Rows of `Rig.packed` (V, 29) as `Rig.downscaled` makes them."""
    rows = cameras.copy()
    rows[:, [CameraRow.FX, CameraRow.FY, CameraRow.SHEAR]] /= factor
    rows[:, [CameraRow.CX, CameraRow.CY]] = (rows[:, [CameraRow.CX, CameraRow.CY]] + 0.5) / factor - 0.5
    return rows


@lru_cache(maxsize=8)
def _grids(shapes: bytes) -> Array32:
    """(P, R * C, 3) surface points of all parts, from their packed shapes."""
    grids = []
    for shape in np.frombuffer(shapes).reshape(-1, SuperquadricRow.N_COLUMNS):
        eta, omega = spread(shape, *_GRID)
        points, _ = surface(shape, eta[:, None], omega[None, :])
        grids.append(_GROWN * points.reshape(-1, 3))
    return frozen(grids, np.float32)


# Images made smaller, in which places are compared with earlier images, and the persons' masks.

_SMALL_PX = 180
"""Longer side of the largest small image: a forearm is 5 px wide, and noise is a quarter."""


def reduction(rig: Rig) -> int:
    """Pixels of an image, along each side, for one of the small picture, in all views."""
    return max(1, *(round(max(camera.size) / _SMALL_PX) for camera in rig.cameras))


def reduced(sight: Sight, v: int, image: Image, factor: int) -> Image:
    """The image (H, W, 3) of a view made smaller (h, w, 3); once a frame."""
    whole = 0, 0, image.shape[1], image.shape[0]
    found: Image = sight.once(_resized, v, whole, partial(_resized, image, factor))[1]
    return found


def reduced_silhouettes(scene: Scene, factor: int) -> tuple[Mask, ...]:
    """(h, w) cover of the persons in the small pictures."""
    return CpuSynthesis().silhouettes(replace(scene, rig=scene.rig.downscaled(factor)))


def _resized(image: Image, factor: int, region: Region) -> tuple[Region, Image]:
    size = image.shape[1] // factor, image.shape[0] // factor
    whole = image[: size[1] * factor, : size[0] * factor]
    small: Image = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
    return region, small


@dataclass(frozen=True, eq=False)
class Bare(SmallPictures):
    """Departures that poses have to cover, in small pictures of all V views.

    One of the two pictures has the departures, the other the same with staying places.
    """

    masks: tuple[Mask | None, ...]
    """(h, w) departures; None if unknown."""

    missing: Mask
    """(V,) views without an image."""

    @cached_property
    def worth(self) -> Array:
        """(V, 2) sums of the pictures; NaN for a missing view."""
        ends = [(start, start + width * height) for start, width, height in self.regions.tolist()]
        sums = np.array([self.pictures[start:end].sum(axis=0, dtype=np.float64) for start, end in ends])
        found: Array = np.where(self.missing[:, None], np.nan, sums)
        return found


@dataclass(frozen=True)
class AtStart:
    """Observation in a first frame: a scene at the start poses teaches it, as it teaches colours."""

    begun: Callable[[Scene], Bare]
    _found: list[Bare] = field(default_factory=list, repr=False, compare=False)

    def of(self, scene: Scene) -> Bare:
        """Observation if the persons of a scene are about where they are."""
        if not self._found:
            self._found.append(self.begun(scene))
        return self._found[0]


def begun_at(asked: Comparison) -> Comparison:
    """The question with the observation known, in a first frame as well."""
    return asked.put(asked.observed.of(asked.scene)) if isinstance(asked.observed, AtStart) else asked


def bare_in(views: Sequence[tuple[Mask | None, Mask | None]], factor: int, missing: Mask) -> Bare:
    """Departures for poses to cover, prepared for comparison.

    Args:
        views: (h, w) departures, and staying places, of each view; None if unknown.
        factor: pixels of an image for one of these masks, along each side.
        missing: (V,) views without an image.
    """
    pictures, regions, start = [np.zeros((0, 2), dtype=np.float32)], [], 0
    for departed, stays in views:
        height, width = (0, 0) if departed is None else departed.shape
        regions.append((start, width, height))
        start += width * height
        if departed is not None and stays is not None:
            pair = _core(departed), _core(departed | stays)
            pictures.append(np.stack(pair, axis=-1).reshape(-1, 2))
    masks = tuple(departed for departed, _ in views)
    return Bare(factor, frozen(regions, np.int64), frozen(np.concatenate(pictures), np.float32), masks, missing)


def covered_by_skins(asked: Comparison, poses: Array) -> Array:
    """(B, V) sums that poses (B, dof) leave bare, covering with their own surface."""
    seen: Bare = asked.observed
    covered = np.zeros((len(poses), len(seen.masks)))
    rig = asked.scene.rig.downscaled(seen.factor)
    for b, q in enumerate(poses):
        masks = CpuSynthesis().silhouettes(replace(asked.scene.with_pose(asked.person, q), rig=rig))
        for v, (start, width, height) in enumerate(seen.regions.tolist()):
            core = seen.pictures[start : start + width * height, 1].reshape(height, width)
            covered[b, v] = core[masks[v][:height, :width]].sum()
    return covered


def missed_by_limbs(asked: Comparison, q: Array) -> Array:
    """(P,) outline that a pose (dof,) leaves bare, by all limbs that reach it in the image, px.

    It may be either of two hands, and a lost hand is often not the nearest.
    """
    body, seen = asked.body, asked.observed
    missed = np.zeros(len(body.parts))
    scene = asked.scene.with_pose(asked.person, q)
    rig = scene.rig.downscaled(seen.factor)
    covered = CpuSynthesis().silhouettes(replace(scene, rig=rig))
    places = scene.world_from_parts()[0][asked.own, :3, 3]
    radii, halves = scene.shapes[asked.own, :2].min(axis=1), scene.shapes[asked.own, 2]
    limbs = [np.flatnonzero(body.parts_of(group)) for group in body.limbs]
    for camera, mask, model in zip(rig.cameras, seen.masks, covered, strict=True):
        if mask is None or not limbs:
            continue
        thick = _core(mask & ~model[: mask.shape[0], : mask.shape[1]])
        rows, columns = np.nonzero(thick > 0.5)
        depths = camera.in_camera(places)[:, 2]
        if not len(rows) or (depths <= 0).any():
            continue
        gaps = np.linalg.norm(np.stack([columns, rows], axis=-1)[:, None] - camera.project(places)[None], axis=2)
        # a strip of a limb's width has two sides
        lengths = seen.factor / np.maximum(camera.matrix[0, 0] * radii / depths, 1.0)
        for parts in limbs:
            reach_m = (2 * halves[parts]).sum() - halves[parts[0]]
            which = gaps[:, parts[0]] <= camera.matrix[0, 0] * reach_m / depths[parts[0]]
            nearest = parts[gaps[:, parts].argmin(axis=1)]
            np.add.at(missed, nearest[which], (lengths[nearest] * thick[rows, columns])[which])
    return missed


def _core(mask: Mask) -> Array32:
    """(h, w) worth of covering each pixel, 0 to 1: the rim belongs to clothes, which a model's parts lack."""
    inwards = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3)
    worth: Array32 = np.clip((inwards - 0.5) / 1.5, 0, 1).astype(np.float32)
    return worth
