"""Articulated bodies: a kinematic tree of segments with parts and landmarks, and all that is known about it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tracker.arrays import Array, Integers, Mask, frozen
from tracker.body_sections import Clothes, Joints, Movement, StartMarks
from tracker.errors import ModelError, nearest
from tracker.kernels.body.kinematics import chain_transforms, twists_in_world
from tracker.kernels.body.self_collision import sum_collisions
from tracker.mirror import Mirror
from tracker.segments import Landmark, Parameter, Part, Root, Segment, unjoined
from tracker.shape import TaperedSuperquadric
from tracker.skin import Skin


@dataclass(frozen=True)
class BodyModel:
    """An articulated body; its pose is an array `q` (..., dof), columns = `parameters`.

    Kinematics is a product of exponentials: every parameter is a twist of the reference pose (all zero), and
    ``world_from_part(q) = exp(xi_1 q_1) ... exp(xi_k q_k) model_from_part`` along the part's chain.
    """

    name: str
    parameters: tuple[Parameter, ...]
    parts: tuple[Part, ...]
    landmarks: tuple[Landmark, ...]
    groups: dict[str, tuple[str, ...]]
    """Search groups: name -> parameter names (paper, section 4.1: torso_head, arms, legs)."""

    links: tuple[tuple[str, str], ...] = ()
    """Pairs of landmarks joined by a bone: the stick figure."""

    stature_m: float = 0.0
    """Height of the body standing in its reference pose, metres."""

    segments: tuple[Segment, ...] = ()
    """The tree of rigid segments, parents first."""

    mirror: Mirror = field(default_factory=Mirror)
    """What mirrors what."""

    start: StartMarks = field(default_factory=StartMarks)
    """Where a search without a prediction begins."""

    joints: Joints = field(default_factory=Joints)
    """Landmarks that results are judged by."""

    clothes: Clothes = field(default_factory=Clothes)
    """How it is dressed where it is simulated."""

    movements: dict[str, Movement] = field(default_factory=dict)
    """Movements to simulate."""

    keypoints: tuple[Landmark, ...] = ()
    """Points that 2-D detectors name and the landmarks do not, by the detectors' names."""

    skin: Skin | None = None
    """Its own surface: what contours and silhouettes are of, while searches live on the parts."""

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
        """(dof,) standard deviations from the rest pose in everyday movement, rad; infinite where nothing is usual."""
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
        """(dof, dof + 1): does parameter i move what hangs on parameter j? Column `dof` is the world."""
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
    def shapes(self) -> Array:
        """(P, 7) packed superquadrics."""
        return frozen([part.shape.packed for part in self.parts])

    @cached_property
    def model_from_parts(self) -> Array:
        """(P, 4, 4) placement of the parts in the reference pose."""
        return frozen([part.model_from_part for part in self.parts])

    @cached_property
    def apart(self) -> Integers:
        """(N, 2) parts that must not run through each other.

        Left out are parts of one segment, of segments next to each other, and parts that overlap in the reference pose.
        """
        chains = [frozenset(np.flatnonzero(self.moves[:, end]).tolist()) for end in self.part_parameters]
        pairs = np.array(unjoined(chains), dtype=np.int64).reshape(-1, 2)
        rest = self.world_from_part(self.rest()[None])
        clear = [self._collisions(rest, frozen(pair[None], np.int64))[0] == 0 for pair in pairs]
        kept: Integers = frozen(pairs[np.array(clear, dtype=np.bool_)], dtype=np.int64)
        return kept

    def collisions(self, q: Array) -> Array:
        """How much the body runs through itself at poses (B, dof): points (B,) by their depth, see `sum_collisions`."""
        return self.collisions_of(self.world_from_part(q))

    def collisions_of(self, placements: Array) -> Array:
        """The same for part placements (B, P, 4, 4) that are known already."""
        return self._collisions(placements, self.apart)

    def _collisions(self, placements: Array, pairs: Integers) -> Array:
        """`sum_collisions`, compiled ahead for contiguous placements and read-only pairs."""
        points: Array = sum_collisions(np.ascontiguousarray(placements), self.shapes, pairs)
        return points

    def index(self, name: str) -> int:
        """Column of the parameter called `name`.

        Raises:
            ModelError: no such parameter.
        """
        if name not in self.names:
            raise ModelError(f'model "{self.name}" has no parameter "{name}"; {nearest(name, self.names)}')
        return self.names.index(name)

    def group(self, name: str) -> Integers:
        """Columns of the parameters in a search group.

        Raises:
            ModelError: no such group.
        """
        if name not in self.groups:
            raise ModelError(f'model "{self.name}" has no group "{name}"; {nearest(name, self.groups)}')
        return self._columns_of_groups[name]

    @cached_property
    def _columns_of_groups(self) -> dict[str, Integers]:
        return {
            name: frozen([self.index(parameter) for parameter in members], dtype=np.int64)
            for name, members in self.groups.items()
        }

    @cached_property
    def coarse_groups(self) -> tuple[str, ...]:
        """Groups that lie in no other one, in order: the decomposition of the whole search."""
        sets = {name: set(members) for name, members in self.groups.items()}
        return tuple(name for name in sets if not any(sets[name] < other for other in sets.values()))

    @cached_property
    def fine_groups(self) -> tuple[str, ...]:
        """Groups that contain no other one, in order: the pieces a search can repair on its own."""
        sets = {name: set(members) for name, members in self.groups.items()}
        return tuple(name for name in sets if not any(other < sets[name] for other in sets.values()))

    def partner_of(self, group: str) -> str | None:
        """The group of the other side, if the model has one with the same parameters."""
        return self._partners[group]

    @cached_property
    def _partners(self) -> dict[str, str | None]:
        found: dict[str, str | None] = {}
        for group, members in self.groups.items():
            other, names = self.mirror.of(group), [self.mirror.of(name) for name in members]
            found[group] = other if other != group and list(self.groups.get(other, ())) == names else None
        return found

    def columns(self, name: str) -> list[int]:
        """Columns of the parameters called so, alone or on either side: `arm_abduction` is that of both arms.

        Raises:
            ModelError: no such parameter.
        """
        return [self.names.index(own) for own in self.mirror.meant(name, self.names)] or [self.index(name)]

    @cached_property
    def reported(self) -> tuple[int, ...]:
        """Numbers of the landmarks that tables of joints hold."""
        names = self.joints.reported or self.landmark_names
        return tuple(self.landmark_names.index(name) for name in names)

    @cached_property
    def root(self) -> Root:
        """The parameters that everything hangs on.

        Raises:
            ModelError: no free position or no turn about the vertical.
        """
        ends = np.unique([part.parameter for part in self.parts])
        columns = np.flatnonzero(self.moves[:, ends].all(axis=1))
        axes = np.array([self.parameters[k].axis for k in columns]).reshape(-1, 3)
        rotates = self.rotates[columns]
        shifts = [columns[~rotates & (np.abs(axes[:, k]) > 0.9)] for k in range(3)]
        turns = columns[rotates & (np.abs(axes[:, 2]) > 0.9)]
        if any(len(found) != 1 for found in (*shifts, turns)):
            raise ModelError(
                f'model "{self.name}": expected a root segment that moves along x, y and z and turns about z; '
                "see the first segment of models/gavrila22.toml"
            )
        return Root(columns, np.concatenate(shifts), int(turns[0]))

    def parts_of(self, group: str) -> Mask:
        """(P,) parts that a fine group moves and no finer chain hanging on it does: an arm's, not the body's."""
        self.group(group)
        return self._parts_of_groups[group]

    @cached_property
    def _parts_of_groups(self) -> dict[str, Mask]:
        return {group: frozen(self._hanging_on(group, self.part_parameters), np.bool_) for group in self.groups}

    def landmarks_of(self, group: str) -> Mask:
        """(L,) landmarks that a fine group moves and no finer chain hanging on it does: an arm's, not the body's."""
        return self._hanging_on(group, np.array([mark.parameter for mark in self.landmarks]))

    def _hanging_on(self, group: str, ends: Integers) -> Mask:
        """Which of the ends of chains a fine group moves, and no finer chain hanging on it does."""
        moved, parts = self.moves[:, ends], self.moves[:, self.part_parameters]
        mine = self.group(group)
        own: Mask = np.asarray(moved[mine].any(axis=0))
        for other in self.fine_groups:
            theirs = self.group(other)
            if other != group and parts[mine].any(axis=0).sum() > parts[theirs].any(axis=0).sum():
                own = own & ~moved[theirs].any(axis=0)
        return own

    def rest(self) -> Array:
        """(dof,) the reference pose, moved inside the joint limits."""
        pose: Array = self.clamped(np.zeros(self.dof))
        return pose

    def rarity(self, q: Array) -> Array:
        """How unusual poses (..., dof) are: squares (...) of the standard deviations from the rest pose, summed."""
        squares: Array = (((q - self.rest()) / self.spreads) ** 2).sum(axis=-1)
        return squares

    def clamped(self, q: Array) -> Array:
        """Poses (..., dof) moved inside the joint limits."""
        inside: Array = np.clip(q, self.limits[:, 0], self.limits[:, 1])
        return inside

    def world_from_parameters(self, q: Array) -> Array:
        """Motion of what hangs on each parameter: q (*B, dof) -> (*B, dof + 1, 4, 4); the last is the world."""
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

    def with_shapes(self, shapes: tuple[TaperedSuperquadric, ...]) -> BodyModel:
        """The same skeleton with other part shapes, in the order of `parts`."""
        parts = tuple(replace(part, shape=shape) for part, shape in zip(self.parts, shapes, strict=True))
        return replace(self, parts=parts)
