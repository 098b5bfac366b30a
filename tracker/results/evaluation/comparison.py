"""Comparison of a run with a truth: joint distances, angles, lost frames, silhouettes."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from tracker.bodies.body.sections import Joints
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError
from tracker.foundation.source_files import frame_in, json_of, number_in, one_line
from tracker.results.evaluation.joints import (
    NOBODY,
    Frames,
    JointNames,
    JointTable,
    hinge_sigmas_deg,
    joint_sigmas_mm,
    names_of,
    read_joints,
    read_rows,
)
from tracker.results.result import CHANGED, remarks

# Two points don't tell how a trunk is turned about the line between them.
_LEAST_ORIGINS = 3


@dataclass(frozen=True)
class PersonErrors:
    """Errors of one person; joint distances in millimetres."""

    person: str
    truth: str
    """Name in the truth."""

    n_frames: int
    """Frames of the truth within the run's range."""

    n_missing: int
    """Frames without a pose: lost."""

    mean_mm: float = np.nan
    median_mm: float = np.nan
    p95_mm: float = np.nan
    mean_offset_removed_mm: float = np.nan
    """Mean distance after removing one constant offset a joint: another convention of joint centres is no error."""

    median_offset_removed_mm: float = np.nan
    mean_trunk_offset_removed_mm: float = np.nan
    """The same with one constant offset a joint in the axes of the reference's trunk, which turns with the person: if a
    person walks in a circle, offsets constant in the world follow no convention. NaN where fewer than three limbs show
    the turn of the trunk."""

    joints_mm: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Joint -> mean distance, raw and with the offset removed."""

    hinges_deg: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Hinge of the model file -> RMS error of its flexion, raw and with the constant offset removed."""

    parameters: dict[str, float] = field(default_factory=dict)
    """Pose parameter -> RMS error in degrees or metres; empty without a pose truth."""

    joint_sigmas_mm: dict[str, float] = field(default_factory=dict)
    """Joint -> RMS of the run's standard deviation; without joints that have none."""

    hinge_sigmas_deg: dict[str, float] = field(default_factory=dict)
    """Hinge -> the same of its angle."""

    incomplete_frames: dict[str, int] = field(default_factory=dict)
    """Joint that is unknown to one of both in a frame with a pose -> frames in which it is compared; 0 for none."""

    def over_sigma(self, hinges: str = "") -> float:
        """Raw errors over the run's standard deviations, RMS over joints or hinges; NaN if there are none.

        Args:
            hinges: end of the names of hinges, for instance `elbow`; empty for joints.
        """
        if hinges:
            pairs = [(self.hinges_deg[n][0], s) for n, s in self.hinge_sigmas_deg.items() if n.endswith(hinges)]
        else:
            pairs = [(self.joints_mm[n][0], s) for n, s in self.joint_sigmas_mm.items()]
        ratios = [error / sigma for error, sigma in pairs if sigma > 0]
        return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else float("nan")

    @property
    def angles_rms_deg(self) -> float:
        """RMS over all joint angles of the pose; NaN without a pose truth."""
        angles = [value for name, value in self.parameters.items() if name.endswith("_deg")]
        return float(np.sqrt(np.mean(np.square(angles)))) if angles else float("nan")


def errors_of(
    who: tuple[str, str], tables: tuple[Frames, Frames], names: JointNames, frames_run: list[int]
) -> tuple[PersonErrors, dict[str, Array]]:
    """Errors of one person without pose parameters, and the distance of every joint in each frame, mm.

    A joint that one of both lacks in a frame is left out of that frame alone: its distance there is NaN.

    Raises:
        SequenceError: they have no frame, or no joint, in common.
    """
    mine, theirs = tables
    frames = [frame for frame in frames_run if frame in theirs]
    if not frames:
        raise SequenceError(
            f"no frame in common: the run has {frames_run[0]} to {frames_run[-1]}, "
            f"the truth {min(theirs)} to {max(theirs)}"
        )
    compared = names.joints.evaluated
    found = [frame for frame in frames if frame in mine]
    if not found:
        known = [name for name in compared if any(name in theirs[frame] for frame in frames)]
        return PersonErrors(*who, len(frames), len(frames)), {name: np.zeros(0) for name in ("frame", *known)}
    together = {frame: [name for name in compared if name in mine[frame] and name in theirs[frame]] for frame in found}
    common = [frame for frame in found if together[frame]]
    if not common:
        raise SequenceError(
            f"no joint in common: the run has {', '.join(mine[found[0]])}; the truth {', '.join(theirs[found[0]])}"
        )
    n_compared = {name: sum(name in together[frame] for frame in common) for name in compared}
    joints = [name for name in compared if n_compared[name]]
    p, g = (_points(table, common, joints) for table in tables)
    curves = 1000 * np.linalg.norm(p - g, axis=-1)
    table = replace(
        _summary(who, p, g, joints, names.joints.chains()),
        n_frames=len(frames),
        n_missing=len(frames) - len(found),
        incomplete_frames={name: n for name, n in n_compared.items() if n < len(common)},
    )
    curve: dict[str, Array] = {"frame": np.array(common, dtype=np.float64)}
    curve.update({name: curves[:, k] for k, name in enumerate(joints)})
    return table, curve


def _points(table: Frames, frames: list[int], joints: list[str]) -> Array:
    """(T, J, 3) metres; NaN where the table has none."""
    unknown = np.full(3, np.nan)
    return np.array([[table[frame].get(name, unknown) for name in joints] for frame in frames])


def _summary(
    who: tuple[str, str], p: Array, g: Array, joints: list[str], chains: dict[str, tuple[str, str, str]]
) -> PersonErrors:
    """Errors of points p (T, J, 3) against g, metres; the caller fills in the number of frames."""
    gap = 1000 * np.linalg.norm(p - g, axis=-1)
    removed = 1000 * np.linalg.norm(p - g - np.nanmean(p - g, axis=0), axis=-1)
    means = zip(joints, np.nanmean(gap, axis=0), np.nanmean(removed, axis=0), strict=True)
    return PersonErrors(
        person=who[0],
        truth=who[1],
        n_frames=len(gap),
        n_missing=0,
        mean_mm=float(np.nanmean(gap)),
        median_mm=float(np.nanmedian(gap)),
        p95_mm=float(np.nanpercentile(gap, 95)),
        mean_offset_removed_mm=float(np.nanmean(removed)),
        median_offset_removed_mm=float(np.nanmedian(removed)),
        mean_trunk_offset_removed_mm=_in_trunk_axes(p - g, g[:, _limb_origins(joints, chains)]),
        joints_mm={name: (float(raw), float(rest)) for name, raw, rest in means},
        hinges_deg=_hinges(p, g, joints, chains),
    )


def _limb_origins(joints: list[str], chains: dict[str, tuple[str, str, str]]) -> list[int]:
    """Columns of the joints that carry limbs: shoulders and hips."""
    return sorted({joints.index(chain[0]) for chain in chains.values() if chain[0] in joints})


def _in_trunk_axes(gaps: Array, trunk: Array) -> float:
    """Mean length of gaps (T, J, 3) without their mean in the axes of a trunk with known points (T, L, 3), mm.

    The turn of the trunk since the first frame is the rotation that brings its points nearest (Kabsch 1976). Frames
    with an unknown point are left out.
    """
    known = np.isfinite(trunk).all(axis=(1, 2))
    gaps, trunk = gaps[known], trunk[known]
    gaps = gaps[:, np.isfinite(gaps).any(axis=(0, 2))]  # a joint may be known in the other frames alone
    if trunk.shape[1] < _LEAST_ORIGINS or not gaps.size:
        return float("nan")
    spread = trunk - trunk.mean(axis=1, keepdims=True)
    turned = np.array(
        [Rotation.align_vectors(spread[0], now)[0].apply(gap) for now, gap in zip(spread, gaps, strict=True)]
    )
    return 1000 * float(np.nanmean(np.linalg.norm(turned - np.nanmean(turned, axis=0), axis=-1)))


def flexion(joints: Array) -> Array:
    """Angle (T,) in degrees between the two segments of three joints (T, 3, 3); 0 straight, NaN without a length."""
    upper, lower = joints[:, 1] - joints[:, 0], joints[:, 2] - joints[:, 1]
    lengths = np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1)
    cosine = (upper * lower).sum(1) / np.where(lengths > 0, lengths, np.nan)
    degrees: Array = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return degrees


def _hinges(
    p: Array, g: Array, joints: list[str], chains: dict[str, tuple[str, str, str]]
) -> dict[str, tuple[float, float]]:
    """RMS error of each hinge's flexion, raw and with its mean removed, degrees."""
    errors = {}
    for hinge, chain in chains.items():
        if set(chain) <= set(joints):
            columns = [joints.index(name) for name in chain]
            gap = flexion(p[:, columns]) - flexion(g[:, columns])
            gap = gap[np.isfinite(gap)]
            if not gap.size:
                continue
            errors[hinge] = float(np.sqrt((gap**2).mean())), float(gap.std())
    return errors


def with_sigmas(table: PersonErrors, result: Path, joints: Joints) -> PersonErrors:
    """Adds the run's own uncertainties."""
    told_mm, told_deg = joint_sigmas_mm(result, table.person), hinge_sigmas_deg(result, table.person, joints)
    return replace(
        table,
        joint_sigmas_mm={name: told_mm[name] for name in table.joints_mm if name in told_mm},
        hinge_sigmas_deg={name: told_deg[name] for name in table.hinges_deg if name in told_deg},
    )


def with_parameters(table: PersonErrors, result: Path, truth: Path) -> PersonErrors:
    """Adds the RMS error of each pose parameter, angles wrapped to half a turn."""
    mine, theirs = _rows_of(table.person, result), _rows_of(table.truth, truth)
    errors: dict[str, list[float]] = {}
    for frame, row in mine.items():
        for column, value in row.items():
            true = theirs.get(frame, {}).get(column, "")
            if value and true and column.endswith(("_deg", "_m")):
                gap = number_in(row, column, result, SequenceError) - number_in(
                    theirs[frame], column, truth, SequenceError
                )
                errors.setdefault(column, []).append((gap + 180) % 360 - 180 if column.endswith("_deg") else gap)
    rms = {column: float(np.sqrt(np.mean(np.square(gaps)))) for column, gaps in errors.items()}
    return PersonErrors(**{**vars(table), "parameters": rms})


def _rows_of(person: str, path: Path) -> dict[int, dict[str, str]]:
    """Frame -> row of a person in a table of poses; a table without persons is one person's, like a table of joints."""
    rows = [row for row in read_rows(path) if (row.get("person") or NOBODY) == person]
    return {frame_in(row, path, SequenceError): row for row in rows}


# Persons who share no joint in no frame are matched last.
_NOWHERE_M = 1e6
_TRUTH_NAMES = ("truth_joints.csv", "gt_joints.csv", "joints.csv")

log = logging.getLogger("tracker")


@dataclass(frozen=True)
class Evaluation:
    """Errors of all persons, and the mean silhouette overlap."""

    persons: tuple[PersonErrors, ...]
    silhouette_iou: dict[str, float]
    """View -> mean intersection over union of model and foreground; empty without backgrounds, and for changed poses:
    the overlaps in their result are those of the raw poses."""

    distances_mm: tuple[dict[str, Array], ...]
    """For each person: `frame` (T,) and joint -> (T,) distance, mm."""

    left_out: tuple[str, ...] = ()
    """Persons of the run without a partner in the truth."""

    truths_left_out: tuple[str, ...] = ()
    """Persons of the truth without a partner in the run."""

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
    """Pairs of persons with the least distance, each true person once; persons lost in every frame come last."""
    if not any(found.persons.values()):
        raise SequenceError("the result has no pose: every frame is lost")
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
        raise SequenceError(f"{path}: damaged, expected the file of a run: {one_line(error)}") from error


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
