"""Incomplete starts: hypotheses of all persons, each refined as if alone, before the run's own estimation decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Image, Mask
from tracker.images.plate import in_light_of
from tracker.tracking.hypotheses import finalists, hypothesis, ranked
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._persons import Found
from tracker.tracking.initialization._visual_hull import STEP_M, shadow
from tracker.tracking.start import AxisFit, Hypothesis, Start

# Pixels farther than this from every voxel of a person belong to none; of a known person only the joints are at hand,
# so that hands and feet must lie within it.
_AROUND_M = 0.15


def cleared(frame: Frame, scene: Scene, stages: Stages, found: list[Found], known: Sequence[int]) -> Frame:
    """The frame with the plates in place of all pixels far from the persons found and the known ones.

    Moved furniture, passers-by and persons not yet found disappear, and so do other candidates for the person.

    Args:
        frame: the images.
        scene: the rig, and the poses of the known persons.
        stages: with the plates.
        found: the persons found.
        known: numbers of the known persons in the scene.
    """
    persons = (scene.persons[k] for k in known)
    held = [person.body.landmarks_in_world(person.q) for person in persons]
    points = [*(person.points for person in found), *held]
    images: list[Image | None] = []
    masks: list[Mask | None] = []
    for v, (image, plate) in enumerate(zip(frame.images, stages.plates, strict=True)):
        given = frame.mask(v)
        if image is None or (plate is None and given is None):
            images.append(None)
            masks.append(None)
            continue
        near = np.any([shadow(scene.rig, v, places, _AROUND_M) for places in points], axis=0)
        for one in (one for one in found if len(one.others)):
            near &= shadow(scene.rig, v, one.points, STEP_M) | ~shadow(scene.rig, v, one.others, STEP_M)
        images.append(image if plate is None else np.where(near[..., None], image, in_light_of(image, plate)))
        masks.append(None if given is None else given & near)
    return replace(frame, images=tuple(images), masks=tuple(masks))


@dataclass(frozen=True)
class Draft:
    """One way to find the persons, in one foreground."""

    frame: Frame
    scene: Scene
    """The persons in their best poses."""

    found: tuple[Found, ...]
    """The foreground of each person sought, in order."""

    evidence: tuple[tuple[AxisFit | None, ...], ...]
    """For each person and view; empty for persons who are not sought."""

    hypotheses: tuple[tuple[Hypothesis, ...], ...]
    """For each person, the best first; empty for persons who are not sought."""

    @property
    def sought(self) -> list[int]:
        """Numbers of the persons sought."""
        return [k for k, ranking in enumerate(self.hypotheses) if ranking]

    @property
    def n_hypotheses(self) -> int:
        """Number of poses estimated when the draft is settled."""
        n = sum(map(len, self.hypotheses))
        return n if len(self.sought) == 1 else 2 * n

    def settled(self, stages: Stages, n: int) -> Start:
        """The best n hypotheses estimated and ranked again with all persons in the scene, who hide one another."""
        scene, hypotheses = self.scene, list(self.hypotheses)
        # Each of several persons found is known to the others now.
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
        return Start(poses, self.evidence, tuple(hypotheses))


def likeliest_of(foregrounds: list[list[Draft]], n: int) -> list[list[Draft]]:
    """Drafts of one person in several foregrounds with the best n of all hypotheses; those without any are removed.

    One more stays if all of them face one way. Several persons, or several bodies that may be the person, stay as they
    are.

    Args:
        foregrounds: for each foreground the ways to find the persons in it.
        n: number of hypotheses that stay.
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
    """The draft with other hypotheses of person k, and the best of them as poses."""
    every = tuple(ranking if other == k else own for other, own in enumerate(draft.hypotheses))
    return replace(draft, hypotheses=every, scene=draft.scene.with_pose(k, ranking[0].q))
