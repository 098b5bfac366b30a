"""The search for stances without plates: scatters poses, and scores them by edges and by moved pixels.

Edges by directional chamfer matching (Liu, Tuzel, Veeraraghavan, Chellappa: Fast directional chamfer matching, CVPR
2010): one distance image for each of a few edge directions. The distance in a contour's own direction is compared with
the mean over
all directions: texture with edges of every direction, and places without edges, neither gain nor lose.

Scattering is the annealed particle filter of Deutscher, Blake and Reid (Articulated body motion capture by annealed
particle filtering, CVPR 2000) in one frame. A kept pose must differ from all better ones, or one of them would soon be
alone.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import Contours
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask
from tracker.images.operations.edges import canny, gradient
from tracker.kernels.pictures import covered_by_rods
from tracker.tracking.hypotheses import different

# Edge directions of 22.5 degrees each, about the error of a coarse pose: a choice.
_DIRECTIONS = 8
# Thresholds of the edge detector are those of `ContourAnalysis`.
_LOW, _HIGH = 3.0, 7.0
_LONGER_SIDE = 360


@dataclass(frozen=True)
class DirectionImages:
    """For each view and edge direction, how much nearer the next edge is than in an average direction."""

    gains: tuple[Array32 | None, ...]
    """(D, h, w) -1 to 1 of each view, positive where an edge of that direction is near; None for a missing view."""

    scales: tuple[float, ...]
    """Pixels of the gains for a pixel of the view."""

    @property
    def empty(self) -> bool:
        """Whether no view has an edge."""
        return not any(gains is not None and gains.any() for gains in self.gains)

    def scores(self, contours: Contours, first_part: int = 0) -> Array:
        """(B, V) mean gain of each pose's contour in each view; 0 for chance.

        Args:
            contours: of B poses.
            first_part: earlier parts belong to others, and their contours do not count.
        """
        found = np.zeros((contours.n_poses, len(self.gains)))
        for v, gains in enumerate(self.gains):
            if gains is None:
                continue
            n = int(contours.counts[:, v].max(initial=0))
            # The samples behind the valid ones hold anything.
            valid = np.arange(n) < contours.counts[:, v, None]
            x, y, dx, dy, weights = np.where(valid, np.moveaxis(contours.positions[:, v, :n], -1, 0), np.float32(0))
            if first_part:
                weights = np.where(contours.parts[:, v, :n] >= first_part, weights, np.float32(0))
            direction = np.floor(np.arctan2(dy, dx) * (_DIRECTIONS / np.pi) + 0.5).astype(np.int64) % _DIRECTIONS
            row, column = _whole(y * self.scales[v], gains.shape[1]), _whole(x * self.scales[v], gains.shape[2])
            total = (weights * gains[direction, row, column]).sum(axis=1)
            found[:, v] = total / np.maximum(weights.sum(axis=1), 1.0)
        return found


def direction_images(frame: Frame, reach: float) -> DirectionImages:
    """The edges of a frame.

    Args:
        frame: the images.
        reach: distance at which an edge gains nothing, in shares of an image's longer side.
    """
    gains, scales = [], []
    for image in frame.images:
        scale = 1.0 if image is None else min(_LONGER_SIDE / max(image.shape[:2]), 1.0)
        gains.append(None if image is None else _gains(image, scale, reach * max(image.shape[:2]) * scale))
        scales.append(scale)
    return DirectionImages(tuple(gains), tuple(scales))


def _gains(image: Image, scale: float, reach_px: float) -> Array32:
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    slopes = gradient(small, 1.0)
    rows, columns = np.nonzero(canny(slopes, _LOW, _HIGH))
    angle = np.arctan2(slopes.dy[rows, columns], slopes.dx[rows, columns]) * (_DIRECTIONS / np.pi)
    near = np.empty((_DIRECTIONS, *small.shape[:2]), dtype=np.float32)
    for k in range(_DIRECTIONS):
        off = np.abs((angle - k + _DIRECTIONS / 2) % _DIRECTIONS - _DIRECTIONS / 2)
        empty = np.ones(small.shape[:2], dtype=np.uint8)
        # Every edge counts in the two directions next to its own.
        empty[rows[off <= 1], columns[off <= 1]] = 0
        distance = cv2.distanceTransform(empty, cv2.DIST_L2, 3) if not empty.all() else np.float32(reach_px)
        near[k] = 1 - np.minimum(distance, np.float32(reach_px)) / np.float32(reach_px)
    gains: Array32 = near - near.mean(axis=0)
    return gains


def _whole(values: Array32, size: int) -> Integers:
    whole: Integers = np.clip(values.astype(np.int64), 0, size - 1)
    return whole


# Pixels of a view that are asked for: a choice.
_PIXELS = 150
# Clothes, and the blur of small pictures.
_CLOTHES_M = 0.03


@dataclass(frozen=True)
class Moved:
    """Differences of a person from the most frequent colours of the views."""

    pixels: tuple[Array32 | None, ...]
    """(N, 2) some pixels of each view; None where the person's pixels are unknown."""

    @property
    def known(self) -> bool:
        """Whether any movement is known."""
        return any(pixels is not None for pixels in self.pixels)

    def covered(self, body: BodyModel, poses: Array, rig: Rig) -> Array:
        """(B,) share of the pixels that poses (B, dof) cover, mean of the views; 1 without movement."""
        if not self.known:
            return np.ones(len(poses))
        placed = body.world_from_part(poses)
        views = [(rig.cameras[v], pixels) for v, pixels in enumerate(self.pixels) if pixels is not None]
        covered: Array = np.mean([_covered(body, placed, camera, pixels) for camera, pixels in views], axis=0)
        return covered


NOTHING = Moved(())
"""Without known movement."""


def moved(masks: tuple[Mask | None, ...]) -> Moved:
    """Pixels spread over masks (H, W) of moved pixels."""
    chosen: list[Array32 | None] = []
    for mask in masks:
        pixels = np.zeros((0, 2), np.float32) if mask is None else np.argwhere(mask)[:, ::-1].astype(np.float32)
        few = np.linspace(0, len(pixels) - 1, min(_PIXELS, len(pixels))).astype(np.int64)
        chosen.append(pixels[few] if len(pixels) else None)
    return Moved(tuple(chosen))


def _covered(body: BodyModel, placed: Array, camera: Camera, pixels: Array32) -> Array:
    """(B,) share of pixels (N, 2) of a view inside the rods of parts placed (B, P, 4, 4)."""
    along = placed[..., :3, 2] * body.shapes[:, 2, None]
    radius = body.shapes[:, :2].max(axis=1)
    depth = np.maximum(camera.in_camera(placed[..., :3, 3])[..., 2], 0.1)
    ends = [camera.project(placed[..., :3, 3] + side * along).astype(np.float32) for side in (-1, 1)]
    reach_px = (camera.matrix[0, 0] * (radius + _CLOTHES_M) / depth).astype(np.float32)
    shares = np.empty(len(placed))
    covered_by_rods(ends[0], ends[1] - ends[0], reach_px, pixels, shares)
    return shares


Stance = Mapping[str, float]
"""Parameter -> degrees; a name without the word of the side means both. The root's angles give the direction of the
body."""


def posed(body: BodyModel, stance: Stance) -> Array:
    """The reference pose (dof,) with a stance's angles; those of the root may be outside its limits."""
    q = body.rest()
    for name, angle_deg in stance.items():
        q[body.columns(name)] = np.radians(angle_deg)
    root = body.root.columns
    clamped = body.clamped(q)
    clamped[root] = q[root]
    return clamped


def turned(body: BodyModel, q: Array, headings: Array) -> Array:
    """A pose (dof,) turned about the vertical by angles (N,), rad: (N, dof), inside the limits.

    All angles of the root change with the heading of a body that lies.
    """
    root = body.root.columns
    columns = root[body.rotates[root]]
    attitude = Rotation.from_matrix(body.world_from_parameters(q)[root[-1], :3, :3])
    about_vertical = Rotation.from_rotvec(np.outer(headings, [0.0, 0.0, 1.0]))
    poses = np.tile(q, (len(headings), 1))
    axes = np.array([body.parameters[column].axis for column in columns])
    if len(columns) == 3 and np.abs(axes[1] @ axes[[0, 2]].T).max() < 1e-6:
        with warnings.catch_warnings():
            # Where the outer and the inner axis fall together, any share of the angle between them will do.
            warnings.filterwarnings("ignore", message="Gimbal lock")
            poses[:, columns] = (about_vertical * attitude).as_davenport(axes, "intrinsic")
    else:
        poses[:, body.root.turn] += headings
    return body.clamped(poses)


def on_floor(body: BodyModel, poses: Array, places: Array, floor_m: float) -> Array:
    """Poses (N, dof) moved so that their lowest part is on the floor and their landmarks are around places (N, 2)."""
    low, high = _box(body, poses)
    moved = poses.copy()
    moved[:, body.root.shifts[:2]] += places - ((low + high) / 2)[:, :2]
    moved[:, body.root.shifts[2]] += floor_m - _lowest(body, poses)
    return moved


def _box(body: BodyModel, poses: Array) -> tuple[Array, Array]:
    marks = body.landmarks_in_world(poses)
    return marks.min(axis=1), marks.max(axis=1)


def _lowest(body: BodyModel, poses: Array) -> Array:
    """Height (N,) of the lowest end of a part, metres."""
    placed = body.world_from_part(poses)
    ends = placed[..., 2, 3] - np.abs(placed[..., 2, 2]) * body.shapes[:, 2]
    lowest: Array = (ends - body.shapes[:, :2].min(axis=1)).min(axis=1)
    return lowest


class Round(NamedTuple):
    """Settings of one round of scattering."""

    kept: int
    """Number of poses scattered, the best ones."""

    each: int
    """Number of poses made of each."""

    share: float
    """Share of the first round's scatter."""

    apart_m: float
    """Least mean distance of the landmarks of two kept poses, metres."""


ROUNDS = (
    Round(120, 24, 1.0, 0.2),
    Round(80, 24, 0.7, 0.15),
    Round(40, 30, 0.5, 0.1),
    Round(30, 40, 0.35, 0.1),
    Round(20, 40, 0.25, 0.1),
)
"""Some 8000 poses, a quarter of those on the floor. Of a simulated person face down the best score on edges rose from
0.13 to 0.22, before a refinement; that of the true pose is 0.31."""

# Standard deviations of the first round: of joints the distance of stances, of the root half a step of the floor and of
# the turns.
_JOINT_RAD, _TURN_RAD, _SHIFT_M = np.radians(35.0), np.radians(14.0), 0.12
# Every parameter keeps its value in so many poses: scattering seldom corrects all of them at once.
_MOVED = 0.5


def scattered(body: BodyModel, poses: Array, score: Callable[[Array], Array], rounds: tuple[Round, ...]) -> Array:
    """Result of a search around poses; it is the same at every call.

    Args:
        body: whose joint limits hold.
        poses: (N, dof) first poses, the best first.
        score: of poses (B, dof), higher is better (B,).
        rounds: of the search; none leaves the poses unchanged.

    Returns:
        (M, dof) poses, the best first.
    """
    rng = np.random.default_rng(0)
    spread = np.where(body.rotates, _JOINT_RAD, _SHIFT_M)
    root = body.root.columns
    spread[root[body.rotates[root]]] = _TURN_RAD
    for one in rounds:
        kept = np.array(different(body, poses, one.kept, one.apart_m))
        tried = np.repeat(kept, one.each, axis=0)
        moved = rng.random(tried.shape) < _MOVED
        tried += one.share * spread * rng.standard_normal(tried.shape) * moved
        poses = np.concatenate([kept, body.clamped(tried)])
        poses = poses[np.argsort(-score(poses), kind="stable")]
    return poses
