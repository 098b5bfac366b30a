"""Scaling and inverse kinematics by OpenSim: set-up files, the run, and the distance of its outcome from ours."""

from __future__ import annotations

import importlib.util
import logging
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError
from tracker.foundation.files import write_json
from tracker.foundation.source_files import one_line, text_of
from tracker.results.recording._anatomical import joints_of
from tracker.results.recording._motion import Motion, Node, child, write_xml
from tracker.results.recording._osim_model import OsimMarker, OsimModel

log = logging.getLogger("tracker")

_PROGRAM = Path(__file__).with_name("_osim_process.py")

_LONGEST_S = 3600.0
"""Longest wait for OpenSim, seconds: it takes about 5 ms a frame."""

_FLEXIONS = {"hip": "hip_flexion", "knee": "knee_angle", "elbow": "elbow_flex"}
"""Our joint -> coordinate of Rajagopal's models and their descendants, before `_l` or `_r`; bent is positive."""


def opensim_installed() -> bool:
    """Whether the Python package of OpenSim is installed."""
    return importlib.util.find_spec("opensim") is not None


def run_opensim(folder: Path, name: str) -> str:
    """Runs scaling and inverse kinematics of the set-up files in a folder.

    Returns:
        Why there is no outcome, in OpenSim's words; empty if there is one.
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
    """Writes the distances of OpenSim's markers and flexions from ours, as JSON.

    Args:
        path: to write.
        motion: our movement.
        moved: the movement of inverse kinematics.
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
        ConfigError: it is not a table.
    """
    _, found, table = text_of(path, ConfigError).partition("endheader\n")
    names, *rows = (line.split("\t") for line in table.splitlines()) if found else ([],)
    if not rows or names[0] != "time":
        raise ConfigError(f"{path.name}: no table of OpenSim, expected the columns behind `endheader`, `time` first")
    values = np.array(rows, dtype=np.float64)
    return values[:, 0], {name: values[:, k] for k, name in enumerate(names)}


# Set-up files for OpenSim's scaling and inverse kinematics, and the markers that both go by.

_AXES = "X Y Z"

_LIMBS = (
    ("thigh", ("hip", "knee"), ("femur", "patella")),
    ("shin", ("knee", "ankle"), ("tibia",)),
    ("foot", ("heel", "toe"), ("talus", "calcn", "toes")),
    ("upper_arm", ("shoulder", "elbow"), ("humerus",)),
    ("forearm", ("elbow", "wrist"), ("ulna", "radius", "hand")),
)
"""Measurement -> the points whose distance it is, and the bodies that it scales; on either side."""

_PELVIS, _CHEST = ("pelvis", "sacrum"), ("torso", "head", "scapulaPhantom_l", "scapulaPhantom_r")
"""Bodies as wide as the hips, and as the shoulders."""

_SPINE = ("lumbar5", "lumbar4", "lumbar3", "lumbar2", "lumbar1", "Abdomen")
"""Bodies between; like pelvis and chest they are as long and deep as it is from hips to shoulders."""

_CENTRE_WEIGHT, _HELD_WEIGHT = 1000.0, 1.0
"""Weights of joint centres, a m^2, and of coordinates, a rad^2, where the model is placed: a centre 3 mm off weighs as
much as six degrees, so that only a turn that centres leave open, of a straight limb about itself, is held at zero."""


def write_markers(path: Path, markers: Sequence[OsimMarker]) -> None:
    """Writes the markers with their bodies; scaling moves them all to their places on our body."""
    root = Node("OpenSimDocument", {"Version": "40000"})
    objects = child(child(root, "MarkerSet", name="markers"), "objects")
    for marker in markers:
        entry = child(objects, "Marker", name=marker.name)
        child(entry, "socket_parent_frame", f"/bodyset/{marker.body}")
        child(entry, "location", " ".join(f"{value:g}" for value in marker.place or (0, 0, 0)))
        child(entry, "fixed", "false")
    write_xml(path, root)


def write_scaling(path: Path, model: OsimModel, markers: Sequence[OsimMarker], mass_kg: float | None) -> None:
    """Writes the set-up of scaling: lengths between joint centres of our body, measured in its reference pose.

    Args:
        path: `NAME_scale.xml`; `NAME_unscaled.osim`, `NAME_markers.xml` and `NAME_static.trc` lie beside it, and
            `NAME.osim` is made.
        model: names of its bodies and coordinates.
        markers: of both models.
        mass_kg: of the person; None lets masses follow the lengths.
    """
    name = path.stem.removesuffix("_scale")
    root = Node("OpenSimDocument", {"Version": "40000"})
    tool = child(root, "ScaleTool", name=name)
    child(tool, "mass", "-1" if mass_kg is None else f"{mass_kg:g}")
    maker = child(tool, "GenericModelMaker")
    child(maker, "model_file", f"{name}_unscaled.osim")
    child(maker, "marker_set_file", f"{name}_markers.xml")
    scaler = child(tool, "ModelScaler")
    child(scaler, "apply", "true")
    child(scaler, "scaling_order", "measurements")
    measured = child(child(scaler, "MeasurementSet"), "objects")
    measured.extend(_measurements(model, markers))
    _files(scaler, name)
    child(scaler, "preserve_mass_distribution", "true")
    placer = child(tool, "MarkerPlacer")
    child(placer, "apply", "true")
    tasks = child(child(placer, "IKTaskSet"), "objects")
    for marker in markers:
        tasks.append(_task("IKMarkerTask", marker.name, 0.0 if marker.place is None else _CENTRE_WEIGHT))
    tasks.extend(_held(coordinate) for coordinate in model.coordinates)
    _files(placer, name)
    child(placer, "max_marker_movement", "-1")
    write_xml(path, root)


def _files(parent: Node, name: str) -> None:
    child(parent, "marker_file", f"{name}_static.trc")
    child(parent, "time_range", "0 1")
    child(parent, "output_model_file", f"{name}.osim")


def _measurements(model: OsimModel, markers: Sequence[OsimMarker]) -> Iterator[Node]:
    called = {marker.mark.name: marker.name for marker in markers}
    sides = [(side, f"_{side[0]}") for side in ("left", "right")]
    for name, (start, end), bodies in _LIMBS:
        for side, suffix in sides:
            pair = f"{side}_{start}", f"{side}_{end}"
            scaled = [f"{body}{suffix}" for body in bodies if f"{body}{suffix}" in model.bodies]
            if set(pair) <= set(called) and scaled:
                yield _measurement(f"{side}_{name}", [pair], dict.fromkeys(scaled, _AXES), called)
    for name, point, wide in (("hips", "hip", _PELVIS), ("shoulders", "shoulder", _CHEST)):
        if {f"left_{point}", f"right_{point}"} <= set(called):
            scaled_z = {body: "Z" for body in wide if body in model.bodies}
            yield _measurement(name, [(f"left_{point}", f"right_{point}")], scaled_z, called)
    pairs = [(f"{side}_shoulder", f"{side}_hip") for side, _ in sides]
    if {point for pair in pairs for point in pair} <= set(called):
        narrow = {body: "X Y" for body in (*_PELVIS, *_SPINE, *_CHEST) if body in model.bodies}
        yield _measurement("trunk", pairs, narrow, called)


def _measurement(
    name: str, pairs: Sequence[tuple[str, str]], bodies: Mapping[str, str], called: Mapping[str, str]
) -> Node:
    node = Node("Measurement", {"name": name})
    child(node, "apply", "true")
    objects = child(child(node, "MarkerPairSet"), "objects")
    for start, end in pairs:
        child(child(objects, "MarkerPair"), "markers", f"{called[start]} {called[end]}")
    scaled = child(child(node, "BodyScaleSet"), "objects")
    for body, axes in bodies.items():
        child(child(scaled, "BodyScale", name=body), "axes", axes)
    return node


def write_kinematics(path: Path, weights: Mapping[str, float], times_s: tuple[float, float]) -> None:
    """Writes the set-up of inverse kinematics.

    Args:
        path: `NAME_ik.xml`; the scaled `NAME.osim` and `NAME.trc` lie beside it, `NAME.mot` is made.
        weights: of the markers.
        times_s: of the first frame and the last.
    """
    name = path.stem.removesuffix("_ik")
    root = Node("OpenSimDocument", {"Version": "40000"})
    tool = child(root, "InverseKinematicsTool", name=name)
    child(tool, "results_directory", ".")
    child(tool, "model_file", f"{name}.osim")
    child(tool, "constraint_weight", "Inf")
    child(tool, "accuracy", "1e-05")
    tasks = child(child(tool, "IKTaskSet"), "objects")
    for marker, weight in weights.items():
        tasks.append(_task("IKMarkerTask", marker, weight))
    child(tool, "marker_file", f"{name}.trc")
    child(tool, "time_range", f"{times_s[0]:.6f} {times_s[1]:.6f}")
    child(tool, "report_errors", "true")
    child(tool, "output_motion_file", f"{name}.mot")
    write_xml(path, root)


def _task(kind: str, name: str, weight: float) -> Node:
    task = Node(kind, {"name": name})
    child(task, "apply", "true" if weight > 0 else "false")
    child(task, "weight", f"{weight:.4g}")
    return task


def _held(coordinate: str) -> Node:
    """A coordinate at zero, where OpenSim's models stand upright with the limbs straight down, as ours do."""
    task = _task("IKCoordinateTask", coordinate, _HELD_WEIGHT)
    child(task, "value_type", "manual_value")
    child(task, "value", "0")
    return task
