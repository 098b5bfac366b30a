"""Articulated bodies: a kinematic tree with shapes, groups to search, and all other facts about a body."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tracker.bodies.body.kinematic_tree import KinematicTree
from tracker.bodies.body.sections import Clothes, Joints, Movement, RigidEnd, StartMarks
from tracker.bodies.segments import Landmark, Mirror, Segment, TaperedSuperquadric, unjoined
from tracker.bodies.skin import Skin
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.errors import ModelError, nearest
from tracker.kernels.body import sum_collisions


@dataclass(frozen=True)
class BodyModel(KinematicTree):
    """An articulated body: its kinematic tree, in groups of parameters to search, and the shapes of its parts."""

    groups: dict[str, tuple[str, ...]]
    """Search groups: name -> parameter names (paper, section 4.1: torso_head, arms, legs)."""

    rigid_ends: dict[str, RigidEnd] = field(default_factory=dict)
    """Ends without a parameter of their own: the head of a trunk of one piece. No group has such a name."""

    links: tuple[tuple[str, str], ...] = ()
    """Pairs of landmarks joined by a bone: the stick figure."""

    stature_m: float = 0.0
    """Height of the body standing in its reference pose, metres."""

    segments: tuple[Segment, ...] = ()
    """The tree of rigid segments, parents first."""

    mirror: Mirror = field(default_factory=Mirror)
    """Its symmetry."""

    start: StartMarks = field(default_factory=StartMarks)
    """Facts for a search without a prediction."""

    joints: Joints = field(default_factory=Joints)
    """Landmarks for judging results."""

    clothes: Clothes = field(default_factory=Clothes)
    """Clothes in a simulation."""

    movements: dict[str, Movement] = field(default_factory=dict)
    """Movements to simulate."""

    keypoints: tuple[Landmark, ...] = ()
    """Points of 2-D detectors beside landmarks, by the detectors' names."""

    skin: Skin | None = None
    """Its own surface, for contours and silhouettes; searches use the parts."""

    @cached_property
    def shapes(self) -> Array:
        """(P, 7) packed superquadrics."""
        return frozen([part.shape.packed for part in self.parts])

    @cached_property
    def reported(self) -> tuple[int, ...]:
        """Numbers of the landmarks that tables of joints hold."""
        names = self.joints.reported or self.landmark_names
        return tuple(self.landmark_names.index(name) for name in names)

    def columns(self, name: str) -> list[int]:
        """Columns of the parameters of a name, alone or on either side: `arm_abduction` is that of both arms.

        Raises:
            ModelError: the parameter does not exist.
        """
        return [self.names.index(own) for own in self.mirror.meant(name, self.names)] or [self.index(name)]

    def group(self, name: str) -> Integers:
        """Columns of the parameters in a search group.

        Raises:
            ModelError: the group does not exist.
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
        """Groups that are in no other group, in order: the decomposition of the whole search."""
        sets = {name: set(members) for name, members in self.groups.items()}
        return tuple(name for name in sets if not any(sets[name] < other for other in sets.values()))

    @cached_property
    def fine_groups(self) -> tuple[str, ...]:
        """Groups without a group inside, in order: the pieces that a search can repair separately."""
        sets = {name: set(members) for name, members in self.groups.items()}
        return tuple(name for name in sets if not any(other < sets[name] for other in sets.values()))

    @cached_property
    def limbs(self) -> tuple[str, ...]:
        """Fine groups that may be elsewhere separately: arms and legs, not trunk and head, which carry them.

        They have a partner on the other side; in a body without sides they are the ends of its tree, fingers of a hand.
        """
        return tuple(group for group in self.fine_groups if self.partner_of(group)) or self.ends

    @cached_property
    def ends(self) -> tuple[str, ...]:
        """Fine groups that hang on another one, and carry none: most limbs, a head, a tail."""
        return tuple(group for group in self.fine_groups if self._is_an_end(group))

    @cached_property
    def doubted_ends(self) -> tuple[str, ...]:
        """Limbs, head and tail, rigid ends: they may be ambiguous separately."""
        return tuple(dict.fromkeys((*self.limbs, *self.ends, *self.rigid_ends)))

    @cached_property
    def marked_limbs(self) -> tuple[str, ...]:
        """Limbs with landmarks: a model file may give some of the others none."""
        return tuple(group for group in self.limbs if self.landmarks_of(group).any())

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

    def _is_an_end(self, group: str) -> bool:
        """Whether a group hangs on another one, and none on it."""
        moved = {
            name: self.moves[np.ix_(self.group(name), self.part_parameters)].any(axis=0) for name in self.fine_groups
        }
        mine, others = moved.pop(group), moved.values()
        hangs = any((mine <= theirs).all() and theirs.sum() > mine.sum() for theirs in others)
        return bool(mine.any()) and hangs and not any((theirs <= mine).all() and theirs.any() for theirs in others)

    @cached_property
    def segments_of_parts(self) -> Integers:
        """(P,) segment that each part is of."""
        numbers = {segment.name: k for k, segment in enumerate(self.segments)}
        found: Integers = frozen([numbers[part.segment] for part in self.parts], dtype=np.int64)
        return found

    def parts_of(self, group: str) -> Mask:
        """(P,) parts that a fine group moves and no finer chain on it does: an arm's, not the body's.

        A rigid end has its own.

        Raises:
            ModelError: no group or rigid end has the name.
        """
        if group not in self._parts_of_groups:
            raise ModelError(f'model "{self.name}" has no group "{group}"; {nearest(group, self._parts_of_groups)}')
        return self._parts_of_groups[group]

    @cached_property
    def _parts_of_groups(self) -> dict[str, Mask]:
        found = {group: frozen(self._hanging_on(group, self.part_parameters), np.bool_) for group in self.groups}
        names = [part.name for part in self.parts]
        return found | {end: frozen(np.isin(names, one.parts), np.bool_) for end, one in self.rigid_ends.items()}

    def landmarks_of(self, group: str) -> Mask:
        """(L,) landmarks that a fine group moves and no finer chain on it does: an arm's, not the body's.

        A rigid end has its own.

        Raises:
            ModelError: no group or rigid end has the name.
        """
        found = self._landmarks_of_groups
        if group not in found:
            raise ModelError(f'model "{self.name}" has no group "{group}"; {nearest(group, found)}')
        return found[group]

    @cached_property
    def _landmarks_of_groups(self) -> dict[str, Mask]:
        parameters = np.array([mark.parameter for mark in self.landmarks], dtype=np.int64)
        found = {group: frozen(self._hanging_on(group, parameters), np.bool_) for group in self.groups}
        ends = self.rigid_ends.items()
        return found | {end: frozen(np.isin(self.landmark_names, one.landmarks), np.bool_) for end, one in ends}

    def _hanging_on(self, group: str, ends: Integers) -> Mask:
        """The ends of chains that a fine group moves, and no finer chain on it does."""
        moved, parts = self.moves[:, ends], self.moves[:, self.part_parameters]
        mine = self.group(group)
        own: Mask = np.asarray(moved[mine].any(axis=0))
        for other in self.fine_groups:
            theirs = self.group(other)
            if other != group and parts[mine].any(axis=0).sum() > parts[theirs].any(axis=0).sum():
                own = own & ~moved[theirs].any(axis=0)
        return own

    @cached_property
    def apart(self) -> Integers:
        """(N, 2) parts that must not run through each other.

        Without parts of one segment, of neighbouring segments, and parts that overlap in the reference pose.
        """
        chains = [frozenset(np.flatnonzero(self.moves[:, end]).tolist()) for end in self.part_parameters]
        pairs = np.array(unjoined(chains), dtype=np.int64).reshape(-1, 2)
        rest = self.world_from_part(self.rest()[None])
        clear = [self._collisions(rest, frozen(pair[None], np.int64))[0] == 0 for pair in pairs]
        kept: Integers = frozen(pairs[np.array(clear, dtype=np.bool_)], dtype=np.int64)
        return kept

    def collisions(self, q: Array) -> Array:
        """How deep the body runs through itself at poses (B, dof): points (B,) by their depth, see `sum_collisions`."""
        return self.collisions_of(self.world_from_part(q))

    def collisions_of(self, placements: Array) -> Array:
        """The same for known part placements (B, P, 4, 4)."""
        return self._collisions(placements, self.apart)

    def _collisions(self, placements: Array, pairs: Integers) -> Array:
        """`sum_collisions`, compiled ahead for contiguous placements and read-only pairs."""
        points: Array = sum_collisions(np.ascontiguousarray(placements), self.shapes, pairs)
        return points

    def with_shapes(self, shapes: tuple[TaperedSuperquadric, ...]) -> BodyModel:
        """The same skeleton with other part shapes, in the order of `parts`."""
        parts = tuple(replace(part, shape=shape) for part, shape in zip(self.parts, shapes, strict=True))
        return replace(self, parts=parts)
