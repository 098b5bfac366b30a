"""Comparison of a run with a truth: joint distances, angles, lost frames, silhouettes."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import linear_sum_assignment

from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError
from tracker.foundation.source_files import frame_in, json_of, one_line
from tracker.results.evaluation.joints import Frames, JointNames, JointTable, names_of, read_joints, read_rows
from tracker.results.evaluation.person_errors import PersonErrors, errors_of, with_parameters, with_sigmas
from tracker.results.result import CHANGED, remarks

# Persons who share no joint in no frame are matched last.
_NOWHERE_M = 1e6
_TRUTH_NAMES = ("truth_joints.csv", "gt_joints.csv", "joints.csv")

log = logging.getLogger("tracker")


@dataclass(frozen=True)
class Evaluation:
    """Errors of all persons, and the mean silhouette overlap."""

    persons: tuple[PersonErrors, ...]
    silhouette_iou: dict[str, float]
    """View -> mean intersection over union of model and foreground; empty without backgrounds, and of a result whose
    poses were changed after the run: the overlaps in it are those of the raw poses."""

    distances_mm: tuple[dict[str, Array], ...]
    """For each person: `frame` (T,) and joint -> (T,) distance, mm."""

    left_out: tuple[str, ...] = ()
    """Persons of the run whom the truth has nobody left for."""

    truths_left_out: tuple[str, ...] = ()
    """Persons of the truth whom the run has nobody left for."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values, without the curves."""
        table = asdict(self)
        del table["distances_mm"]
        for entry, person in zip(table["persons"], self.persons, strict=True):
            entry["angles_rms_deg"] = person.angles_rms_deg
        return table


def evaluate(result: Path, truth: Path) -> Evaluation:
    """Compares a result folder with a truth.

    Args:
        result: folder of a run.
        truth: table of joints (long: frame, joint, x, y, z, perhaps person), or a folder that holds
            truth_joints.csv or gt_joints.csv; truth_poses.csv beside it is compared too.

    Raises:
        SequenceError: files are missing, or have no frame or joint in common.
    """
    if not (result / "joints.csv").is_file():
        raise SequenceError(f"{result}: no joints.csv there, expected the result folder of a run")
    path = _truth_file(truth)
    found, true, names = read_joints(result / "joints.csv"), read_joints(path), names_of(result)
    pairs = _matched(found, true, names)
    frames_run = sorted({frame_in(row, result / "poses.csv", SequenceError) for row in read_rows(result / "poses.csv")})
    poses = path.with_name(path.name.replace("joints", "poses"))
    errors, curves = [], []
    for person, other in pairs:
        mine, theirs = _named(found.persons[person], names[person]), _named(true.persons[other], names[person])
        table, curve = errors_of((person, other), (mine, theirs), names[person], frames_run)
        table = with_sigmas(table, result, names[person].joints)
        if poses.is_file() and poses != path:
            table = with_parameters(table, result / "poses.csv", poses)
        errors.append(table)
        curves.append(curve)
    left_out = tuple(name for name in found.persons if name not in {mine for mine, _ in pairs})
    truths_left_out = tuple(name for name in true.persons if name not in {theirs for _, theirs in pairs})
    return Evaluation(tuple(errors), _overlaps(result), tuple(curves), left_out, truths_left_out)


def _truth_file(truth: Path) -> Path:
    if truth.is_dir():
        for name in _TRUTH_NAMES:
            if (truth / name).is_file():
                return truth / name
        raise SequenceError(f"{truth}: no truth in it, expected one of {', '.join(_TRUTH_NAMES)}")
    if not truth.is_file():
        raise SequenceError(f"{truth}: no such truth file")
    return truth


def _named(frames: Frames, names: JointNames) -> Frames:
    return {frame: names.of(joints) for frame, joints in frames.items()}


def _matched(found: JointTable, true: JointTable, names: dict[str, JointNames]) -> list[tuple[str, str]]:
    """Pairs of persons with the least distance, each true person once; who is lost in every frame comes last."""
    if not any(found.persons.values()):
        raise SequenceError("the result has no pose that is not lost")
    truths = {person: frames for person, frames in true.persons.items() if frames}
    if not truths:
        raise SequenceError("the truth has no joint with a position")
    costs = np.array(
        [
            [_distance_m(_named(mine, names[person]), _named(theirs, names[person])) for theirs in truths.values()]
            for person, mine in found.persons.items()
        ]
    )
    rows, columns = linear_sum_assignment(costs)
    others = list(truths)
    return [(list(found.persons)[row], others[column]) for row, column in zip(rows, columns, strict=True)]


def _distance_m(mine: Frames, theirs: Frames) -> float:
    """Mean distance of the joints that two persons have in common."""
    gaps = [
        float(np.linalg.norm(point - theirs[frame][name]))
        for frame, joints in mine.items()
        for name, point in joints.items()
        if name in theirs.get(frame, {})
    ]
    return float(np.mean(gaps)) if gaps else _NOWHERE_M


def _overlaps(result: Path) -> dict[str, float]:
    path = result / "run.json"
    if not path.is_file():
        return {}
    try:
        run = json_of(path, SequenceError)
        for remark in remarks(result, run):
            log.warning("%s: %s", result, remark)
        # silhouettes are those of the raw poses
        told = {} if CHANGED & run.keys() else run["summary"].get("silhouette_iou", {})
        return {str(view): float(value) for view, value in told.items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SequenceError(f"{path}: damaged, expected what a run writes there: {one_line(error)}") from error


def error_figure(evaluation: Evaluation) -> Figure:
    """Distance of every joint to the truth against frame number, a panel a person."""
    n_persons = len(evaluation.persons)
    figure = Figure(figsize=(9, 3.6 * n_persons), layout="constrained")
    axes = figure.subplots(n_persons, 1, sharex=True, squeeze=False)[:, 0]
    for axis, person, curves in zip(axes, evaluation.persons, evaluation.distances_mm, strict=True):
        for k, (name, values) in enumerate((name, v) for name, v in curves.items() if name != "frame"):
            style = "-" if k < 10 else "--"
            axis.plot(curves["frame"], values, style, lw=1, label=name.replace("_", " "))
        if person.n_missing == person.n_frames:
            axis.set_title(f"{person.person}: lost in every frame", fontsize=10)
            continue
        axis.set_title(f"{person.person}: mean {person.mean_mm:.0f} mm, median {person.median_mm:.0f} mm", fontsize=10)
        axis.set_ylabel("joint distance, mm")
        axis.grid(alpha=0.3)
        axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    axes[-1].set_xlabel("frame")
    return figure
