"""How probable it is that a limb is right: fitted to runs of recordings that have a truth, each told by the others."""

from __future__ import annotations

import csv
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

EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.99, 1.0)
"""Of the probabilities that are told together."""

# Where the fit begins, and how far its three slopes are held near: log odds, logarithms of slopes.
_BEGIN = np.array([4.0, 4.5, 1.0, 5.0, 2.5])
_HELD = np.array([0.0, 1.0, 1.0, 0.0, 1.0])


@dataclass(frozen=True)
class Limbs:
    """Limbs of all frames of some runs (N,)."""

    recording: Array
    known: Array
    """(N, 3) left over of the limb; of the whole, squared; logarithm of the spread of its joints over 3 cm."""

    right: Mask
    flagged: Mask


def limbs_of(folders: Sequence[Path], recordings: Mapping[str, Recorded]) -> Limbs:
    """All limbs of runs below some folders that a table of what was known of limbs is kept of."""
    rows: list[tuple[str, float, float, float, bool, bool]] = []
    for path in sorted(path for folder in folders for path in folder.rglob(FILE)):
        name = next((name for name in recordings if path.parents[1].name.startswith(f"{name}_")), "")
        if name:
            rows += _rows(path, name, recordings[name])
    if not rows:
        raise SequenceError(f"no {FILE} of a recording with a truth below {', '.join(map(str, folders))}")
    names, left, whole, spread_m, right, flagged = zip(*rows, strict=True)
    vague = np.log(np.maximum(spread_m, 0.003) / 0.03)
    known = np.column_stack([left, np.square(whole), vague])
    return Limbs(np.array(names), known, np.array(right), np.array(flagged))


def _rows(path: Path, name: str, recording: Recorded) -> list[tuple[str, float, float, float, bool, bool]]:
    found = evaluate(path.parent, recording.truth)
    curves = {one.person: curve for one, curve in zip(found.persons, found.distances_mm, strict=True)}
    places = {who: {int(frame): n for n, frame in enumerate(curve["frame"])} for who, curve in curves.items()}
    rows = []
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            n = places.get(row["person"], {}).get(int(row["frame"]))
            if n is None:  # lost, or unknown to the truth
                continue
            curve = curves[row["person"]]
            gaps_mm = np.array([curve[joint][n] for joint in row["joints"].split() if joint in curve])
            if not np.isfinite(gaps_mm).any():
                continue
            left, whole, spread_m = (float(row[key]) for key in ("left_over", "whole", "spread_m"))
            rows.append(
                (
                    name,
                    left,
                    whole,
                    spread_m,
                    bool(np.nanmax(gaps_mm) <= LIMB_MM),
                    bool(row["doubts"] or row["whole_doubts"]),
                )
            )
    return rows


def fitted(known: Array, right: Mask) -> Array:
    """(5,) odds and slopes: of the whole 1, left over, spread; of the limb 1, left over. Slopes are logarithms."""

    def cost(numbers: Array) -> float:
        told = np.clip(told_by(numbers, known), 1e-9, 1 - 1e-9)
        surprise = -np.log(np.where(right, told, 1 - told)).sum()
        return float(surprise + 0.5 * (_HELD * (numbers - _BEGIN) ** 2).sum())

    numbers: Array = minimize(cost, _BEGIN, method="BFGS").x
    return numbers


def told_by(numbers: Array, known: Array) -> Array:
    """(N,) probabilities; see `tracker.tracking.loss.probabilities`."""
    left, whole, vague = known.T
    slopes = np.exp(numbers[[1, 2, 4]])
    of_whole = numbers[0] - slopes[0] * whole - slopes[1] * vague
    told: Array = _sigmoid(of_whole) * _sigmoid(numbers[3] - slopes[2] * left)
    return told


def _sigmoid(log_odds: Array) -> Array:
    found: Array = 0.5 * (1 + np.tanh(0.5 * log_odds))
    return found


def left_out(limbs: Limbs) -> tuple[Array, Array]:
    """(N,) told of each recording by a fit to all others, and by flags alone, as often as they are right there."""
    told, by_flags = np.empty(len(limbs.right)), np.empty(len(limbs.right))
    for name in np.unique(limbs.recording):
        own = limbs.recording == name
        told[own] = told_by(fitted(limbs.known[~own], limbs.right[~own]), limbs.known[own])
        for flag in (False, True):
            others = ~own & (limbs.flagged == flag)
            by_flags[own & (limbs.flagged == flag)] = (limbs.right[others].sum() + 1) / (others.sum() + 2)
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
