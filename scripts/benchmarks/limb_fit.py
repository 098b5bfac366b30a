"""How probable it is that a limb is right: fitted to runs of recordings that have a truth, each told by the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize

from benchmarks.limb_table import FILE
from benchmarks.recorded import Recorded
from benchmarks.trial import LIMB_MM
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import SequenceError
from tracker.results.evaluation.comparison import evaluate
from tracker.results.evaluation.joints import read_rows
from tracker.tracking.limb_probabilities import Known, Odds, right_by

EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.99, 1.0)
"""Of the probabilities that are told together."""

# Where the fit begins, and how far each number is held near that: log odds as they are, what takes from them as
# logarithms, so that it stays positive.
_BEGIN = np.array([4.0, 4.5, 1.0, 0.0, 5.0, 2.5, 1.5])
_HELD = np.array([0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0])
_SLOPES = np.array([False, True, True, True, False, True, True])

_KNOWN = "left_over", "whole", "spread_m", "stops", "jumped"
"""Columns of the table, in the order of `Known`."""

Row = tuple[str, float, float, float, float, float, bool, bool]
"""Recording, what is known of the limb, whether it is right, and whether the run flags it."""


@dataclass(frozen=True)
class Limbs:
    """Limbs of all frames of some runs (N,)."""

    recording: Array
    known: Known
    right: Mask
    flagged: Mask


def limbs_of(folders: Sequence[Path], recordings: Mapping[str, Recorded]) -> Limbs:
    """All limbs of runs below some folders that a table of what was known of limbs is kept of.

    Raises:
        SequenceError: there is none.
    """
    rows: list[Row] = []
    for path in sorted(path for folder in folders for path in folder.rglob(FILE)):
        name = next((name for name in recordings if path.parents[1].name.startswith(f"{name}_")), "")
        if name:
            rows += _rows(path, name, recordings[name])
    if not rows:
        raise SequenceError(f"no {FILE} of a recording with a truth below {', '.join(map(str, folders))}")
    names, left_over, whole, spread_m, stops, jumped, right, flagged = map(np.array, zip(*rows, strict=True))
    return Limbs(names, Known(left_over, whole, spread_m, stops, jumped), right, flagged)


def _rows(path: Path, name: str, recording: Recorded) -> list[Row]:
    found = evaluate(path.parent, recording.truth)
    curves = {one.person: curve for one, curve in zip(found.persons, found.distances_mm, strict=True)}
    places = {who: {int(frame): n for n, frame in enumerate(curve["frame"])} for who, curve in curves.items()}
    rows: list[Row] = []
    for row in read_rows(path):
        n = places.get(row["person"], {}).get(int(row["frame"]))
        if n is None:  # lost, or unknown to the truth
            continue
        curve = curves[row["person"]]
        gaps_mm = np.array([curve[joint][n] for joint in row["joints"].split() if joint in curve])
        if np.isfinite(gaps_mm).any():
            left_over, whole, spread_m, stops, jumped = (float(row[key]) for key in _KNOWN)
            right = bool(np.nanmax(gaps_mm) <= LIMB_MM)
            rows.append((name, left_over, whole, spread_m, stops, jumped, right, row["flagged"] == "1"))
    return rows


def fitted(known: Known, right: Mask) -> Odds:
    """The odds by which it is least surprising which limbs (N,) are right."""

    def odds(numbers: Array) -> Odds:
        return Odds(*np.where(_SLOPES, np.exp(numbers), numbers).tolist())

    def cost(numbers: Array) -> float:
        told = np.clip(right_by(odds(numbers), known), 1e-9, 1 - 1e-9)
        surprise = -np.log(np.where(right, told, 1 - told)).sum()
        return float(surprise + 0.5 * (_HELD * (numbers - _BEGIN) ** 2).sum())

    return odds(minimize(cost, _BEGIN, method="BFGS").x)


def left_out(limbs: Limbs) -> tuple[Array, Array]:
    """(N,) told of each recording by a fit to all others, and by flags alone, as often as they are right there."""
    told, by_flags = np.empty(len(limbs.right)), np.empty(len(limbs.right))
    for name in np.unique(limbs.recording):
        own = limbs.recording == name
        others = Known(*(values[~own] for values in limbs.known))
        told[own] = right_by(fitted(others, limbs.right[~own]), Known(*(values[own] for values in limbs.known)))
        for flag in (False, True):
            alike = ~own & (limbs.flagged == flag)
            by_flags[own & (limbs.flagged == flag)] = (limbs.right[alike].sum() + 1) / (alike.sum() + 2)
    return told, by_flags


def reliability(told: Array, right: Mask) -> list[tuple[float, float, int, float, float]]:
    """From, to, limbs, mean of what was told, share that was right; for each range that has limbs."""
    found = []
    for low, high in pairwise(EDGES):
        own = (told >= low) & ((told < high) | (high == EDGES[-1]))
        if own.any():
            found.append((low, high, int(own.sum()), float(told[own].mean()), float(right[own].mean())))
    return found


def picture(rows: Sequence[tuple[float, float, int, float, float]]) -> Figure:
    """The reliability diagram."""
    figure = Figure(figsize=(4.2, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    axes.plot([row[3] for row in rows], [row[4] for row in rows], "o-", color="tab:blue")
    axes.set(xlabel="told probability", ylabel="share of limbs within 150 mm", xlim=(0, 1.02), ylim=(0, 1.02))
    return figure
