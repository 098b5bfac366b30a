"""Estimates that are in doubt, for whatever reason."""

from __future__ import annotations

from dataclasses import replace

from tracker.doubt import Because, Doubt
from tracker.estimate import Estimate


def in_doubt(estimate: Estimate, *limbs: str, whole: bool = False, vague: bool = False) -> Estimate:
    """The estimate with these limbs in doubt, perhaps the person as a whole, and nothing else; vague limbs or not."""
    because = Because.TWO_POSES if vague else Because.LEFT_OVER
    everything = [Doubt("", Because.LEFT_OVER, 0.4, 0.25)] if whole else []
    return replace(estimate, doubts=(*everything, *(Doubt(limb, because, 0.1, 0.2) for limb in limbs)))
