"""How often starts are right that are as sure as a run says: what the confidence of a start pose is worth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.scores import Score, newest
from benchmarks.trial import LIMB_MM, TRACKED_MM

_UNSURE, _SURE = 0.5, 0.9
"""Confidence below which half of the starts at least should be wrong, and above which one in fifty at most."""


def print_starts(console: Console, scores: Sequence[Score]) -> None:
    """Prints the starts of each range of confidence, and how many of them are wrong; nothing where none is known.

    What is compared with the truth is the frame of a person's first start pose, as the run has it in the end. Left out
    are starts without a confidence and frames in which the person is lost.
    """
    known = [one for one in newest(scores) if np.isfinite([one.confidence, one.start_farthest_mm]).all()]
    if not known:
        return
    table = Table(title="how often starts are right", title_justify="left")
    table.add_column("confidence")
    for name in ("starts", f"mean > {TRACKED_MM:.0f} mm", f"a joint > {LIMB_MM:.0f} mm", "% wrong", "aim"):
        table.add_column(name, justify="right")
    for label, aim, rows in _ranges(known):
        mean_off = sum(one.start_mm > TRACKED_MM for one in rows)
        joint_off = sum(one.start_farthest_mm > LIMB_MM for one in rows)
        wrong = sum(one.start_mm > TRACKED_MM or one.start_farthest_mm > LIMB_MM for one in rows)
        share = f"{100 * wrong / len(rows):.0f}" if rows else "-"
        table.add_row(label, str(len(rows)), str(mean_off), str(joint_off), share, aim)
    console.print(table)


def _ranges(scores: Sequence[Score]) -> list[tuple[str, str, list[Score]]]:
    """Name of a range of confidence, the share of wrong starts that is aimed at, and the rows in it."""
    return [
        (f"< {_UNSURE}", ">= 50", [one for one in scores if one.confidence < _UNSURE]),
        (f"{_UNSURE} to {_SURE}", "", [one for one in scores if _UNSURE <= one.confidence <= _SURE]),
        (f"> {_SURE}", "<= 2", [one for one in scores if one.confidence > _SURE]),
    ]
