"""The standard deviations that a run tells of joints and hinges, to be held against its errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.body.sections import Joints
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError
from tracker.foundation.source_files import number_in
from tracker.results.evaluation.tables import NOBODY, read_rows

_SAME_M = 0.005
"""A parameter whose axis runs so near to a hinge's landmark is of that joint."""


def joint_sigmas_mm(result: Path, person: str) -> dict[str, float]:
    """Joint -> RMS of its told standard deviation, millimetres; empty where the tables tell none.

    Args:
        result: folder of a run, or of another program's tables.
        person: of the run.
    """
    told: dict[str, list[float]] = {}
    for row in _rows(result / "joints.csv", person):
        if row.get("sigma_m"):
            sigma_m = number_in(row, "sigma_m", result / "joints.csv", SequenceError)
            told.setdefault(row["joint"], []).append(1000 * sigma_m)
    return {joint: _rms(np.array(values)) for joint, values in told.items()}


def hinge_sigmas_deg(result: Path, person: str, joints: Joints) -> dict[str, float]:
    """Hinge -> RMS of the told standard deviation of its angle, degrees; empty where the folder tells none.

    Args:
        result: folder of a run.
        person: of the run.
        joints: which landmarks are hinges.
    """
    path, model = result / "sigmas.csv", result / "models" / f"{person}.toml"
    if not (path.is_file() and model.is_file()):
        return {}
    body, rows = load_body(model), _rows(path, person)
    found = {}
    for hinge, chain in joints.chains().items():
        column = _column(body, chain)
        values = [number_in(row, column, path, SequenceError) for row in rows if column and row.get(column)]
        if values:
            found[hinge] = _rms(np.array(values))
    return found


def _column(body: BodyModel, chain: tuple[str, str, str]) -> str:
    """Name of the parameter that bends a chain of three landmarks; empty if none does by itself."""
    if not set(chain) <= set(body.landmark_names):
        return ""
    before, hinge, behind = (body.landmarks[body.landmark_names.index(name)] for name in chain)
    bending = [
        one.column
        for k, one in enumerate(body.parameters)
        if one.rotates
        and np.linalg.norm(one.point - hinge.point) < _SAME_M
        and body.moves[k, behind.parameter]
        and not body.moves[k, before.parameter]
    ]
    return bending[0] if len(bending) == 1 else ""


def _rows(path: Path, person: str) -> list[dict[str, str]]:
    return [row for row in read_rows(path) if (row.get("person") or NOBODY) == person]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
