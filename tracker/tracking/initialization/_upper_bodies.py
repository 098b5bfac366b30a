"""Starts of upper bodies, for models whose legs do not move: heads are the tops of the foreground; no floor is needed.

A person at a desk does not stand, and near views show neither legs nor floor. The visual hull shows the
head: in six frames of a man who waves a board before four webcams one of its two highest tops is within 0.18 m of his
(docs/lab/upper_bodies.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from tracker.bodies.body import BodyModel
from tracker.cameras.frame import seen_pixels
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.tracking.initialization._foregrounds import cleaned
from tracker.tracking.initialization._placement import axis_marks, has_axis, stands_upright
from tracker.tracking.initialization._stance_search import Stance, posed, turned
from tracker.tracking.initialization._visual_hull import Hull, visual_hull

# Views that see a top, of rigs that have as many.
_VIEWS = 3
# A piece thinner than three voxels is not a head; one top in so many voxels each way, and the highest ones of all.
_THICK, _APART, _MOST_TOPS = 3, 9, 8
# How far a head is from where somebody was told to be, at most, metres: who leans forwards.
_NEAR_M = 1.0
# Where the head may be from a top, metres: two voxels to each side, and lower rather than higher.
_BESIDE_M, _ABOVE_M = (-0.08, 0.0, 0.08), (-0.12, -0.04, 0.04)
# Leans of the trunk to one side at a time, and turns, degrees: a coarse search.
_LEANS_DEG, _TURN_DEG = 20.0, 20.0
# Least share of the trunk in a view that lies in the foreground, and least share of it that two views show: true poses
# of the man at his desk have 0.86 and more, and 0.7.
_INSIDE, _SHOWN = 0.75, 0.5
# Where in the parts it is looked at, in half lengths of their axes.
_WITHIN = 0.7
# Poses at a time: bounds the memory.
_BATCH = 4096


def has_upper_body_alone(body: BodyModel) -> bool:
    """Whether no limb moves the feet: legs are one piece with the trunk, or there are none."""
    placed = body.world_from_part(body.rest())
    lowest = int(np.argmin(placed[:, 2, 3] - np.abs(placed[:, 2, 2]) * body.shapes[:, 2]))
    arms = [limb for limb in body.limbs if body.partner_of(limb)]
    return (
        bool(arms)
        and has_axis(body)
        and stands_upright(body)
        and not any(body.parts_of(limb)[lowest] for limb in body.limbs)
    )


def upper_poses(
    body: BodyModel, rig: Rig, masks: tuple[Mask | None, ...], at: tuple[float, float] | None = None
) -> Array:
    """Poses (N, dof), limbs as in the reference pose, heads near tops of the foreground, trunks in the foreground.

    Args:
        body: whose legs do not move.
        rig: the cameras.
        masks: (H, W) foreground of each view, None where there is none.
        at: approximate place of the person, metres, if given.
    """
    clean = tuple(None if mask is None else cleaned(mask) for mask in masks)
    tops = hull_tops(visual_hull(rig, clean, 0), sum(mask is not None for mask in masks))
    if at is not None:
        tops = tops[np.linalg.norm(tops[:, :2] - at, axis=1) < _NEAR_M]
    places = _around(tops[:_MOST_TOPS])
    ways = _leaning(body)
    heads = body.landmarks_in_world(ways)[:, axis_marks(body)[0]]
    poses = np.repeat(ways, len(places), axis=0)
    poses[:, body.root.shifts] += np.tile(places, (len(ways), 1)) - np.repeat(heads, len(places), axis=0)
    poses = body.clamped(poses)
    batches = (poses[i : i + _BATCH] for i in range(0, len(poses), _BATCH))
    kept = [batch[_stands_out(body, batch, rig, clean)] for batch in batches]
    return np.concatenate(kept) if kept else poses


def hull_tops(hull: Hull, n_views: int) -> Array:
    """(N, 3) middles of the highest places of a hull, metres, the highest one first.

    Args:
        hull: of the foreground.
        n_views: number of views of it.
    """
    hull = hull.part(hull.seen * n_views > min(_VIEWS, n_views) - 0.5)
    if not len(hull.cells):
        return np.zeros((0, 3))
    low = hull.cells.min(axis=0) - 1
    grid = np.zeros(hull.cells.max(axis=0) - low + 2, dtype=np.bool_)
    grid[tuple((hull.cells - low).T)] = True
    grid = ndimage.binary_opening(grid, np.ones((_THICK,) * 3, dtype=np.bool_))
    heights = np.where(grid.any(axis=2), grid.shape[2] - 1 - np.argmax(grid[:, :, ::-1], axis=2), -1)
    highest = (heights >= 0) & (heights == ndimage.maximum_filter(heights, size=_APART))
    labels, n = ndimage.label(highest, np.ones((3, 3), dtype=np.bool_))
    middles = np.array(ndimage.center_of_mass(highest, labels, range(1, n + 1))).reshape(-1, 2)
    levels = np.array(ndimage.maximum(heights, labels, range(1, n + 1))).reshape(-1, 1)
    step_m = _step_m(hull)
    tops: Array = hull.points[0] + step_m * (np.hstack([middles, levels]) + low - hull.cells[0])
    return tops[np.argsort(-tops[:, 2], kind="stable")]


def _step_m(hull: Hull) -> float:
    """Edge of a voxel, metres."""
    cells, points = np.ptp(hull.cells, axis=0), np.ptp(hull.points, axis=0)
    return float(points.max() / max(cells.max(), 1))


def _around(tops: Array) -> Array:
    """(M, 3) places of a head near tops (N, 3), metres."""
    offsets = np.stack(np.meshgrid(_BESIDE_M, _BESIDE_M, _ABOVE_M, indexing="ij"), axis=-1).reshape(-1, 3)
    places: Array = (tops[:, None] + offsets).reshape(-1, 3)
    return places


def _leaning(body: BodyModel) -> Array:
    """(N, dof) the reference pose in all turns, upright and leaning forwards, backwards and to each side."""
    root = body.root.columns
    headings, ways = np.radians(np.arange(-180.0, 180.0, _TURN_DEG)), [body.rest()]
    for column in (column for column in root[body.rotates[root]] if column != body.root.turn):
        for side in (-1.0, 1.0):
            q = body.rest()
            q[column] += side * np.radians(_LEANS_DEG)
            ways.append(q)
    return np.concatenate([turned(body, q, headings) for q in ways])


def in_stances(body: BodyModel, poses: Array, stances: Sequence[Stance]) -> Array:
    """Poses (N, dof) with the limbs as in each of S stances: (S N, dof)."""
    limbs = np.concatenate([body.group(limb) for limb in body.limbs])
    found = np.tile(poses, (len(stances), 1))
    found[:, limbs] = np.repeat([posed(body, stance)[limbs] for stance in stances], len(poses), axis=0)
    return found


def _stands_out(body: BodyModel, poses: Array, rig: Rig, masks: tuple[Mask | None, ...]) -> Mask:
    """(N,) whether the trunk of poses (N, dof) lies in the foreground of all views, and two show it."""
    points = _in_trunk(body, poses)
    n_showing, inside = np.zeros(len(poses), dtype=np.int64), np.ones(len(poses), dtype=np.bool_)
    for camera, mask in zip(rig.cameras, masks, strict=True):
        if mask is None:
            continue
        pixels, seen = seen_pixels(camera, points.reshape(-1, 3))
        hit = np.zeros(len(pixels), dtype=np.bool_)
        hit[seen] = mask[pixels[seen, 1], pixels[seen, 0]]
        n_seen, n_hit = (which.reshape(len(poses), -1).sum(axis=1) for which in (seen, hit))
        n_showing += n_seen > _SHOWN * points.shape[1]
        inside &= n_hit >= _INSIDE * n_seen
    return np.asarray(inside & (n_showing >= min(2, len(rig))))


def _in_trunk(body: BodyModel, poses: Array) -> Array:
    """(N, P, 3) points inside head and trunk of poses (N, dof), down to where the body's axis ends, metres."""
    rest = body.rest()
    base_m = body.landmarks_in_world(rest)[axis_marks(body)[1], 2]
    trunk = body.world_from_part(rest)[:, 2, 3] > base_m
    for limb in body.limbs:
        trunk &= ~body.parts_of(limb)
    placed = body.world_from_part(poses)[:, trunk]
    along = _WITHIN * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    offsets = along * body.shapes[trunk, None, :3]
    points = placed[:, :, None, :3, 3] + np.einsum("npij,pkj->npki", placed[..., :3, :3], offsets)
    return np.asarray(points.reshape(len(poses), -1, 3))
