"""One person of a scene, to be compared with what was observed: everything but the pose is fixed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Integers
from tracker.synthesis import Synthesis

_Found = TypeVar("_Found")


@dataclass(frozen=True)
class Comparison:
    """What a kind of evidence is asked about (paper, figure 1b).

    The other persons of the scene stay at their poses: earlier ones at their best, later ones as predicted.
    """

    scene: Scene
    person: int
    synthesis: Synthesis
    observed: Any
    """What the evidence that is asked has observed, as its `observe` returned it."""

    _last: dict[str, tuple[bytes, Any]] = field(default_factory=dict, repr=False, compare=False)

    def put(self, observed: Any) -> Comparison:
        """The same question put to a kind of evidence that has observed something else."""
        return Comparison(self.scene, self.person, self.synthesis, observed, self._last)

    def with_contours(self, q: Array, contours: Contours) -> Comparison:
        """The same question with other contours of a pose (dof,) than the synthesis makes."""
        return Comparison(
            self.scene, self.person, self.synthesis, self.observed, {**self._last, "fine": (q.tobytes(), contours)}
        )

    @property
    def body(self) -> BodyModel:
        """The model whose pose is sought."""
        return self.scene.persons[self.person].body

    @property
    def own(self) -> slice:
        """The person's parts among those of the scene."""
        first = self.scene.first_part(self.person)
        return slice(first, first + len(self.body.parts))

    @property
    def ends(self) -> Integers:
        """(P,) last pose parameter that moves each part of the scene; -2 for the parts of other persons.

        A sample of a smooth skin counts as its strongest part's. The derivative of the surface is the weighted sum over
        all parts that move it, but refinements by that were worse in most starts and twice as dear; see the results.
        """

        def find() -> Integers:
            found = np.full(len(self.scene.shapes), -2, dtype=np.int64)
            found[self.own] = self.body.part_parameters
            return found

        return self._once("ends", b"", find)

    def placements(self, poses: Array) -> Array:
        """(B, P, 4, 4) see `Scene.world_from_parts`, with the person at each of the poses (B, dof)."""
        return self.scene.world_from_parts(self.person, poses)

    def twists(self, q: Array) -> Array:
        """(dof, 6) spatial twists at a pose (dof,), kept until another one is asked for."""
        return self._once("twists", q.tobytes(), lambda: self.body.twists(q))

    def contours(self, poses: Array, coarse: bool = False) -> Contours:
        """Expected contours of the scene with the person at each of the poses (B, dof).

        Args:
            poses: rad and m.
            coarse: as dense as is enough to rank many poses; see `tracker.synthesis.Synthesis.contours`.
        """
        return self.synthesis.contours(self.scene, self.person, poses, coarse)

    def fine(self, q: Array) -> Contours:
        """The contours of one pose (dof,), kept until another one is asked for: several kinds of evidence need them."""
        return self._once("fine", q.tobytes(), lambda: self.contours(q[None]))

    def _once(self, what: str, key: bytes, find: Callable[[], _Found]) -> _Found:
        """What was found for the key asked about last; found now for another one."""
        kept = self._last.get(what)
        if kept is None or kept[0] != key:
            kept = self._last[what] = key, find()
        found: _Found = kept[1]
        return found
