"""What a px of distance and the mixture of colours tell: fitted to pairs of poses of which one is right."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from benchmarks.pair_table import FILE
from benchmarks.recorded import Recorded
from benchmarks.trial import LIMB_MM
from tracker.foundation.arrays import Array, Mask
from tracker.results.evaluation.joints import Frames, JointNames, names_of, read_joints

# So near to nothing is each weight held, in units of the spread of what it weighs.
_HELD = 0.01


@dataclass(frozen=True)
class Pairs:
    """N pairs of poses that runs compared, all joints of one within 150 mm of the truth, and not all of the other."""

    recording: Array
    told: Array
    """(N, 2) by how much the first pose is farther off, px, and its colours more mixed, nats a pixel."""

    second: Mask
    """(N,) whether the second pose is the right one."""


def pairs_of(folders: Sequence[Path], recordings: Mapping[str, Recorded]) -> Pairs:
    """All such pairs of runs below some folders, each once a run."""
    found: dict[tuple[str, ...], tuple[str, list[float], bool]] = {}
    for path in sorted(path for folder in folders for path in folder.rglob(FILE)):
        name = next((name for name in recordings if path.parent.name.startswith(f"{name}_")), "")
        if not name or not (path.parent / "result" / "run.json").is_file():
            continue
        truth, names = read_joints(recordings[name].truth).persons, names_of(path.parent / "result")
        for line in path.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            who = recordings[name].truth_names.get(row["person"], row["person"])
            frames = truth.get(who) or next(iter(truth.values()))
            right = [_is_right(joints, frames, row["frame"], names[row["person"]]) for joints in row["joints"]]
            if None not in right and right[0] != right[1]:
                key = str(path), *(f"{value:.6f}" for value in row["told"])
                found[key] = name, row["told"], bool(right[1])
    recording, told, second = map(np.array, zip(*found.values(), strict=True)) if found else (np.empty(0),) * 3
    return Pairs(recording, told.reshape(-1, 2), second.astype(np.bool_))


def _is_right(joints: Mapping[str, list[float]], frames: Frames, frame: int, names: JointNames) -> bool | None:
    """Whether all joints are within 150 mm of the truth; None where that is unknown."""
    if frame not in frames:
        return None
    mine, theirs = names.of({name: np.array(point) for name, point in joints.items()}), names.of(frames[frame])
    gaps_m = [
        np.linalg.norm(mine[name] - theirs[name]) for name in names.joints.evaluated if name in mine.keys() & theirs
    ]
    return bool(1000 * np.nanmax(gaps_m) <= LIMB_MM) if gaps_m else None


def weights(told: Array, second: Mask) -> Array:
    """(2,) nats a px, and nats a nat a pixel, by which it is least surprising which poses are right."""
    spread = told.std(axis=0)

    def cost(found: Array) -> float:
        nats = np.where(second, 1.0, -1.0) * (told / spread @ found)
        return float(np.logaddexp(0.0, -nats).sum() + 0.5 * _HELD * (found**2).sum())

    fitted: Array = minimize(cost, np.zeros(2)).x / spread
    return fitted


def nats_left_out(pairs: Pairs) -> Array:
    """(N,) by how much the second pose of each pair is likelier, by a fit to all other recordings."""
    nats = np.empty(len(pairs.second))
    for name in np.unique(pairs.recording):
        own = pairs.recording == name
        nats[own] = pairs.told[own] @ weights(pairs.told[~own], pairs.second[~own])
    return nats
