"""Estimates that are in doubt, for whatever reason, and frames of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from observations import objective_of

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.images.sight import Observation
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.doubts import Doubts
from tracker.tracking.estimate import Estimate
from tracker.tracking.loss import LossRule, judged
from tracker.tracking.trajectory import Step

IMAGES = (np.zeros((2, 2, 3), np.uint8),) * 4


def steps_of(truth: Scene, observation: Observation, rows: Sequence[Sequence[Estimate]]) -> list[Step]:
    """Frames with these estimates, of as many persons as there are in a row."""
    first, fitted = truth.persons[0], objective_of(truth, observation).asked.fine(truth.persons[0].q)
    persons = first, replace(first, name="other")
    return [
        Step(Frame(k, 0.04 * k, IMAGES), replace(truth, persons=persons[: len(row)]), tuple(row), fitted)
        for k, row in enumerate(rows)
    ]


def after_all(steps: Sequence[Step]) -> Doubts:
    return reduce(Doubts.after, steps, Doubts())


def estimate_of(truth: Scene, observation: Observation, **off_deg: float) -> Estimate:
    """A pose off the truth in some angles, judged as a run does."""
    body, q = truth.persons[0].body, truth.persons[0].q.copy()
    for name, angle_deg in off_deg.items():
        q[body.index(name)] += np.radians(angle_deg)
    found = objective_of(truth, observation).estimate(q, np.zeros((body.dof, body.dof)), 1)
    return judged(body, found, LossRule())


def in_doubt(estimate: Estimate, *limbs: str, whole: bool = False, vague: bool = False) -> Estimate:
    """The estimate with these limbs in doubt, perhaps the person as a whole, and nothing else; vague limbs or not."""
    because = Because.IMPROBABLE if vague else Because.LEFT_OVER
    everything = [Doubt("", Because.LEFT_OVER, 0.4, 0.25)] if whole else []
    return replace(estimate, doubts=(*everything, *(Doubt(limb, because, 0.1, 0.2) for limb in limbs)))
