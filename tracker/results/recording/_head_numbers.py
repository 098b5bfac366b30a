"""The numbers at the head of a report, each with what is good or bad about it."""

from __future__ import annotations

from typing import Any, NamedTuple

from tracker.results.recording import RunContext
from tracker.tracking.loss import LossRule

GOOD, LOOK, BAD = "good", "look", "bad"


class HeadNumber(NamedTuple):
    """A number, and how it is to be read."""

    value: str
    name: str
    told: str
    """What is good or bad about it."""

    verdict: str = ""
    """`good`, `look` or `bad`; empty of a number that is neither by itself."""


def head_numbers(summary: dict[str, Any], run: RunContext) -> list[HeadNumber]:
    """The numbers of a run's summary.

    Args:
        summary: see `Series.summary`; of at least one frame.
        run: what was tracked.
    """
    missing, counts = run.n_frames - summary["frames"], summary["by_status"]
    lost, doubtful, limbs = counts.get("lost", 0), counts.get("doubtful", 0), summary["frames_with_ambiguous_limbs"]
    whole = f"the run was stopped: {missing} frames are missing" if missing > 0 else "all of them are tracked"
    return [
        HeadNumber(str(summary["frames"]), f"frames of {run.n_frames}", whole, BAD if missing > 0 else GOOD),
        _counted(lost, "lost", "everybody is found in every frame", "values of these frames are empty", BAD),
        _counted(doubtful, "doubtful", "the images support every pose", "look at these before you use them", LOOK),
        _counted(
            limbs, "with a limb that may be elsewhere", "nothing speaks against a limb", "why is told below", LOOK
        ),
        *_fit(summary, run),
        _pace(summary, run),
    ]


def _counted(n: int, name: str, fine: str, otherwise: str, verdict: str) -> HeadNumber:
    return HeadNumber(str(n), name, otherwise if n else fine, verdict if n else GOOD)


def _fit(summary: dict[str, Any], run: RunContext) -> list[HeadNumber]:
    """How well the poses fit, judged by the limits that the run itself has used."""
    distance_px, explained = summary["mean_distance_px"], summary["mean_explained"]
    rule = run.details.get("config", {}).get("loss", {})
    lost_below, left_over = (rule.get(key, getattr(LossRule(), key)) for key in ("lost_below", "doubtful_above"))
    good = 1 - left_over
    limits = f"good from {good:.0%}; a frame is lost below {lost_below:.0%}"
    verdict = "" if explained is None else GOOD if explained >= good else LOOK if explained >= lost_below else BAD
    return [
        HeadNumber(
            "-" if distance_px is None else f"{distance_px:.2f} px",
            "mean distance",
            "less is better; compare it between runs of one recording alone",
        ),
        HeadNumber("-" if explained is None else f"{explained:.0%}", "of the contour explained", limits, verdict),
    ]


def _pace(summary: dict[str, Any], run: RunContext) -> HeadNumber:
    pace = summary["frames_per_second"]
    times = 1 / (run.interval_s * pace) if pace else 0.0
    told = f"{times:.1f} times as long as the recording" if times >= 1 else "faster than the recording"
    return HeadNumber(f"{pace:.1f}", "frames/s tracked", told if pace else "times were not kept")
