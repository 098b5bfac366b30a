"""Scaling and inverse kinematics by OpenSim, and how near their outcome comes to ours."""

from __future__ import annotations

import importlib.util
import logging
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError
from tracker.foundation.files import write_json
from tracker.foundation.source_files import one_line, text_of
from tracker.results.recording._anatomical import joints_of
from tracker.results.recording._motion import Motion

log = logging.getLogger("tracker")

_PROGRAM = Path(__file__).with_name("_osim_process.py")

_LONGEST_S = 3600.0
"""After which OpenSim is not waited for: it takes about 5 ms a frame."""

_FLEXIONS = {"hip": "hip_flexion", "knee": "knee_angle", "elbow": "elbow_flex"}
"""Joint of ours -> coordinate of Rajagopal's models and those made of it, before `_l` or `_r`; bent is positive."""


def opensim_installed() -> bool:
    """Whether the Python package of OpenSim is there."""
    return importlib.util.find_spec("opensim") is not None


def run_opensim(folder: Path, name: str) -> str:
    """Runs scaling and inverse kinematics of the set-up files in a folder.

    Returns:
        Why there is no outcome, as OpenSim tells it; empty where there is.
    """
    command = [sys.executable, "-P", str(_PROGRAM), f"{name}_scale.xml", f"{name}_ik.xml"]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, timeout=_LONGEST_S, check=False)
    except subprocess.TimeoutExpired:
        return f"not done after {_LONGEST_S:.0f} s"
    if done.returncode == 0 and (folder / f"{name}.mot").is_file():
        return ""
    told = (done.stdout + done.stderr).decode(errors="replace").strip().splitlines()
    return one_line(Exception(next((line for line in told if "[error]" in line or "Error" in line), "it crashed")))


def write_outcome(path: Path, motion: Motion, moved: Path, errors: Path) -> None:
    """Writes how far OpenSim's markers are from ours, and its flexions from ours, as JSON.

    Args:
        path: to write.
        motion: ours.
        moved: the movement that inverse kinematics found.
        errors: of its markers.
    """
    times_s, table = _columns(moved)
    _, residuals = _columns(errors)
    flexions: dict[str, Any] = {}
    for name, ours in _flexions(motion).items():
        side, joint = name.split("_")
        coordinate = f"{_FLEXIONS[joint]}_{side[0]}"
        if coordinate in table:
            flexions[f"{name}_flexion"] = _difference(table[coordinate], np.interp(times_s, motion.times_s, ours))
    rms = residuals["marker_error_RMS"]
    markers = {
        "marker_rms_mm": round(1000 * float(np.sqrt((rms**2).mean())), 2),
        "marker_largest_mm": round(1000 * float(residuals["marker_error_max"].max()), 2),
    }
    write_json(path, {"frames": len(times_s), **markers, "opensim_less_ours_deg": flexions})


def _difference(theirs: Array, ours: Array) -> dict[str, float]:
    """Constant part and root mean square of the rest, degrees."""
    difference = theirs - ours
    offset = float(difference.mean())
    return {"offset": round(offset, 2), "rms": round(float(np.sqrt(((difference - offset) ** 2).mean())), 2)}


def _flexions(motion: Motion) -> dict[str, Array]:
    """Joint -> flexion (T,), degrees, by the standard's definition."""
    ends = [segment.end for segment in motion.body.segments]
    turns = motion.body.world_from_parameters(motion.filled)[:, ends, :3, :3]
    joints = (joint for joint in joints_of(motion.body) if joint.name.rpartition("_")[2] in _FLEXIONS)
    return {
        joint.name: np.degrees(joint.of(turns)[:, joint.angles.index("flexion")])
        for joint in joints
        if "flexion" in joint.angles
    }


def _columns(path: Path) -> tuple[Array, dict[str, Array]]:
    """Times and columns of a table that OpenSim wrote.

    Raises:
        ConfigError: it is none.
    """
    _, found, table = text_of(path, ConfigError).partition("endheader\n")
    names, *rows = (line.split("\t") for line in table.splitlines()) if found else ([],)
    if not rows or names[0] != "time":
        raise ConfigError(f"{path.name}: no table of OpenSim, expected the columns behind `endheader`, `time` first")
    values = np.array(rows, dtype=np.float64)
    return values[:, 0], {name: values[:, k] for k, name in enumerate(names)}
