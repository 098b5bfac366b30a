"""Strangers, who move beside the persons: found in space, and taken for things that hide the persons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import seen_pixels
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.images.operations.appearance import SAMPLING
from tracker.images.operations.masks import grown
from tracker.images.sight import Sight
from tracker.synthesis import Synthesis

_CELL_M = 0.12
"""Edge of the cells of space for strangers, metres."""

_REACH_M, _FROM_M, _TO_M = 2.5, 0.3, 2.1
"""Range of the cells around the persons, and heights above their lowest joint from and to, metres: a shadow is no
higher than the floor."""

# See docs/lab/bystanders.md.
_OWN_M, _NEAR_M = 0.12, 0.25
"""Changes this near to a person's silhouette, or to the bones, are the person's: limbs that have moved since, clothes,
hair."""

_FAR_M, _LEAST_CELLS, _LEAST_HIGH_M = 0.4, 20, 0.6
"""Number of cells of a stranger, their distance from the bones, and their height; a lost limb does not reach them."""

_LEAST_COVERED = 0.5
"""Share of the persons' silhouettes on changed pixels, mean of the views: with less they are elsewhere, and the changes
may be theirs. Of predictions in a fast dance it was 0.6 and more."""

_RIM_M = 0.05
"""Margins around changes, and around the persons in front, metres: edges are that wide."""

_FAIR = 0.3
"""Share of a changed region covered by a stranger's cells from which on all of it is the stranger's, including hands
and feet."""


@dataclass(frozen=True)
class _View:
    """A view with a plate, every fourth pixel of it."""

    number: int
    camera: Camera
    changed: Mask
    """(h, w) pixels that differ from the plate, or are unknown."""

    apart: Mask
    """(h, w) pixels that differ from it and are not near a person's silhouette."""

    model: Mask
    """(h, w) the persons' silhouettes."""

    px_per_m: float
    """Its pixels of a metre where the persons are."""


def hide_strangers(sight: Sight, scene: Scene, synthesis: Synthesis) -> None:
    """Marks strangers as things that hide the persons in a sight, from now on.

    Changes there in an image belong to no person, and contours of the model there count for nothing, as before painted
    furniture. Of a dancer with another person beside 16 of 60 frames had a joint off, 29 mm on average; with this rule
    none has, 18 mm, as with a model of both.

    Args:
        sight: the images, and the plates to compare them with.
        scene: the persons at their poses.
        synthesis: draws them.
    """
    found = strangers(sight, scene, synthesis)
    if found:
        sight.hide(found)


def strangers(sight: Sight, scene: Scene, synthesis: Synthesis) -> dict[int, Mask]:
    """View -> pixels (H, W) where a stranger is before the persons, or stands out beside them.

    Cells of space in the foreground of all views which see them, and away from persons' silhouettes in two of them,
    belong to a stranger, if they are as high and thick as a body. Empty if fewer than two views have plates.

    Args:
        sight: the images, and the plates to compare them with.
        scene: the persons at their poses.
        synthesis: draws them.
    """
    bones = _bones(scene)
    views = _views(sight, scene, synthesis, bones)
    if sum(map(_stands_out, views)) < 2 or _covered(views) < _LEAST_COVERED:
        return {}
    bodies = _bodies(views, bones)
    shown = {view.number: _shown(view, bodies, bones.mean(axis=0)) for view in views} if bodies else {}
    return {v: _enlarged(mask, scene.rig.cameras[v].size) for v, mask in shown.items() if mask.any()}


def _bones(scene: Scene) -> Array:
    """Points (N, 3) along the bones of all persons, with their landmarks and the middles of their parts, metres."""
    share = np.linspace(0, 1, 8)[:, None]
    bones = [scene.world_from_parts()[0, :, :3, 3]]
    for person in scene.persons:
        marks, names = person.body.landmarks_in_world(person.q), person.body.landmark_names
        bones.append(marks)
        for one, other in person.body.links:
            start, end = marks[names.index(one)], marks[names.index(other)]
            bones.append(start + share * (end - start))
    return np.concatenate(bones)


def _views(sight: Sight, scene: Scene, synthesis: Synthesis, bones: Array) -> list[_View]:
    """The views with plates; with the user's own masks, which show only the persons, there are no strangers."""
    known = [v for v in range(len(scene.rig)) if sight.lit(v) is not None and sight.frame.mask(v) is None]
    models = synthesis.silhouettes(scene) if len(known) >= 2 else ()
    views = []
    for v in known if models else ():
        differing = sight.sparse_changes(v)
        if differing is None:
            continue
        camera, unknown = scene.rig.cameras[v], sight.unknown(v)
        model = np.ascontiguousarray(models[v][::SAMPLING, ::SAMPLING])
        px_per_m = _px_per_m(camera, bones)
        apart = differing & ~grown(model, _OWN_M * px_per_m)
        changed = differing if unknown is None else differing | unknown[::SAMPLING, ::SAMPLING]
        views.append(_View(v, camera, changed, apart, model, px_per_m))
    return views


def _stands_out(view: _View) -> bool:
    """Whether something beside the persons is high enough: shadows, on a floor, are not."""
    return _has_piece_of(view.apart, (_FROM_M + _LEAST_HIGH_M) * view.px_per_m)


def _has_piece_of(mask: Mask, least_px: float) -> bool:
    """Whether a connected piece of a mask (h, w) is that high."""
    # no piece is higher than the rows with something in them that follow one another: a tenth of the time
    empty = np.flatnonzero(np.concatenate([[True], ~mask.any(axis=1), [True]]))
    if np.diff(empty).max() - 1 < least_px:
        return False
    heights = cv2.connectedComponentsWithStats(mask.view(np.uint8))[2][1:, cv2.CC_STAT_HEIGHT]
    return bool(heights.max(initial=0) >= least_px)


def _covered(views: Sequence[_View]) -> float:
    shares = [float((view.changed & view.model).sum() / view.model.sum()) for view in views if view.model.any()]
    return float(np.mean(shares)) if shares else 0.0


def _bodies(views: Sequence[_View], bones: Array) -> list[Array]:
    """Cells (N, 3) of each stranger, metres."""
    points, shape = _cells(bones)
    left = _foreign(views, points)
    gaps: Array = np.asarray(KDTree(bones).query(points[left])[0])
    left, gaps = left[gaps > _NEAR_M], gaps[gaps > _NEAR_M]
    found = np.zeros(len(points), dtype=np.bool_)
    found[left] = True
    labels = ndimage.label(found.reshape(shape), structure=np.ones((3, 3, 3)))[0].ravel()[left]
    bodies = []
    for label in np.unique(labels):
        own = points[left[labels == label]]
        high = float(np.ptp(own[:, 2])) + _CELL_M
        if high >= _LEAST_HIGH_M and int((gaps[labels == label] > _FAR_M).sum()) >= _LEAST_CELLS:
            bodies.append(own)
    return bodies


def _foreign(views: Sequence[_View], points: Array) -> Integers:
    """Cells at points (N, 3) that all views which see them show, and two of them beside the persons.

    If one view shows a person and another one a stranger, a cell may be empty: cells that only two views show beside
    the persons count as far as these views need them.
    """
    left = np.arange(len(points))
    n_views, n_apart = np.zeros((2, len(points)), dtype=np.int64)
    for view in views:
        at, seen = seen_pixels(view.camera, points[left], SAMPLING)
        x, y = at[seen].T
        n_views[left[seen]] += 1
        n_apart[left[seen]] += view.apart[y, x]
        within = ~seen
        within[seen] = view.changed[y, x]
        left = left[within]
    left = left[(n_views[left] >= 2) & (n_apart[left] >= 2)]
    sure = n_apart[left] >= np.minimum(n_views[left], 3)
    needed = sure.copy()
    for view in views:
        shown, (at, seen) = _spots(view, points[left[sure]]), seen_pixels(view.camera, points[left], SAMPLING)
        x, y = at[seen].T
        needed[seen] |= view.apart[y, x] & ~shown[y, x]
    return left[needed]


def _cells(bones: Array) -> tuple[Array, tuple[int, ...]]:
    """Middles (N, 3) of the cells around the persons, metres, and their number along each axis."""
    low = np.append(bones[:, :2].min(axis=0) - _REACH_M, bones[:, 2].min() + _FROM_M)
    high = np.append(bones[:, :2].max(axis=0) + _REACH_M, bones[:, 2].min() + _TO_M)
    axes = [np.arange(start, end, _CELL_M) for start, end in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return points.reshape(-1, 3), points.shape[:3]


def _shown(view: _View, bodies: Sequence[Array], middle: Array) -> Mask:
    """Pixels (h, w) where a view may show strangers: before the persons, or beside them."""
    shown: Mask = np.zeros_like(view.model)
    for cells in bodies:
        rim = _RIM_M * _px_per_m(view.camera, cells)
        region = _spots(view, cells) & grown(view.changed, rim)
        depths = view.camera.in_camera(np.stack([cells.mean(axis=0), middle]))[:, 2]
        behind = depths[0] > depths[1]
        shown |= region & ~grown(view.model, rim) if behind else region
        shown |= grown(_pieces_in(region, view.apart), rim)
    return shown


def _pieces_in(region: Mask, apart: Mask) -> Mask:
    """The changed regions beside the persons of which a fair share lies in a region."""
    count, labels = cv2.connectedComponents(apart.view(np.uint8))
    inside = np.bincount(labels[region], minlength=count)
    taken = inside >= _FAIR * np.bincount(labels.ravel(), minlength=count)
    taken[0] = False
    found: Mask = taken[labels]
    return found


def _px_per_m(camera: Camera, points: Array) -> float:
    """Sparse pixels for a metre at points (N, 3)."""
    depth = float(np.median(camera.in_camera(points)[:, 2]))
    return float(camera.matrix[0, 0]) / max(depth, 0.1) / SAMPLING


def _spots(view: _View, cells: Array) -> Mask:
    """(h, w) the sparse pixels that cells at points (N, 3) may cover."""
    at, seen = seen_pixels(view.camera, cells, SAMPLING)
    spots = np.zeros_like(view.model)
    if seen.any():
        spots[at[seen, 1], at[seen, 0]] = True
        spots = grown(spots, _CELL_M * _px_per_m(view.camera, cells))
    return spots


def _enlarged(mask: Mask, size: tuple[int, int]) -> Mask:
    """A sparse mask (h, w) as large as the image of (width, height)."""
    whole: Mask = cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    return whole
