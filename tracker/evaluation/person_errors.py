"""How far one person is from a truth: distances of joints, flexions of hinges, pose parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.arrays import Array
from tracker.errors import SequenceError
from tracker.evaluation.joint_names import JointNames
from tracker.evaluation.tables import Frames, read_rows
from tracker.source_files import frame_in, number_in

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
    """Those without a pose: lost."""

    mean_mm: float
    median_mm: float
    p95_mm: float
    mean_offset_removed_mm: float
    """After removing one constant offset a joint: another convention of joint centres is no error."""

    median_offset_removed_mm: float
    mean_trunk_offset_removed_mm: float
    """The same with one constant offset a joint in the axes of the reference's trunk, which turns with the person: of
    one who walks round, offsets that are constant in the world are those of no convention. NaN where fewer than three
    limbs tell how the trunk is turned."""

    joints_mm: dict[str, tuple[float, float]]
    """Joint -> mean distance, raw and with the offset removed."""

    hinges_deg: dict[str, tuple[float, float]]
    """Hinge of the model file -> RMS error of its flexion, raw and with the constant offset removed."""

    parameters: dict[str, float]
    """Pose parameter -> RMS error in degrees or metres; empty without a pose truth."""

    @property
    def angles_rms_deg(self) -> float:
        """RMS over all joint angles of the pose; NaN without a pose truth."""
        angles = [value for name, value in self.parameters.items() if name.endswith("_deg")]
        return float(np.sqrt(np.mean(np.square(angles)))) if angles else float("nan")


def errors_of(
    who: tuple[str, str], tables: tuple[Frames, Frames], names: JointNames, frames_run: list[int]
) -> tuple[PersonErrors, dict[str, Array]]:
    """Errors of one person without pose parameters, and the distance of every joint in each frame, mm."""
    mine, theirs = tables
    frames = [frame for frame in frames_run if frame in theirs]
    common = [frame for frame in frames if frame in mine]
    if not common:
        raise SequenceError(
            f"no frame in common: the run has {frames_run[0]} to {frames_run[-1]}, "
            f"the truth {min(theirs)} to {max(theirs)}"
        )
    compared = names.joints.evaluated
    joints = [name for name in compared if all(name in mine[frame] and name in theirs[frame] for frame in common)]
    if not joints:
        raise SequenceError(
            f"no joint in common: the run has {', '.join(mine[common[0]])}; the truth {', '.join(theirs[common[0]])}"
        )
    p = np.array([[mine[frame][name] for name in joints] for frame in common])
    g = np.array([[theirs[frame][name] for name in joints] for frame in common])
    gap = 1000 * np.linalg.norm(p - g, axis=-1)
    removed = 1000 * np.linalg.norm(p - g - (p - g).mean(axis=0), axis=-1)
    table = PersonErrors(
        person=who[0],
        truth=who[1],
        n_frames=len(frames),
        n_missing=len(frames) - len(common),
        mean_mm=float(gap.mean()),
        median_mm=float(np.median(gap)),
        p95_mm=float(np.percentile(gap, 95)),
        mean_offset_removed_mm=float(removed.mean()),
        median_offset_removed_mm=float(np.median(removed)),
        mean_trunk_offset_removed_mm=_in_trunk_axes(p - g, g[:, _limb_origins(joints, names.joints.chains())]),
        joints_mm={n: (float(a), float(b)) for n, a, b in zip(joints, gap.mean(0), removed.mean(0), strict=True)},
        hinges_deg=_hinges(p, g, joints, names.joints.chains()),
        parameters={},
    )
    curve: dict[str, Array] = {"frame": np.array(common, dtype=np.float64)}
    curve.update({name: gap[:, k] for k, name in enumerate(joints)})
    return table, curve


def _limb_origins(joints: list[str], chains: dict[str, tuple[str, str, str]]) -> list[int]:
    """Columns of the joints that limbs hang on: shoulders and hips."""
    return sorted({joints.index(chain[0]) for chain in chains.values() if chain[0] in joints})


def _in_trunk_axes(gaps: Array, trunk: Array) -> float:
    """Mean length of gaps (T, J, 3) without their mean in the axes of a trunk of which points (T, L, 3) are known, mm.

    How the trunk is turned since the first frame is told by the rotation that brings its points nearest (Kabsch 1976).
    """
    spread = trunk - trunk.mean(axis=1, keepdims=True)
    if spread.shape[1] < _LEAST_ORIGINS:
        return float("nan")
    turned = np.array(
        [Rotation.align_vectors(spread[0], now)[0].apply(gap) for now, gap in zip(spread, gaps, strict=True)]
    )
    return 1000 * float(np.linalg.norm(turned - turned.mean(axis=0), axis=-1).mean())


def flexion(joints: Array) -> Array:
    """Angle (T,) in degrees between the two segments of three joints (T, 3, 3); 0 straight."""
    upper, lower = joints[:, 1] - joints[:, 0], joints[:, 2] - joints[:, 1]
    cosine = (upper * lower).sum(1) / (np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1))
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
            errors[hinge] = float(np.sqrt((gap**2).mean())), float(gap.std())
    return errors


def with_parameters(table: PersonErrors, result: Path, truth: Path) -> PersonErrors:
    """Adds the RMS error of each pose parameter, angles wrapped to half a turn."""
    mine = {frame_in(row, result, SequenceError): row for row in read_rows(result) if row.get("person") == table.person}
    theirs = {frame_in(row, truth, SequenceError): row for row in read_rows(truth) if row.get("person") == table.truth}
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
