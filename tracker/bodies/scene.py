"""A scene: the persons at their present poses, and the rig that sees them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, frozen, shape_fault
from tracker.foundation.errors import ModelError


@dataclass(frozen=True)
class Person:
    """A body at a pose."""

    name: str
    body: BodyModel
    q: Array
    """(dof,) rad and m."""

    at: tuple[float, float] | None = None
    """Given place of the person at the start, x and y in metres; None for none."""

    def __post_init__(self) -> None:
        q = frozen(self.q)
        if fault := shape_fault(q, self.body.dof):
            raise ModelError(f'pose of "{self.name}": {fault}')
        object.__setattr__(self, "q", q)


@dataclass(frozen=True)
class Scene:
    """K persons and a rig; parts are numbered through all persons, in order."""

    persons: tuple[Person, ...]
    rig: Rig

    _last: dict[tuple[int | None, bytes], Array] = field(init=False, default_factory=dict, repr=False, compare=False)

    def with_pose(self, person: int, q: Array) -> Scene:
        """The scene with the pose of one person replaced."""
        persons = list(self.persons)
        persons[person] = replace(persons[person], q=q)
        return Scene(tuple(persons), self.rig)

    def with_poses(self, poses: tuple[Array, ...]) -> Scene:
        """The scene with the poses of all persons replaced."""
        pairs = zip(self.persons, poses, strict=True)
        return Scene(tuple(replace(person, q=q) for person, q in pairs), self.rig)

    def with_bodies(self, bodies: Mapping[int, BodyModel]) -> Scene:
        """The scene with other bodies of some persons, by their places in it, which are at rest then."""
        persons = list(self.persons)
        for k, body in bodies.items():
            persons[k] = replace(persons[k], body=body, q=body.rest())
        return Scene(tuple(persons), self.rig)

    @cached_property
    def shapes(self) -> Array:
        """(P, 7) packed superquadrics of all persons' parts."""
        return frozen(np.concatenate([person.body.shapes for person in self.persons]))

    @property
    def has_skins(self) -> bool:
        """Whether the own surface of any person is known."""
        return any(person.body.skin is not None for person in self.persons)

    def first_part(self, person: int) -> int:
        """Scene-wide number of the first part of a person."""
        return sum(len(other.body.parts) for other in self.persons[:person])

    def world_from_parts(self, person: int | None = None, poses: Array | None = None) -> Array:
        """Placements of all parts, with many poses of one person tried at once.

        They are kept until others are needed: each kind of evidence uses those of the same poses.

        Args:
            person: owner of the varying poses; None for the scene as it is.
            poses: (B, dof) of that person.

        Returns:
            (B, P, 4, 4) metres, not to be written to; B = 1 for the scene as it is.
        """
        key = person, b"" if poses is None else poses.tobytes()
        found = self._last.get(key)
        if found is None:
            found = self._placed(person, poses)
            self._last.clear()
            self._last[key] = found
        return found

    def _placed(self, person: int | None, poses: Array | None) -> Array:
        n_poses = 1 if poses is None else len(poses)
        if len(self.persons) == 1 and (poses is None or person == 0):
            only = self.persons[0]
            return np.ascontiguousarray(only.body.world_from_part(only.q[None] if poses is None else poses))
        placed = []
        for k, other in enumerate(self.persons):
            if k == person and poses is not None:
                placed.append(other.body.world_from_part(poses))
            else:
                motions = other.body.world_from_part(other.q[None])
                placed.append(np.broadcast_to(motions, (n_poses, *motions.shape[1:])))
        return np.ascontiguousarray(np.concatenate(placed, axis=1))
