"""Attached points and their positions in a frame: distances, and their derivatives by the pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.cameras.rig import Rig
from tracker.evidence._attachment import Attachments, Followed
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.geometry.superquadrics import signed_distance


@dataclass(frozen=True)
class Residuals:
    """Residuals of N points, position by the part minus position seen, in D axes of image or space, px."""

    residual: Array
    """(N, D) px; 0 in the third axis of an image."""

    jacobian: Array
    """(N, D, dof) px per rad or metre."""

    covariance: Array
    """(N, D, D) of the residual, px^2; 1 in the third axis of an image."""

    n_axes: Integers
    """(N,) axes that count."""

    seen: Mask
    """(N,) whether the surface there faces the camera."""

    @property
    def variance(self) -> Array:
        """(N,) mean over the axes that count, px^2."""
        diagonals = np.diagonal(self.covariance, axis1=1, axis2=2)
        counts = np.arange(diagonals.shape[1]) < self.n_axes[:, None]
        variance: Array = np.where(counts, diagonals, 0.0).sum(axis=1) / self.n_axes
        return variance

    def beyond(self, sigmas: float) -> Mask:
        """(N,) points farther off than so many standard deviations, or on the far side of their part."""
        solved = np.linalg.solve(self.covariance, self.residual[..., None])[..., 0]
        squares = (self.residual * solved).sum(axis=1) / self.n_axes
        off: Mask = (squares > sigmas**2) | ~self.seen
        return off

    def along(self, directions: Array) -> Residuals:
        """Their components along directions (N, D); weak where a direction is short."""
        length = np.linalg.norm(directions, axis=1)
        unit = directions / np.maximum(length, 1e-9)[:, None]
        weak = np.maximum(length, 1e-3)[:, None, None]
        return Residuals(
            (self.residual * unit).sum(axis=1, keepdims=True),
            np.einsum("ni,nij->nj", unit, self.jacobian)[:, None],
            np.einsum("ni,nij,nj->n", unit, self.covariance, unit)[:, None, None] / weak**2,
            np.ones_like(self.n_axes),
            self.seen,
        )


_FACING = 0.1
"""Least cosine between a point's surface normal and the camera: beyond it the point is something else."""

_ALONG = 0.8
"""Cosine between a parameter's axis and a part's long one from which on the parameter turns the part about it."""

_IN_VIEW_M = 0.1
"""Least distance before a camera, metres."""


@dataclass(frozen=True)
class Held:
    """N attached points of one person in a frame."""

    rows: Integers
    """(N,) their numbers among the attachments."""

    part: Integers
    """(N,) their parts among the person's own."""

    suspect: Mask
    """(N,) points away from their part in the last frame: until they are back they move nothing."""

    place: Array
    """(N, 3) in the part's frame, metres."""

    covariance: Array
    """(N, 3, 3) of the place, square metres."""

    view: Integers
    """(N,) view in which the point was followed; -1 in space."""

    seen_at: Array
    """(N, 3) pixel and 0, or the position in space, metres."""

    noise: Array
    """(N, 3, 3) covariance of it, likewise; 1 in the third axis of an image, for an inverse."""

    def shares(self, observations: float) -> Array:
        """(N,) weights, so that those of a part in a view count as no more than `observations`."""
        _, group, sizes = np.unique(np.stack([self.part, self.view]), axis=1, return_inverse=True, return_counts=True)
        shares: Array = np.minimum(1.0, observations / np.maximum(sizes[group.ravel()], 1))
        return shares

    def gaps_px(self, body: BodyModel, poses: Array, rig: Rig, most_m: float) -> Array:
        """(B, N) distances at poses (B, dof), at most that of a wrong point, px."""
        world = self.world(body, poses)
        gaps = np.zeros(world.shape[:2])
        for v in np.unique(self.view):
            rows = self.view == v
            scale = _px_per_m(rig, int(v), world[:, rows])
            if v < 0:
                off = scale * np.linalg.norm(world[:, rows] - self.seen_at[rows], axis=-1)
            else:
                off = np.linalg.norm(rig.cameras[v].project(world[:, rows]) - self.seen_at[rows, :2], axis=-1)
            gaps[:, rows] = np.minimum(np.where(np.isfinite(off), off, np.inf), most_m * scale)
        return gaps

    def residuals(self, body: BodyModel, q: Array, rig: Rig, slide_m: float) -> Residuals:
        """Positions by the parts minus positions seen, linearized at a pose.

        Args:
            body: the person's.
            q: (dof,) rad and m.
            rig: the cameras.
            slide_m: standard deviation of a point against its part, metres.
        """
        world, placed = self.world(body, q[None])[0], body.world_from_part(q)[self.part]
        rotations = placed[:, :3, :3]
        spread = rotations @ self.covariance @ rotations.transpose(0, 2, 1) + slide_m**2 * np.eye(3)
        slope, gap, noise = self._slopes(rig, world), np.zeros_like(world), np.array(self.noise)
        facing = np.ones(len(self.part))
        for v in np.unique(self.view):
            rows = self.view == v
            if v < 0:
                scale = _px_per_m(rig, -1, world[rows])[:, None]
                gap[rows] = scale * (world[rows] - self.seen_at[rows])
                noise[rows] *= scale[..., None] ** 2
            else:
                gap[rows, :2] = rig.cameras[v].project(world[rows]) - self.seen_at[rows, :2]
                facing[rows] = self._facing(body, placed, world, rows, rig.cameras[v].centre)
        covariance = slope @ spread @ slope.transpose(0, 2, 1) + noise
        jacobian = slope @ body.point_jacobian(q, world, body.part_parameters[self.part])
        seen: Mask = (facing > _FACING) & np.isfinite(gap).all(axis=1)
        return Residuals(np.where(seen[:, None], gap, 0.0), jacobian, covariance, np.where(self.view < 0, 3, 2), seen)

    def turns(self, body: BodyModel, q: Array, rig: Rig) -> Array:
        """(N, 3) movement of points by a turn of their part about its long axis; 1 across the line of sight, else less.

        In the axes of the residuals. Near a contour a turn moves a point only in depth, which an image hardly shows.
        """
        world, placed = self.world(body, q[None])[0], body.world_from_part(q)[self.part]
        turn = np.cross(placed[:, :3, 2], world - placed[:, :3, 3])
        # a point on the axis itself tells of no turn; it must not divide by nothing
        turn /= np.maximum(np.linalg.norm(turn, axis=1, keepdims=True), 1e-6)
        slope = self._slopes(rig, world)
        moved: Array = (slope @ turn[..., None])[..., 0] / np.linalg.norm(slope, ord=2, axis=(1, 2))[:, None]
        return moved

    def _slopes(self, rig: Rig, world: Array) -> Array:
        """(N, 3, 3) derivatives of the residuals' axes by the points, px per metre."""
        slope = np.zeros((len(world), 3, 3))
        for v in np.unique(self.view):
            rows = self.view == v
            if v < 0:
                slope[rows] = _px_per_m(rig, -1, world[rows])[:, None, None] * np.eye(3)
            else:
                slope[rows, :2] = rig.cameras[v].project_jacobian(world[rows])
        return slope

    def world(self, body: BodyModel, poses: Array) -> Array:
        """(B, N, 3) positions by the parts, metres."""
        placed = body.world_from_part(poses)[:, self.part]
        world: Array = (placed[..., :3, :3] @ self.place[..., None])[..., 0] + placed[..., :3, 3]
        return world

    def _facing(self, body: BodyModel, placed: Array, world: Array, rows: Mask, centre: Array) -> Array:
        """Cosines between the surface at some of the points and the direction to a camera."""
        normals = np.zeros((len(self.part), 3))
        for p in np.unique(self.part[rows]):
            own = rows & (self.part == p)
            normals[own] = signed_distance(body.shapes[p], self.place[own])[1]
        outwards = np.einsum("nij,nj->ni", placed[rows, :3, :3], normals[rows])
        towards = centre - world[rows]
        cosines: Array = (outwards * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
        return cosines


def turning(body: BodyModel) -> Mask:
    """(P,) parts that parameters of their own segment turn about their long axes.

    In a model without pronation a forearm follows its hand and does not turn: its points must not turn the upper arm
    instead.
    """
    segments = {segment.name: segment.parameters for segment in body.segments}
    found = np.zeros(len(body.parts), dtype=np.bool_)
    for p, part in enumerate(body.parts):
        own = [body.parameters[k] for k in segments.get(part.segment, ()) if body.rotates[k]]
        found[p] = any(abs(parameter.axis @ part.model_from_part[:3, 2]) > _ALONG for parameter in own)
    return found


def held_in(
    attached: Attachments, tables: Sequence[Followed], frame: int, seen: Sequence[bool], first_part: int
) -> Held:
    """The attached points of a person in views that are not missing.

    Args:
        attached: of the person.
        tables: the followed points.
        frame: its number.
        seen: (V,) views that are not missing; points in space need any.
        first_part: number of the person's first part in the scene.
    """
    rows, views, places, noises = [], [], [], []
    for k, table in enumerate(tables):
        if not (any(seen) if table.view < 0 else seen[table.view]):
            continue
        points, seen_at, noise = table.at(frame)
        mine = np.flatnonzero((attached.table == k) & (attached.part >= 0))
        at = np.searchsorted(points, attached.point[mine])
        found = at < len(points)
        found[found] = points[at[found]] == attached.point[mine[found]]
        mine, at = mine[found], at[found]
        n_axes = seen_at.shape[1]
        whole = np.tile(np.eye(3), (len(mine), 1, 1))
        whole[:, :n_axes, :n_axes] = noise[at]
        rows.append(mine)
        views.append(np.full(len(mine), table.view))
        places.append(np.pad(seen_at[at], ((0, 0), (0, 3 - n_axes))))
        noises.append(whole)
    chosen = np.concatenate([np.zeros(0, dtype=np.int64), *rows])
    return Held(
        chosen,
        attached.part[chosen] - first_part,
        attached.strikes[chosen] > 0,
        attached.place[chosen],
        attached.covariance[chosen],
        np.concatenate([np.zeros(0, dtype=np.int64), *views]),
        np.concatenate([np.zeros((0, 3)), *places]),
        np.concatenate([np.zeros((0, 3, 3)), *noises]),
    )


def _px_per_m(rig: Rig, view: int, points: Array) -> Array:
    """(...,) size of a metre at points (..., 3) in a view, or the mean over all of them, px."""
    cameras = rig.cameras if view < 0 else (rig.cameras[view],)
    sizes = [camera.matrix[0, 0] / np.maximum(camera.in_camera(points)[..., 2], _IN_VIEW_M) for camera in cameras]
    mean: Array = np.mean(sizes, axis=0)
    return mean
