"""Starts half done: hypotheses of all persons, each refined as if alone, before the run's own estimation decides."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.tracking.hypotheses import finalists, hypothesis, ranked
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._clearing import cleared
from tracker.tracking.initialization._persons import Found
from tracker.tracking.start import AxisFit, Hypothesis, Start, sureness


@dataclass(frozen=True)
class Draft:
    """One way to find the persons, in one foreground."""

    frame: Frame
    scene: Scene
    """The persons in their best poses."""

    found: tuple[Found, ...]
    """The foreground of each person sought, in order."""

    evidence: tuple[tuple[AxisFit | None, ...], ...]
    """For each person and view; empty for those who are not sought."""

    hypotheses: tuple[tuple[Hypothesis, ...], ...]
    """For each person, the best first; empty for those who are not sought."""

    @property
    def sought(self) -> list[int]:
        """Numbers of the persons who are looked for."""
        return [k for k, ranking in enumerate(self.hypotheses) if ranking]

    @property
    def n_hypotheses(self) -> int:
        """Poses that are estimated when the draft is settled."""
        n = sum(map(len, self.hypotheses))
        return n if len(self.sought) == 1 else 2 * n

    def settled(self, stages: Stages, n: int) -> Start:
        """The best n hypotheses estimated and ranked again with everyone in the scene, who hide and are hidden."""
        scene, hypotheses = self.scene, list(self.hypotheses)
        # Of several who were found each is known by now to the others.
        known = stages.held if len(self.found) == 1 else range(len(scene.persons))
        objective = stages.objective(cleared(self.frame, scene, stages, list(self.found), known), scene, 0)
        # The first of several persons is judged again when the others are where they belong.
        for k in self.sought if len(self.sought) == 1 else self.sought * 2:
            objective = objective.about(scene, k)
            estimates = []
            for one in hypotheses[k]:
                stages.tally.begin()
                estimates.append(stages.estimation.estimate(objective, one.q[None]))
            every = ranked(objective.body, [hypothesis(objective.body, one) for one in estimates])
            hypotheses[k] = finalists(every, n)
            scene = scene.with_pose(k, hypotheses[k][0].q)
        poses = tuple(
            ranking[0].q if ranking else person.q for person, ranking in zip(scene.persons, hypotheses, strict=True)
        )
        sureness_of_all = tuple(sureness(ranking) if ranking else 1.0 for ranking in hypotheses)
        return Start(poses, self.evidence, tuple(hypotheses), sureness_of_all)


def likeliest_of(foregrounds: list[list[Draft]], n: int) -> list[list[Draft]]:
    """Drafts of one person in several foregrounds with the best n of all hypotheses; those left with none are gone.

    One more stays where all of them face one way. Several persons, or several bodies that may be the person, stay as
    they are.

    Args:
        foregrounds: for each foreground the ways to find the persons in it.
        n: how many hypotheses stay.
    """
    if any(len(ways) > 1 or len(ways[0].sought) > 1 for ways in foregrounds):
        return foregrounds
    drafts = [ways[0] for ways in foregrounds]
    if len(drafts) < 2:
        return foregrounds
    (k,) = drafts[0].sought
    every = ranked(drafts[0].scene.persons[k].body, [one for draft in drafts for one in draft.hypotheses[k]])
    kept = finalists(every, n)
    left = [draft.hypotheses[k] for draft in drafts]
    own = [tuple(one for one in ranking if any(one is other for other in kept)) for ranking in left]
    return [[_with_hypotheses(draft, k, mine)] for draft, mine in zip(drafts, own, strict=True) if mine]


def _with_hypotheses(draft: Draft, k: int, ranking: tuple[Hypothesis, ...]) -> Draft:
    """The draft with other hypotheses of person k, in the best of which they are."""
    every = tuple(ranking if other == k else own for other, own in enumerate(draft.hypotheses))
    return replace(draft, hypotheses=every, scene=draft.scene.with_pose(k, ranking[0].q))
