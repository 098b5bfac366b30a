"""Comparison with a marker system: readers, marker sets, alignment in time and space, tables and page."""

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
from scipy.spatial.transform import Rotation

from tracker.body import BodyModel
from tracker.errors import ConfigError, SequenceError, TrackerError
from tracker.evaluation.marker_alignment import align
from tracker.evaluation.marker_comparison import compare
from tracker.evaluation.marker_fit import placed
from tracker.evaluation.marker_set import MarkerJoints, MarkerSet, joints_of, load_marker_set
from tracker.evaluation.rigid_motion import rigid_motion
from tracker.evaluation.time_correlation import Clocked, flexions, offsets_by_angles
from tracker.marker_layouts import read_markers
from tracker.markers import Markers

ROOT = Path(__file__).parents[1]
JOINTS = ("left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow", "right_wrist")
HINGES = [(0, 1, 2), (3, 4, 5)]
OFFSET_S, TURN, SHIFT = (
    0.3137,
    Rotation.from_euler("zyx", [128.0, 7.0, -3.0], degrees=True).as_matrix(),
    (1.3, -0.7, 0.1),
)
NOISE_M = 0.0005
SIDES_M = 0.03
"""From a joint's centre to either marker of its pair."""


def movement(body: BodyModel, times_s: np.ndarray) -> np.ndarray:
    """(T, dof) poses: both arms swing and bend, the body leans and turns; nothing repeats."""
    q = np.tile(body.rest(), (len(times_s), 1))
    curves = {
        "torso_x": 0.2 * np.sin(0.9 * times_s),
        "torso_z": 1.0 + 0.02 * np.sin(2.1 * times_s),
        "torso_elevation": np.radians(12) * np.sin(1.3 * times_s),
        "torso_twist": np.radians(15) * times_s,
        "left_arm_elevation": np.radians(50 + 35 * np.sin(2.2 * times_s)),
        "right_arm_elevation": np.radians(40 + 35 * np.sin(1.7 * times_s + 1)),
        "left_arm_abduction": np.radians(30 + 20 * np.sin(1.1 * times_s)),
        "right_arm_abduction": np.radians(25 + 15 * np.sin(1.5 * times_s)),
        "left_arm_extension": np.radians(50 + 40 * np.sin(2.9 * times_s + 0.4 * times_s**2)),
        "right_arm_extension": np.radians(45 + 35 * np.sin(3.4 * times_s + 1 + 0.3 * times_s**2)),
    }
    for name, curve in curves.items():
        q[:, body.names.index(name)] = curve
    return q


def joints_at(body: BodyModel, times_s: np.ndarray) -> np.ndarray:
    """(T, 6, 3) m."""
    columns = [body.landmark_names.index(name) for name in JOINTS]
    return body.landmarks_in_world(movement(body, times_s))[:, columns]


def simulated(body: BodyModel, rng: np.random.Generator, rate_hz: float = 120.0) -> Markers:
    """Pairs of markers on both sides of every joint, with noise and gaps, in a world and by a clock of their own."""
    times_s = np.arange(0.0, 5.4, 1 / rate_hz)
    joints = joints_at(body, times_s - OFFSET_S)
    pairs = []
    for k in range(6):
        first = 3 * (k // 3)
        upper, lower = joints[:, first + 1] - joints[:, first], joints[:, first + 2] - joints[:, first + 1]
        hinge = np.cross(upper, lower)
        across = SIDES_M * hinge / np.linalg.norm(hinge, axis=1, keepdims=True)
        pairs += [joints[:, k] + across, joints[:, k] - across]
    points = np.stack(pairs, axis=1) @ TURN.T + SHIFT + NOISE_M * rng.normal(size=(len(times_s), 12, 3))
    points[rng.random(points.shape[:2]) < 0.03] = np.nan
    return Markers(tuple(f"M{k}" for k in range(12)), times_s, points)


SET = MarkerSet(joints={name: (f"M{2 * k}", f"M{2 * k + 1}") for k, name in enumerate(JOINTS)})
TIMES_S = np.arange(100) / 25


@pytest.fixture(scope="module")
def marker_joints(body: BodyModel) -> MarkerJoints:
    return joints_of(SET, Path("set.toml"), simulated(body, np.random.default_rng(0)))


def turn_error_deg(rotation: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.degrees(Rotation.from_matrix(rotation @ wanted.T).magnitude()))


def lost_arm(joints: np.ndarray, side: int) -> np.ndarray:
    """One arm stays where it was at first, as an arm does that was lost before the trunk."""
    wrong = joints.copy()
    wrong[:, 3 * side + 1 : 3 * side + 3] = joints[:1, 3 * side + 1 : 3 * side + 3] + (0.1, 0.15, 0.1)
    return wrong


@pytest.mark.parametrize("lost", [None, 0, 1])
def test_alignment_is_as_good_as_the_noise_allows_whichever_arm_is_lost(body, marker_joints, lost):
    """Half a millimetre on each of two markers, six joints (four, where an arm is lost) in 100 frames.

    The middle of a pair is known to 0.35 mm; 400 and more of them move at 0.5 m/s, 0.3 m about their centre: five
    standard errors are 0.2 ms, 0.02 deg and 0.1 mm. What is left is linear interpolation at 120 Hz, 50 m/s^2 dt^2 / 8 =
    0.4 mm, and the shift of each joint that is estimated besides: ten times the former, far below what is asked for.
    """
    joints = joints_at(body, TIMES_S)
    ours = Clocked(TIMES_S, joints if lost is None else lost_arm(joints, lost))
    found = align(ours, marker_joints, HINGES).placement
    assert found.offset_s == pytest.approx(OFFSET_S, abs=0.002)
    assert turn_error_deg(found.rotation, TURN) < 0.2
    middle = joints.mean(axis=(0, 1))
    assert np.linalg.norm(found.in_their_world(middle) - (TURN @ middle + SHIFT)) < 0.002
    back = found.in_our_world(found.in_their_world(joints))
    np.testing.assert_allclose(back, joints, atol=1e-12)


def test_a_plain_least_squares_fit_would_be_spoilt(body, marker_joints):
    """What the robust fit is for: the same track, all samples counted."""
    ours = lost_arm(joints_at(body, TIMES_S), 0)
    theirs = marker_joints.at(TIMES_S + OFFSET_S)
    both = np.isfinite(theirs).all(axis=-1)
    rotation, _ = rigid_motion(ours[both], theirs[both])
    assert turn_error_deg(rotation, TURN) > 3


@pytest.mark.parametrize("off_s", [-0.35, 0.35])
def test_time_is_found_from_where_angles_were_wrong_about_it(body, marker_joints, off_s):
    """A lost arm bends by itself: on R-Turn, angles were 0.3 s off."""
    ours = Clocked(TIMES_S, lost_arm(joints_at(body, TIMES_S), 0))
    found = placed(ours, marker_joints, OFFSET_S + off_s)
    assert found is not None
    assert found.offset_s == pytest.approx(OFFSET_S, abs=0.002)


def test_noise_of_a_track_is_averaged_and_told(body, marker_joints):
    rng = np.random.default_rng(3)
    ours = Clocked(TIMES_S, joints_at(body, TIMES_S) + 0.01 * rng.normal(size=(100, 6, 3)))
    found = align(ours, marker_joints, HINGES)
    assert abs(found.placement.offset_s - OFFSET_S) < 4 * max(found.offset_sigma_s, 0.001)
    assert turn_error_deg(found.placement.rotation, TURN) < 4 * found.rotation_sigma_deg
    assert 0.05 < found.rotation_sigma_deg < 2
    assert found.correlation > 0.9
    assert np.isnan(found.rival_offset_s)


def test_joints_beside_their_markers_are_found_and_bias_nothing(body, marker_joints):
    """The pair of one shoulder sits 20 mm off, as on R-Turn: found, though the others pull with 15 mm of prior."""
    beside = np.zeros((1, 6, 3))
    beside[0, 0] = (0.0, 0.02, 0.0)
    shifted = marker_joints.points + np.einsum(
        "tjab,tjb->tja", marker_joints.frames, np.broadcast_to(beside, (1, 6, 3))
    )
    found = align(Clocked(TIMES_S, joints_at(body, TIMES_S)), replace(marker_joints, points=shifted), HINGES).placement
    assert found.beside_m[0, 1] == pytest.approx(-0.02, abs=0.004)
    assert turn_error_deg(found.rotation, TURN) < 0.3


def test_movement_that_repeats_has_a_rival():
    """A push-up every 0.8 s on the spot: nothing tells one from the next."""
    bend = np.radians(50 + 40 * np.sin(2 * np.pi * np.arange(0, 8, 0.01) / 0.8))
    zero = np.zeros_like(bend)
    upper = np.stack([0.3 * np.sin(bend / 2), zero, 0.3 * np.cos(bend / 2)], axis=1)
    lower = np.stack([-0.3 * np.sin(bend / 2), zero, 0.3 * np.cos(bend / 2)], axis=1)
    arm = np.stack([upper + lower, lower, zero[:, None] * np.ones(3)], axis=1)
    markers = MarkerJoints(np.arange(0, 8, 0.01), arm, np.tile(np.eye(3), (800, 3, 1, 1)), shifts=(False, False, False))
    found = align(Clocked(np.arange(100) / 25, arm[100:500:4]), markers, [(0, 1, 2)])
    gap = found.rival_offset_s - found.placement.offset_s
    assert gap / 0.8 == pytest.approx(round(gap / 0.8), abs=0.02)
    assert round(gap / 0.8) != 0


def test_correlation_is_that_of_the_samples_both_have():
    """Against a plain sum over one lag after the other."""
    rng = np.random.default_rng(1)
    times_s = np.arange(300) / 100.0
    bend = np.cumsum(rng.normal(size=300)) * 4 + 60
    points = np.zeros((300, 3, 3))
    points[:, 0, 2], points[:, 2] = -1.0, np.stack([np.sin(np.radians(bend)), 0 * bend, np.cos(np.radians(bend))], 1)
    theirs = Clocked(times_s + 7.0, points)
    ours = Clocked(times_s[:200], points[60:260].copy())
    ours.points[20:30] = np.nan
    found = offsets_by_angles(ours, theirs, [(0, 1, 2)])
    assert found[0][1] == pytest.approx(7.6, abs=1e-9)
    assert found[0][0] == pytest.approx(1.0, abs=1e-6)
    angles = flexions(ours.points, [(0, 1, 2)])[:, 0], flexions(theirs.points, [(0, 1, 2)])[:, 0]
    for correlation, offset in found[1:]:
        shift = round((offset - 7.0) * 100)
        other = np.array([angles[1][k + shift] if 0 <= k + shift < 300 else np.nan for k in range(200)])
        both = np.isfinite(angles[0]) & np.isfinite(other)
        assert correlation == pytest.approx(np.corrcoef(angles[0][both], other[both])[0, 1], abs=1e-6)


def test_what_tells_no_time_is_said(body, marker_joints):
    still = Clocked(TIMES_S, np.repeat(joints_at(body, TIMES_S[:1]), 100, axis=0))
    with pytest.raises(SequenceError, match=r"no hinge turns by 2 degrees.*--offset"):
        align(still, marker_joints, HINGES)
    rng = np.random.default_rng(5)
    other = joints_at(body, TIMES_S)
    other[:, [2, 5]] = other[:, [1, 4]] + 0.2 * rng.normal(size=(100, 2, 3))
    with pytest.raises(SequenceError, match="do not vary together"):
        align(Clocked(TIMES_S, other), marker_joints, HINGES)
    given = align(Clocked(TIMES_S, joints_at(body, TIMES_S)), marker_joints, [], offset_s=OFFSET_S - 0.08)
    assert given.placement.offset_s == pytest.approx(OFFSET_S, abs=0.002)


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
    pytest.importorskip("c3d")
    one, other = read_markers(folder / "markers.trc"), read_markers(folder / "markers.c3d")
    assert one.names == other.names
    assert one.rate_hz == pytest.approx(120, rel=1e-3)
    np.testing.assert_allclose(one.points, other.points, atol=1e-6)
    assert 0.02 < one.gaps < 0.04


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("PathFileType", "Path"), "not a TRC file"),
        (lambda text: text.replace("\tmm\t", "\tinch\t"), 'Units is "inch"; valid: cm'),
        (lambda text: text.replace("M0\t", "\t").replace("M", ""), "expected at most"),
        (lambda text: re.sub(r"\n3\t0\.0166", "\n3\t0.0001", text), "Time does not run forwards in row 3"),
        (lambda text: text.replace("\n5\t", "\n5\tx"), "'x0.03333333' in line 11"),
        (lambda text: "\n".join(text.split("\n")[:5]) + "\n\n", "the table is empty"),
    ],
)
def test_damaged_tables_are_one_sentence(recording, tmp_path, change, message):
    (tmp_path / "x.trc").write_text(change(trc_text(recording)))
    with pytest.raises(SequenceError, match=re.escape(message)):
        read_markers(tmp_path / "x.trc")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "x.c3d").write_bytes(b"PathFileType")
    (tmp_path / "cut.c3d").write_bytes(b"\x02\x50" + bytes(600))
    for name, message in (("x.csv", "expected a file of markers"), ("y.trc", "no such file"), ("x.c3d", "not a C3D")):
        with pytest.raises(SequenceError, match=message):
            read_markers(tmp_path / name)


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
    with pytest.raises(SequenceError, match="2 persons: say by --person"):
        compare(result, tmp_path / "m.trc", chosen)
    with pytest.raises(SequenceError, match='nobody is called "bn"; did you mean "ben"'):
        compare(result, tmp_path / "m.trc", chosen, "bn")
    assert compare(result, tmp_path / "m.trc", chosen, "ben").track.person == "ben"
    with pytest.raises(SequenceError, match=r"no joints\.csv there"):
        compare(tmp_path, tmp_path / "m.trc", chosen)


@pytest.mark.parametrize("name", ["R-UpperBody", "R-Turn"])
@pytest.mark.parametrize("lost", [None, "left", "right"])
def test_recorded_markers_are_aligned_with_the_truth(data, tmp_path, name, lost):
    """Truth as the result. The joints' pairs lie up to 20 mm beside the centres, and the trunk hardly turns.

    Errors of the markers' elbows were counted without what slides on the cloth: 2 mm at either end of a bone of 0.24 m
    are up to a degree.
    """
    folder = data(f"room/{name}")
    truth = json.loads((folder / "markers" / "truth.json").read_text())
    result = tmp_path / "result"
    result.mkdir()
    with (folder / "gt_joints.csv").open(newline="") as file, (result / "joints.csv").open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(("frame", "time_s", "person", "joint", "x_m", "y_m", "z_m"))
        for row in csv.DictReader(file):
            point = np.array([float(row[axis]) for axis in "xyz"])
            if lost and row["joint"] in (f"{lost[0]}_elbow", f"{lost[0]}_wrist"):
                point += (0.2, 0.1, 0.1)
            writer.writerow((row["frame"], int(row["frame"]) / 25, "1", row["joint"], *point))
    made = compare(result, folder / "markers" / "markers.trc", ROOT / "configs" / "markers" / "upper_body.toml")
    placed = made.alignment.placement
    assert placed.offset_s == pytest.approx(truth["marker_time_minus_video_time_s"], abs=0.002)
    wanted = np.array(truth["rotation_marker_from_world"])
    assert turn_error_deg(placed.rotation, wanted) < 0.3
    points = made.track.motion.points
    middle = np.nanmean(points, axis=(0, 1))
    assert np.linalg.norm(placed.in_their_world(middle) - (wanted @ middle + truth["translation_m"])) < 0.005
    if lost is None:
        angles = {angle.name: angle for angle in made.angles}
        for side in ("left", "right"):
            theirs = truth[f"elbow_{side[0].upper()}_markers_minus_truth_deg"]
            found = angles[f"{side}_elbow_flexion"]
            assert found.rms_deg == pytest.approx(theirs["rms"], abs=1)
            assert found.offset_deg == pytest.approx(-theirs["offset"], abs=1)
            assert found.rms_offset_removed_deg == pytest.approx(theirs["rms_offset_removed"], abs=1)


def test_the_set_that_is_shipped_loads():
    chosen = load_marker_set(ROOT / "configs" / "markers" / "upper_body.toml")
    assert set(JOINTS) < set(chosen.joints)
