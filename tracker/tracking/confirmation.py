"""Starts that are more likely wrong than right, and the frames without doubt that confirm them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.loss import doubted
from tracker.tracking.start import RATHER_RIGHT
from tracker.tracking.trajectory import Step

# See docs/lab/fit_in_doubt.md.
LEAST_SEEN = 4
"""Frames without doubt below which a person's body is not fitted: a wrong pose makes a body that fits it. If the body
differs from the model's, a fit in spite of that ends the doubts."""


def rather_wrong(steps: Iterable[Step]) -> dict[int, float]:
    """Places and confidences of persons whose start, the first one in some steps, is more likely wrong than right."""
    confidence = next((step.start_confidence for step in steps if step.start_confidence), ())
    return {k: right for k, right in enumerate(confidence) if right < RATHER_RIGHT}


def doubtful_in_all(steps: Sequence[Step], whom: Mapping[int, float]) -> list[Step]:
    """The steps, with some persons doubtful as wholes in all of them: nothing has confirmed their start.

    For a woman turned round, with a start of confidence 0.22, only legs were ambiguous in 57 of 100 frames.
    """
    told = list(steps)
    for n, step in enumerate(told):
        estimates = list(step.estimates)
        for k, right in whom.items():
            estimates[k] = estimates[k].doubting((Doubt("", Because.UNSURE_START, right, RATHER_RIGHT),))
        told[n] = replace(step, estimates=tuple(estimates))
    return told


def n_sure(steps: Iterable[Step], person: int) -> int:
    """Frames without doubt about a person."""
    return sum(not (step.estimates[person].lost or doubted(step.estimates[person])) for step in steps)
