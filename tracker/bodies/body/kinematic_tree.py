"""The kinematic tree of a body: positions of parts, landmarks and points at a pose, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tracker.bodies.segments import Landmark, Parameter, Part, Root
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.errors import ModelError, nearest
from tracker.kernels.body import chain_transforms, twists_in_world

# Largest range along a rail of the segment that carries the body, in extents of the body.
_RAIL = 2.0


@dataclass(frozen=True)
class KinematicTree:
    """Parameters, and the parts and landmarks on them; a pose is an array `q` (..., dof), columns = `parameters`.

    Kinematics is a product of exponentials: every parameter is a twist of the reference pose (all zero), and
    ``world_from_part(q) = exp(xi_1 q_1) ... exp(xi_k q_k) model_from_part`` along the part's chain.
    """

    name: str
    parameters: tuple[Parameter, ...]
    parts: tuple[Part, ...]
    landmarks: tuple[Landmark, ...]

    @property
    def dof(self) -> int:
        """Number of pose parameters."""
        return len(self.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in the pose's order."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def landmark_names(self) -> tuple[str, ...]:
        """Landmark names in order."""
        return tuple(landmark.name for landmark in self.landmarks)

    @cached_property
    def limits(self) -> Array:
        """(dof, 2) lowest and highest values, rad or m."""
        return frozen([parameter.limits for parameter in self.parameters]).reshape(-1, 2)

    @cached_property
    def spreads(self) -> Array:
        """(dof,) standard deviations from the rest pose in everyday movement, rad; infinite for free parameters."""
        return frozen([parameter.spread for parameter in self.parameters])

    @cached_property
    def rotates(self) -> Mask:
        """(dof,) true where the parameter is an angle."""
        mask: Mask = frozen([parameter.rotates for parameter in self.parameters], dtype=np.bool_)
        return mask

    @cached_property
    def packed(self) -> tuple[Mask, Array, Array, Integers]:
        """Rotates (dof,), axes (dof, 3), points (dof, 3), parents (dof,) for the kinematics kernels."""
        axes = frozen([parameter.axis for parameter in self.parameters]).reshape(-1, 3)
        points = frozen([parameter.point for parameter in self.parameters]).reshape(-1, 3)
        parents = frozen([parameter.parent for parameter in self.parameters], dtype=np.int64)
        return self.rotates, axes, points, parents

    @cached_property
    def moves(self) -> Mask:
        """(dof, dof + 1): whether parameter i moves the things on parameter j. Column `dof` is the world."""
        mask = np.zeros((self.dof, self.dof + 1), dtype=np.bool_)
        for j, parameter in enumerate(self.parameters):
            mask[j, j] = True
            if parameter.parent >= 0:
                mask[:, j] |= mask[:, parameter.parent]
        mask.setflags(write=False)
        return mask

    @cached_property
    def part_parameters(self) -> Integers:
        """(P,) last parameter that moves each part."""
        indices: Integers = frozen([part.parameter for part in self.parts], dtype=np.int64)
        return indices

    @cached_property
    def model_from_parts(self) -> Array:
        """(P, 4, 4) placement of the parts in the reference pose."""
        return frozen([part.model_from_part for part in self.parts])

    @cached_property
    def carrying(self) -> Integers:
        """The parameters that carry all parts."""
        ends = np.unique([part.parameter for part in self.parts])
        found: Integers = frozen(np.flatnonzero(self.moves[:, ends].all(axis=1)), dtype=np.int64)
        return found

    @cached_property
    def root(self) -> Root:
        """The parameters that carry everything.

        Raises:
            ModelError: no free position along the world's axes or no turn about the vertical.
        """
        columns = self.carrying
        axes = np.array([self.parameters[k].axis for k in columns]).reshape(-1, 3)
        rotates = self.rotates[columns]
        # Behind a rotation a translation would not be along the world's axes.
        before = np.cumsum(rotates) == 0
        shifts = [columns[before & (axes[:, k] > 0.9)] for k in range(3)]
        turns = columns[rotates & (np.abs(axes[:, 2]) > 0.9)]
        if any(len(found) != 1 for found in (*shifts, turns)):
            raise ModelError(
                f'model "{self.name}": expected a root segment that moves along x, y and z (not -x, -y, -z), '
                "then turns about z; see the first segment of models/gavrila22.toml"
            )
        return Root(columns, np.concatenate(shifts), int(turns[0]))

    @cached_property
    def stays(self) -> bool:
        """Whether the body keeps its place at any pose, as an arm of a robot: no root moves it.

        It may slide by twice its own extent, on a rail.
        """
        try:
            return not len(self.root.columns)
        except ModelError:
            slides = [self.parameters[k].limits for k in self.carrying if not self.rotates[k]]
            extent = float(np.ptp(self.model_from_parts[:, :3, 3], axis=0).max())
            return all(high - low <= _RAIL * extent for low, high in slides)

    def index(self, name: str) -> int:
        """Column of the parameter called `name`.

        Raises:
            ModelError: no such parameter.
        """
        if name not in self.names:
            raise ModelError(f'model "{self.name}" has no parameter "{name}"; {nearest(name, self.names)}')
        return self.names.index(name)

    def rest(self) -> Array:
        """(dof,) the reference pose, moved inside the joint limits."""
        pose: Array = self.clamped(np.zeros(self.dof))
        return pose

    def clamped(self, q: Array) -> Array:
        """Poses (..., dof) moved inside the joint limits."""
        inside: Array = np.clip(q, self.limits[:, 0], self.limits[:, 1])
        return inside

    def landmark_sigmas(self, q: Array, covariance: Array) -> Array:
        """(L,) standard deviations of the landmarks, root of the summed variances of x, y, z, metres.

        Args:
            q: (dof,) pose.
            covariance: (dof, dof) of it.
        """
        ends = np.array([mark.parameter for mark in self.landmarks], dtype=np.int64)
        moved = self.point_jacobian(q, self.landmarks_in_world(q), ends)
        sigmas: Array = np.sqrt(np.maximum(np.einsum("lik,km,lim->l", moved, covariance, moved, optimize=True), 0.0))
        return sigmas

    def rarity(self, q: Array) -> Array:
        """How unusual poses (..., dof) are: squares (...) of the standard deviations from the rest pose, summed."""
        squares: Array = (((q - self.rest()) / self.spreads) ** 2).sum(axis=-1)
        return squares

    def world_from_parameters(self, q: Array) -> Array:
        """Motion of the things on each parameter: q (*B, dof) -> (*B, dof + 1, 4, 4); the last is the world."""
        q = np.asarray(q, dtype=np.float64)
        flat = np.array(q.reshape(-1, self.dof), order="C")
        motions: Array = chain_transforms(flat, *self.packed)
        return motions.reshape(*q.shape[:-1], self.dof + 1, 4, 4)

    def world_from_part(self, q: Array) -> Array:
        """Part placements: q (*B, dof) -> (*B, P, 4, 4), metres."""
        placed: Array = self.world_from_parameters(q)[..., self.part_parameters, :, :] @ self.model_from_parts
        return placed

    def landmarks_in_world(self, q: Array) -> Array:
        """Joint centres and other landmarks: q (*B, dof) -> (*B, L, 3), metres."""
        return self.points_in_world(q, *self._marks)

    @cached_property
    def extents_m(self) -> Array:
        """(3,) size of the body in its pose at rest, from landmark to landmark along the axes, metres."""
        return frozen(np.ptp(self.landmarks_in_world(self.rest()), axis=0))

    @cached_property
    def _marks(self) -> tuple[Array, Integers]:
        """The landmarks (L, 3) in the reference pose, metres, and the last parameter (L,) that moves each."""
        ends: Integers = frozen([mark.parameter for mark in self.landmarks], dtype=np.int64)
        points = np.array([mark.point for mark in self.landmarks], dtype=np.float64)
        return frozen(points.reshape(-1, 3)), ends

    def points_in_world(self, q: Array, points: Array, ends: Integers) -> Array:
        """Points of the body at poses.

        Args:
            q: (*B, dof) poses.
            points: (N, 3) in the reference pose, metres.
            ends: (N,) last parameter that moves each, -1 for none.

        Returns:
            (*B, N, 3) metres.
        """
        motions = self.world_from_parameters(q)[..., ends, :, :]
        world: Array = (motions[..., :3, :3] @ points[..., None])[..., 0] + motions[..., :3, 3]
        return world

    def twists(self, q: Array) -> Array:
        """Spatial twists (*B, dof, 6) of all parameters at q (*B, dof): v then w.

        A point X that hangs on parameter j moves by ``w x X + v`` for every parameter i with `moves[i, j]`.
        """
        q = np.asarray(q, dtype=np.float64)
        flat = np.array(q.reshape(-1, self.dof), order="C")
        twists: Array = twists_in_world(chain_transforms(flat, *self.packed), *self.packed)
        return twists.reshape(*q.shape[:-1], self.dof, 6)

    def point_jacobian(self, q: Array, points: Array, parameters: Integers) -> Array:
        """Derivative of world points with respect to the pose.

        Args:
            q: (dof,) pose.
            points: (N, 3) world positions at that pose, metres.
            parameters: (N,) last parameter that moves each point.

        Returns:
            (N, 3, dof), metres per rad or metre.
        """
        twists = self.twists(q)
        velocity = np.cross(twists[None, :, 3:], points[:, None, :]) + twists[None, :, :3]
        jacobian: Array = (velocity * self.moves[:, parameters].T[:, :, None]).transpose(0, 2, 1)
        return jacobian
