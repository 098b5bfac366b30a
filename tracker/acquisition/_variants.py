"""Many shapes of one body at once, as arrays: what derivatives by the shape need, without making bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.acquisition._anatomy import Anatomy
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.foundation.arrays import Array, Integers, frozen
from tracker.foundation.geometry.superquadrics import surface
from tracker.kernels.body import chain_transforms


@dataclass(frozen=True)
class Variants:
    """S bodies of one kind; the twin is a `BodyModel` for each."""

    body: BodyModel
    """One of the kind: its parameters' axes, its tree."""

    points: Array
    """(S, dof, 3) points on the parameters' axes, reference pose, metres."""

    model_from_parts: Array
    """(S, P, 4, 4)"""

    shapes: Array
    """(S, P, 7) packed superquadrics."""

    landmarks: Array
    """(S, L, 3) in the reference pose, metres."""

    @classmethod
    def of(cls, body: BodyModel, description: BodyDescription, changes: Array) -> Variants:
        """The bodies of a description with changes (S, n) of its packed anatomy."""
        general = Anatomy.of(description)
        one = [general.plus(change) for change in changes]
        starts, ends = np.array([a.starts for a in one]), np.array([a.ends for a in one])
        along = ends - starts
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        along = along / length
        side = np.cross(along, general.fronts)
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        placed = np.zeros((*length.shape[:2], 4, 4))
        placed[..., :3, :3] = np.stack([np.cross(side, along), side, along], axis=-1)
        placed[..., :3, 3] = (starts + ends) / 2
        placed[..., 3, 3] = 1.0
        radii, squareness, taper = (np.array([getattr(a, name) for a in one]) for name in _SHAPE)
        shapes = np.concatenate([np.exp(radii), length / 2, squareness, taper], axis=-1)
        joints = np.array([a.joints for a in one])[:, _segments(description)]
        return cls(body, joints, placed, shapes, np.array([a.landmarks for a in one]))

    def _motions(self, q: Array) -> Array:
        rotates, axes, _, parents = self.body.packed
        pose = np.array(q[None], dtype=np.float64)
        # Read-only points, as a body's own: the kernel is compiled for them.
        motions = [chain_transforms(pose, rotates, axes, frozen(points), parents)[0] for points in self.points]
        return np.array(motions)

    def placements(self, q: Array) -> tuple[Array, Array]:
        """Parts (S, P, 4, 4) and landmarks (S, L, 3) in the world at a pose (dof,), metres."""
        motions = self._motions(q)
        parts: Array = motions[:, self.body.part_parameters] @ self.model_from_parts
        ends = [mark.parameter for mark in self.body.landmarks]
        carried = motions[:, ends]
        marks: Array = (carried[..., :3, :3] @ self.landmarks[..., None])[..., 0] + carried[..., :3, 3]
        return parts, marks


def heights(shapes: Array, model_from_parts: Array) -> Array:
    """Highest point less lowest point of bodies (S,), or of a single one, in the reference pose, metres.

    Args:
        shapes: (..., P, 7) packed superquadrics.
        model_from_parts: (..., P, 4, 4)
    """
    low, high = levels(shapes, model_from_parts)
    tall: Array = high.max(axis=-1) - low.min(axis=-1)
    return tall


def levels(shapes: Array, model_from_parts: Array) -> tuple[Array, Array]:
    """Lowest and highest points (..., P) of parts in the reference pose, metres; arguments as of `heights`."""
    eta, omega = np.linspace(-np.pi / 2, np.pi / 2, 25)[:, None], np.linspace(-np.pi, np.pi, 25)[:-1]
    points, _ = surface(np.moveaxis(shapes, -1, 0)[..., None, None], eta, omega)
    up = model_from_parts[..., 2, :]
    found = np.einsum("...pehi,...pi->...peh", points, up[..., :3]) + up[..., 3, None, None]
    return found.min(axis=(-2, -1)), found.max(axis=(-2, -1))


_SHAPE = ("radii", "squareness", "taper")


def _segments(description: BodyDescription) -> Integers:
    """(dof,) segment of each parameter."""
    owners = [k for k, segment in enumerate(description.segments) for _ in segment.parameters]
    return np.array(owners, dtype=np.int64)
