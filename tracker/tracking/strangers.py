"""Who moves beside the persons and is none of them: found in space, and taken for what hides the persons."""

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
"""Edge of the cells of space that strangers are looked for in, metres."""

_REACH_M, _FROM_M, _TO_M = 2.5, 0.3, 2.1
"""How far around the persons cells reach, and from what height to what above their lowest joint, metres: a shadow is
no higher than the floor."""

# See docs/lab/bystanders.md.
_OWN_M, _NEAR_M = 0.12, 0.25
"""What changes so near to a person's silhouette, or lies so near to the bones, is the person's: limbs that have moved
since, clothes, hair."""

_FAR_M, _LEAST_CELLS, _LEAST_HIGH_M = 0.4, 20, 0.6
"""Somebody fills so many cells that are so far from the bones, and is so high; a limb that was lost does not."""

_LEAST_COVERED = 0.5
"""Share of the persons' silhouettes before what has changed, mean of the views: with less they are elsewhere, and what
stands out may be they. Of predictions in a fast dance it was 0.6 and more."""

_RIM_M = 0.05
"""Around what stands out, and around the persons before whom nobody is, metres: edges are that wide."""

_FAIR = 0.3
"""Share of a piece of what has changed that a stranger's cells cover where all of it is his: hands and feet, too."""


@dataclass(frozen=True)
class _View:
    """A view that can tell, every fourth pixel of it."""

    number: int
    camera: Camera
    changed: Mask
    """(h, w) what differs from the plate, or is not known."""

    apart: Mask
    """(h, w) what differs from it and is not near a person's silhouette."""

    model: Mask
    """(h, w) the persons' silhouettes."""

    px_per_m: float
    """Its pixels of a metre where the persons are."""


def hide_strangers(sight: Sight, scene: Scene, synthesis: Synthesis) -> None:
    """Takes whoever is none of the persons for what hides them in a sight, from now on.

    What stands out there in an image is nobody's, and contours that the model has there count for nothing, as before
    furniture that is painted. Of a dancer with somebody beside him 16 of 60 frames had a joint off, 29 mm on average;
    so none has, 18 mm, as with a model of both.

    Args:
        sight: the images, and the plates to compare them with.
        scene: the persons where they are taken to be.
        synthesis: draws them.
    """
    found = strangers(sight, scene, synthesis)
    if found:
        sight.hide(found)


def strangers(sight: Sight, scene: Scene, synthesis: Synthesis) -> dict[int, Mask]:
    """View -> where (H, W) somebody who is none of the persons is before them, or stands out beside them.

    Cells of space that are foreground in all views which see them, and in two of them not near a person's silhouette,
    are somebody's, if they are as high and thick as a body. Nothing where fewer than two views have plates.

    Args:
        sight: the images, and the plates to compare them with.
        scene: the persons where they are taken to be.
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
    """The views that can tell; with masks of the user's own, which show the persons alone, there are no strangers."""
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
    """Whether something is high enough beside the persons: their shadows, on a floor, are not."""
    return _has_piece_of(view.apart, (_FROM_M + _LEAST_HIGH_M) * view.px_per_m)


def _has_piece_of(mask: Mask, least_px: float) -> bool:
    """Whether a connected piece of a mask (h, w) is so high."""
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
    """Which of cells at points (N, 3) all views that see them show, and two of them beside the persons.

    Where one view shows a person and another one a stranger may be nobody: cells that two views alone show beside the
    persons count only as far as these views need them.
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
    """Middles (N, 3) of the cells around the persons, metres, and how many there are along each axis."""
    low = np.append(bones[:, :2].min(axis=0) - _REACH_M, bones[:, 2].min() + _FROM_M)
    high = np.append(bones[:, :2].max(axis=0) + _REACH_M, bones[:, 2].min() + _TO_M)
    axes = [np.arange(start, end, _CELL_M) for start, end in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return points.reshape(-1, 3), points.shape[:3]


def _shown(view: _View, bodies: Sequence[Array], middle: Array) -> Mask:
    """Where (h, w) a view may show strangers: before the persons, or beside them."""
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
    """The pieces of what stands out beside the persons that lie in a region to a fair share."""
    count, labels = cv2.connectedComponents(apart.view(np.uint8))
    inside = np.bincount(labels[region], minlength=count)
    taken = inside >= _FAIR * np.bincount(labels.ravel(), minlength=count)
    taken[0] = False
    found: Mask = taken[labels]
    return found


def _px_per_m(camera: Camera, points: Array) -> float:
    """Sparse pixels of a metre where points (N, 3) are."""
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
