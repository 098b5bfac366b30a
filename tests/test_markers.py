"""Comparison with a marker system: readers, marker sets, tables and page."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trc
from marked import JOINTS, OFFSET_S, SET, TIMES_S, joints_at, simulated
from marker_files import C3d as C3dFile
from marker_files import rotation_bytes
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.foundation.errors import ConfigError, SequenceError, TrackerError
from tracker.points.following.tables import Markers as FollowedMarkers
from tracker.points.following.tables import write_c3d
from tracker.results.evaluation.marker_comparison import compare
from tracker.results.evaluation.marker_set import joints_of, load_marker_set
from tracker.results.marker_layouts import read_markers
from tracker.results.markers import Markers

ROOT = Path(__file__).parents[1]


def trc_text(markers: Markers, unit: str = "mm", gap: str = "") -> str:
    scale = {"mm": 1000.0, "m": 1.0}[unit]
    n = len(markers.names)
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tx.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"120\t120\t{len(markers.times_s)}\t{n}\t{unit}\t120\t1\t{len(markers.times_s)}",
        "Frame#\tTime\t" + "\t\t\t".join(markers.names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{k + 1}" for k in range(n) for axis in "XYZ"),
        "",
    ]
    for k, (time_s, row) in enumerate(zip(markers.times_s, scale * markers.points.reshape(-1, 3 * n), strict=True)):
        cells = (gap if np.isnan(value) else f"{value:.9g}" for value in row)
        lines.append(f"{k + 1}\t{time_s:.8f}\t" + "\t".join(cells))
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def recording(body: BodyModel) -> Markers:
    return simulated(body, np.random.default_rng(0))


@pytest.mark.parametrize(("unit", "gap"), [("mm", ""), ("m", "NaN"), ("mm", "0.0")])
def test_trc_is_read_with_its_gaps(recording, tmp_path, unit, gap):
    path = tmp_path / "x.trc"
    path.write_text(trc_text(recording, unit, gap))
    read = read_markers(path)
    assert read.names == recording.names
    np.testing.assert_allclose(read.points, recording.points, atol=1e-7)
    np.testing.assert_allclose(read.times_s, recording.times_s, atol=1e-8)
    if gap == "NaN":
        theirs = trc.TRCData()
        theirs.load(str(path))
        np.testing.assert_allclose(np.array(theirs["M3"]), read.points[:, 3], atol=1e-7)


def test_c3d_and_trc_of_a_recording_agree(data):
    folder = data("room/R-UpperBody/markers")
    one, other = read_markers(folder / "markers.trc"), read_markers(folder / "markers.c3d")
    assert one.names == other.names
    assert one.rate_hz == pytest.approx(120, rel=1e-3)
    np.testing.assert_allclose(one.points, other.points, atol=1e-6)
    assert 0.02 < one.gaps < 0.04


def test_c3d_of_more_markers_than_a_parameter_has_names_is_read(tmp_path):
    pytest.importorskip("ezc3d")
    names, places = tuple(f"p{k}" for k in range(520)), np.random.default_rng(0).uniform(0.1, 1, (2, 520, 3))
    write_c3d(tmp_path / "many.c3d", FollowedMarkers(names, np.array([0.0, 0.02]), places, np.full((2, 520), 1e-3)))
    read = read_markers(tmp_path / "many.c3d")
    assert read.names == names
    np.testing.assert_allclose(read.points, places, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("PathFileType", "Path"), "not a file of markers"),
        (lambda text: text.replace("\tmm\t", "\tyard\t"), 'Units in line 3 is "yard"; valid: cm'),
        (lambda text: re.sub(r"\n3\t0\.0166", "\n3\t0.0001", text), "Time does not run forwards in line 9"),
        (lambda text: text.replace("\n5\t", "\n5\tx"), "'x0.03333333' in line 11"),
        (lambda text: "\n".join(text.split("\n")[:5]) + "\n\n", "the table is empty"),
    ],
)
def test_damaged_tables_are_one_sentence(recording, tmp_path, change, message):
    (tmp_path / "x.trc").write_text(change(trc_text(recording)))
    with pytest.raises(SequenceError, match=re.escape(message)):
        read_markers(tmp_path / "x.trc")


def write_set(path: Path, text: str = "") -> Path:
    joints = "\n".join(f"{name} = {list(pair)}" for name, pair in SET.joints.items()).replace("'", '"')
    path.write_text(text or f"[joints]\n{joints}\n")
    return path


def write_result(folder: Path, joints: np.ndarray, persons: tuple[str, ...] = ("anna",)) -> Path:
    folder.mkdir(exist_ok=True)
    with (folder / "joints.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("frame", "time_s", "person", "joint", "x_m", "y_m", "z_m", "status"))
        for t, frame in enumerate(joints):
            for person in persons:
                for name, point in zip(JOINTS, frame, strict=True):
                    known = np.isfinite(point).all()
                    values = [f"{value:.5f}" for value in point] if known else ["", "", ""]
                    writer.writerow((t, t / 25, person, name, *values, "tracked" if known else "lost"))
    return folder


@pytest.fixture
def compared(body, recording, tmp_path) -> tuple[Path, Path, Path]:
    """A result with five lost frames and an elbow that is 3 degrees off, its markers, and the set."""
    joints = joints_at(body, TIMES_S)
    joints[40:45] = np.nan
    (tmp_path / "m.trc").write_text(trc_text(recording))
    return write_result(tmp_path / "result", joints), tmp_path / "m.trc", write_set(tmp_path / "set.toml")


def test_a_result_is_compared_and_told(compared):
    result, _, chosen = compared
    command = [sys.executable, str(ROOT / "scripts" / "compare_with_markers.py"), *map(str, compared[:2]), "--set"]
    done = subprocess.run([*command, str(chosen)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "left elbow flexion" in done.stdout
    assert "5 of 100 frames have no joint in both" in done.stdout
    told = json.loads((result / "comparison.json").read_text())
    assert told["marker_time_minus_video_time_s"] == pytest.approx(OFFSET_S, abs=0.002)
    assert {angle["name"] for angle in told["angles"]} == {"left_elbow_flexion", "right_elbow_flexion"}
    # pairs known to 0.35 mm at both ends of bones of 0.25 m: 0.15 deg; six markers with 3 % of gaps, before and after
    assert all(angle["rms_deg"] < 0.5 and 50 < angle["n_frames"] < 90 for angle in told["angles"])
    page = (result / "comparison.html").read_text()
    assert page.count("data:image/png") == 2
    assert "http" not in page.replace("http-equiv", "")
    with (result / "comparison.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["left_elbow_flexion_deg"] == "" for row in rows] == [40 <= t < 45 for t in range(100)]
    row = next(row for row in rows if row["left_elbow_flexion_markers_deg"] and row["left_elbow_flexion_deg"])
    both = float(row["left_elbow_flexion_deg"]) - float(row["left_elbow_flexion_markers_deg"])
    assert float(row["left_elbow_flexion_difference_deg"]) == pytest.approx(both, abs=0.002)
    assert compare(*compared).n_compared == 95


def test_an_offset_of_an_angle_is_told_apart(body, recording, tmp_path):
    """A wrist carried on by 6 degrees about the axis of the elbow bends it by that in every frame."""
    joints = joints_at(body, TIMES_S)
    upper, lower = joints[:, 1] - joints[:, 0], joints[:, 2] - joints[:, 1]
    axis = np.cross(upper, lower)
    turn = Rotation.from_rotvec(np.radians(6) * axis / np.linalg.norm(axis, axis=1, keepdims=True))
    joints[:, 2] = joints[:, 1] + turn.apply(lower)
    (tmp_path / "m.trc").write_text(trc_text(recording))
    made = compare(write_result(tmp_path / "r", joints), tmp_path / "m.trc", write_set(tmp_path / "set.toml"))
    left = next(angle for angle in made.angles if angle.name == "left_elbow_flexion")
    assert left.offset_deg == pytest.approx(6, abs=0.2)
    assert left.rms_deg == pytest.approx(6, abs=0.2)
    assert left.rms_offset_removed_deg < 0.5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[joint]\na = ["M0"]', 'unknown key "joint"; did you mean "joints"'),
        ("[joints]\nleft_elbow = []", "expected one marker or more"),
        ('[joints]\nleft_elbow = ["M0", "M0"]', "each once"),
        ('[joints]\nleft_elbw = ["M0"]', 'no joint "left_elbw"; did you mean "left_elbow"'),
        ('[joints]\nleft_elbow = ["M77"]', 'no marker "M77"; did you mean'),
        (
            '[joints]\nleft_elbow = ["M1"]\n[angles]\nx = ["left_elbow", "left_wrst", "left_elbow"]',
            'no joint "left_wrst"',
        ),
        (
            '[joints]\nleft_elbow = ["M1"]\n[angles]\nx = ["left_elbow", "left_elbow", "left_elbow"]',
            "left_elbow, left_elbow, left_elbow: expected three different joints",
        ),
        ('[joints]\nleft_elbow = ["M0"]\nleft_wrist = ["M1"]', "2 joints in the marker set, expected 3"),
    ],
)
def test_mistakes_in_a_set_are_named(compared, text, message):
    result, markers, chosen = compared
    write_set(chosen, text)
    with pytest.raises(TrackerError, match=re.escape(message)):
        compare(result, markers, chosen)
    assert [path.name for path in result.iterdir()] == ["joints.csv"]


def test_markers_of_a_subject_are_found_by_their_own_name(body, recording):
    named = replace(recording, names=tuple(f"Anna:{name}" for name in recording.names))
    found = joints_of(SET, Path("set.toml"), named)
    np.testing.assert_array_equal(found.points, joints_of(SET, Path("set.toml"), recording).points)
    twice = replace(named, names=("Anna:M0", "Ben:M0", *named.names[2:]))
    with pytest.raises(ConfigError, match="several subjects"):
        joints_of(SET, Path("set.toml"), twice)


def test_who_wore_the_markers_must_be_said(body, recording, tmp_path):
    result = write_result(tmp_path / "r", joints_at(body, TIMES_S), ("anna", "ben"))
    (tmp_path / "m.trc").write_text(trc_text(recording))
    chosen = write_set(tmp_path / "set.toml")
    with pytest.raises(SequenceError, match="2 persons: choose by --person"):
        compare(result, tmp_path / "m.trc", chosen)
    with pytest.raises(SequenceError, match='no person is called "bn"; did you mean "ben"'):
        compare(result, tmp_path / "m.trc", chosen, "bn")
    assert compare(result, tmp_path / "m.trc", chosen, "ben").track.person == "ben"
    with pytest.raises(SequenceError, match=r"no joints\.csv there"):
        compare(tmp_path, tmp_path / "m.trc", chosen)


def test_a_joint_that_a_result_has_twice_in_a_frame_is_refused(compared):
    result, markers, chosen = compared
    with (result / "joints.csv").open("a", newline="") as file:
        file.write("7,0.28,anna,left_elbow,0,0,0,tracked\n")
    with pytest.raises(SequenceError, match="left_elbow of anna is there twice in frame 7"):
        compare(result, markers, chosen)


def test_a_marker_that_another_one_is_called_after_is_told_or_refused(compared):
    """The elbow's first marker is the wrist's by another name: 39 degrees and no word, before."""
    result, markers, chosen = compared
    text = markers.read_text()
    markers.write_text(text.replace("\tM4\t", "\tM2\t").replace("\tM5\t", "\t\t"))
    with pytest.raises(ConfigError, match='2 markers of the recording are called "M2"'):
        compare(result, markers, chosen)
    arm = {name: pair for name, pair in SET.joints.items() if name.startswith("right")}
    write_set(
        chosen, "[joints]\n" + "".join(f"{name} = {list(pair)}\n".replace("'", '"') for name, pair in arm.items())
    )
    found = compare(result, markers, chosen).findings
    assert "several markers have the same name, and are not used: M2" in found
    assert "m.trc: 1 of 12 markers have no name, and are left out" in found


@pytest.mark.parametrize("name", ["upper_body", "theia"])
def test_the_set_that_is_shipped_loads(name):
    chosen = load_marker_set(ROOT / "configs" / "markers" / f"{name}.toml")
    assert set(JOINTS) < set(chosen.joints)


def test_a_result_is_compared_with_segments_of_another_markerless_system(body, tmp_path):
    """Origins of segments, the only thing that Theia writes, in another world and by another clock."""
    times_s = np.arange(0.0, 5.4, 1 / 120)
    joints = joints_at(body, times_s - OFFSET_S) @ Rotation.from_euler("z", 50, degrees=True).as_matrix().T
    labels = [f"{side}_{name}_4X4" for side in "lr" for name in ("uarm", "larm", "hand")]
    file = C3dFile()
    told = {"POINT:USED": 0, "POINT:RATE": 120.0, "POINT:FRAMES": len(times_s), "POINT:UNITS": ["mm"]}
    rotation = {"ROTATION:USED": 6, "ROTATION:RATIO": 1, "ROTATION:LABELS": labels}
    content = file.written(told | rotation, b"", rotations=rotation_bytes(file, 1000 * joints))
    (tmp_path / "pose_filt_0.c3d").write_bytes(content)
    arms = {name: [label] for name, label in zip(JOINTS, labels, strict=True)}
    lines = [f"{name} = {label}".replace("'", '"').replace("_4X4", "") for name, label in arms.items()]
    chosen = write_set(tmp_path / "set.toml", "\n".join(["[joints]", *lines]) + "\n")
    made = compare(write_result(tmp_path / "r", joints_at(body, TIMES_S)), tmp_path / "pose_filt_0.c3d", chosen)
    assert made.alignment.placement.offset_s == pytest.approx(OFFSET_S, abs=0.002)
    assert all(angle.rms_deg < 0.3 for angle in made.angles)
    assert max(joint.mean_mm for joint in made.joints) < 3
