"""One person of a scene, to be compared with what was observed: everything but the pose is fixed."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from tracker.arrays import Array, Integers
from tracker.body import BodyModel
from tracker.contours import Contours
from tracker.scene import Scene
from tracker.synthesis import Synthesis


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

    _last: dict[bytes, Contours] = field(default_factory=dict, repr=False, compare=False)

    @property
    def body(self) -> BodyModel:
        """The model whose pose is sought."""
        return self.scene.persons[self.person].body

    @property
    def own(self) -> slice:
        """The person's parts among those of the scene."""
        first = self.scene.first_part(self.person)
        return slice(first, first + len(self.body.parts))

    @cached_property
    def ends(self) -> Integers:
        """(P,) last pose parameter that moves each part of the scene; -2 for the parts of other persons.

        A sample of a smooth skin counts as its strongest part's. The derivative of the surface is the weighted sum over
        all parts that move it, but refinements by that were worse in most starts and twice as dear; see the results.
        """
        found = np.full(len(self.scene.shapes), -2, dtype=np.int64)
        found[self.own] = self.body.part_parameters
        return found

    def contours(self, poses: Array, coarse: bool = False) -> Contours:
        """Expected contours of the scene with the person at each of the poses (B, dof).

        Args:
            poses: rad and m.
            coarse: as dense as is enough to rank many poses; see `tracker.synthesis.Synthesis.contours`.
        """
        return self.synthesis.contours(self.scene, self.person, poses, coarse)

    def fine(self, q: Array) -> Contours:
        """The contours of one pose (dof,), kept until another one is asked for: several kinds of evidence need them."""
        key = q.tobytes()
        found = self._last.get(key)
        if found is None:
            found = self.contours(q[None])
            self._last.clear()
            self._last[key] = found
        return found
