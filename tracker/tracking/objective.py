"""The objective of a pose search: poses (B, dof) -> distances (B,), everything else fixed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.evidence import Evidence
from tracker.evidence.measures.account import LONG_FRAMES, Account, not_shown_by
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.measures.part_colours import PartColours
from tracker.foundation.arrays import Array
from tracker.synthesis import SurfaceSynthesis, Synthesis
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import History

_Found = TypeVar("_Found")

# Fitted to pairs of poses of which one is right, as scripts/fit_doubt.py does it. See docs/lab/one_comparison.md.
NATS_PER_PX, NATS_OF_COLOURS = 2.9, 110.0
"""What a px of distance tells, and a nat a pixel of impurity (`PartColours.impurities`), nats."""


@dataclass(frozen=True)
class Objective:
    """How badly a pose of one person explains the images: one number for all (paper, figure 1b).

    It keeps answers: rounds of a search that change little ask again about the same poses (29 % of 8100 in one frame).
    """

    asked: Comparison
    evidence: Evidence
    history: History | None = None
    """Knowledge of the person from the frames before."""

    collision_px: float = 0.1
    """Cost of a point of a limb deep inside another one, px; see `BodyModel.collisions`."""

    most_collision_px: float = 0.5
    """Largest cost of all such points, px. What the images say of a limb is 0.2 to 1 px: with 0.5 px a point and no end
    to it, the true pose of crossing limbs cost 1 to 5 px and lost to wrong ones (walking: 63 mm instead of 29)."""

    nearby: bool = False
    """Whether a pose is sought only near the starts: in the frames in which the search for a person who has left does
    not begin anew. A search of the whole pose in every frame took 1.2 s each in an empty room, and 0.03 s without."""

    colours: Callable[[Scene], PartColours] | None = None
    """Part colours of the frame, used if limbs are in two places; see `part_colours.colours_when_asked`."""

    rare_px: float = 0.02
    """Cost of a parameter one standard deviation from its usual value, px; twice as far costs four times as much."""

    _answers: dict[tuple[str, bytes, float], Any] = field(init=False, default_factory=dict, repr=False, compare=False)

    @property
    def body(self) -> BodyModel:
        """The model whose pose is sought."""
        return self.asked.body

    def __call__(self, poses: Array) -> Array:
        """Distances (B,) px of poses (B, dof); a body that runs through itself is farther off."""
        evidence, question = self.evidence, self.asked
        return self._each("distance", poses, lambda asked: evidence.distances(question, asked) + self.penalties(asked))

    def nats(self, poses: Array) -> Array:
        """Improbability (B,) of poses (B, dof) with limbs in different places, up to a constant, nats.

        The sum of their distance and the mixture of their parts' colours, each by what it tells. Contours of a limb
        that hangs down along trunk and thigh are theirs: with arms crossed before the chest, 0.4 m off in all 80 frames
        of a squat, 3 % of the contour was left over, and the true place cost as much, to 0.03 px.
        """
        found: Array = NATS_PER_PX * self(poses)
        if self.colours is None or not len(poses):
            return found
        scene, person = self.asked.scene, self.asked.person
        colours = self.colours(scene.with_pose(person, poses[0]))
        impurities = self._each("impurity", poses, lambda asked: colours.impurities(scene, person, asked))
        return found + NATS_OF_COLOURS * impurities

    def penalties(self, poses: Array) -> Array:
        """Penalty (B,) of poses (B, dof) for collisions and unusual angles, px."""
        own = self.asked.placements(poses)[:, self.asked.own]
        collisions = np.minimum(self.collision_px * self.body.collisions_of(own), self.most_collision_px)
        penalties: Array = collisions + self.rare_px * self.body.rarity(poses)
        return penalties

    def by_surface(self) -> Objective:
        """The same objective with persons' own surfaces, if known: to choose among a few poses."""
        if not self.asked.scene.has_skins or isinstance(self.asked.synthesis, SurfaceSynthesis):
            return self
        return self._served_by(SurfaceSynthesis(self.asked.synthesis))

    def by_parts(self) -> Objective:
        """The same objective with the parts in place of surfaces: to search among many poses."""
        synthesis = self.asked.synthesis
        return self._served_by(synthesis.of) if isinstance(synthesis, SurfaceSynthesis) else self

    def _served_by(self, synthesis: Synthesis) -> Objective:
        asked = Comparison(self.asked.scene, self.asked.person, synthesis, self.asked.observed)
        return replace(self, asked=asked)

    def about(self, scene: Scene, person: int) -> Objective:
        """The objective of another person, or with the others elsewhere, in the same frame."""
        asked = Comparison(scene, person, self.asked.synthesis, self.asked.observed)
        return replace(self, asked=asked, history=None)

    def observed_again(self, q: Array) -> Objective:
        """The objective after another observation with a known pose (dof,); see `Evidence.observe_again`."""
        observed = self.evidence.observe_again(self.asked, q)
        asked = Comparison(self.asked.scene, self.asked.person, self.asked.synthesis, observed)
        return replace(self, asked=asked)

    def equations(self, q: Array, gate_px: float) -> Equations:
        """Equations of a refinement, linearized at a pose (dof,); see `tracker.evidence.Evidence.equations`."""
        return self._once("equations", q, gate_px, lambda: self._equations(q, gate_px))

    def _equations(self, q: Array, gate_px: float) -> Equations:
        found = self.evidence.equations(self.uncovered(q), q, gate_px)
        # so many px more of root mean square are twice that times it in squares
        usual_px2 = 2 * self.rare_px * np.sqrt(found.squares * found.total)
        return found.pulled(usual_px2 / self.body.spreads**2, q - self.body.rest())

    def uncovered(self, q: Array) -> Comparison:
        """The question about a pose (dof,) without contours that something hid a frame before."""
        hidden, asked = None if self.history is None else self.history.hidden, self.asked
        if hidden is None:
            return asked
        of_scene = np.zeros((len(asked.scene.rig), len(asked.scene.shapes)), dtype=np.bool_)
        of_scene[:, asked.own] = hidden
        return asked.with_contours(q, asked.fine(q).without(of_scene))

    def estimate(self, q: Array, covariance: Array, evaluations: int) -> Estimate:
        """The estimate of a pose (dof,) with covariance (dof, dof); its distance is that of a call."""
        found = Estimate(
            q=np.array(q),
            covariance=covariance,
            account=self._once("account", q, 0.0, lambda: self._account(q)),
            penalty_px=float(self.penalties(q[None])[0]),
            evaluations=evaluations,
        )
        # sums of many poses at once end in other last digits: the number told is the one that a call gives from now on
        self._answers["distance", found.q.tobytes(), 0.0] = found.distance_px
        return found

    def _account(self, q: Array) -> Account:
        """Account of a pose (dof,) by the views, except limbs that something has long hidden from them."""
        account, asked = self.evidence.account(self.asked, q), self.asked
        hidden, unseen = (None, None) if self.history is None else (self.history.hidden, self.history.unseen)
        places = asked.placements(q[None])[0, asked.own, :3, 3]
        not_shown = not_shown_by(asked.body, asked.scene.rig, places, account, hidden)
        if not_shown is None:
            return account
        account = replace(account, not_shown=not_shown)
        return account if unseen is None else account.without(not_shown & (unseen >= LONG_FRAMES))

    def kept(self, what: str, find: Callable[[], _Found]) -> _Found:
        """What was found of the question, of whichever pose, before; else it is found now."""
        return self._once(what, np.empty(0), 0.0, find)

    def _each(self, what: str, poses: Array, find: Callable[[Array], Array]) -> Array:
        """Kept values of some poses (B, dof); missing ones are computed at once."""
        keys = [(what, pose.tobytes(), 0.0) for pose in poses]
        fresh = [b for b, key in enumerate(keys) if key not in self._answers]
        if fresh:
            found = find(poses if len(fresh) == len(poses) else poses[fresh])
            self._answers.update(zip([keys[b] for b in fresh], found.tolist(), strict=True))
        return np.array([self._answers[key] for key in keys])

    def _once(self, what: str, q: Array, gate_px: float, find: Callable[[], _Found]) -> _Found:
        """Kept value of a pose (dof,); computed if missing."""
        key = what, q.tobytes(), gate_px
        if key not in self._answers:
            self._answers[key] = find()
        found: _Found = self._answers[key]
        return found
