"""Errors of results whose errors are known."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.bodies.body.description import load_body
from tracker.foundation.errors import SequenceError
from tracker.foundation.resources import model_path
from tracker.results.evaluation.comparison import error_figure, evaluate, flexion
from tracker.results.evaluation.joints import JointNames, names_of
from tracker.running.cli import app

N_FRAMES = 12
NAMES = {
    model: JointNames(body.joints, body.mirror)
    for model, body in ((model, load_body(model_path(model))) for model in ("gavrila22", "quadruped"))
}
JOINTS = NAMES["gavrila22"].joints.evaluated


def write_joints(path, persons, header=("frame", "person", "joint", "x_m", "y_m", "z_m"), names=None):
    names = names or dict.fromkeys(JOINTS)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for person, joints in persons.items():
            for frame, positions in enumerate(joints):
                for k, joint in enumerate(JOINTS):
                    writer.writerow([frame, person, names.get(joint) or joint, *positions[k]])


@pytest.fixture
def truth():
    rng = np.random.default_rng(0)
    return rng.normal(size=(1, len(JOINTS), 3)) + 0.1 * rng.normal(size=(N_FRAMES, len(JOINTS), 3))


@pytest.fixture
def result(tmp_path):
    folder = tmp_path / "result"
    folder.mkdir()
    with (folder / "poses.csv").open("w") as file:
        file.write("frame,time_s,person,status\n" + "".join(f"{t},{t},a,tracked\n" for t in range(N_FRAMES)))
    return folder


def test_a_perfect_result_has_no_error(result, truth, tmp_path):
    write_joints(result / "joints.csv", {"a": truth})
    write_joints(tmp_path / "gt_joints.csv", {"1": truth}, ("frame", "person", "joint", "x", "y", "z"))
    person = evaluate(result, tmp_path).persons[0]
    assert (person.n_frames, person.n_missing) == (N_FRAMES, 0)
    assert person.mean_mm == pytest.approx(0, abs=1e-9)
    assert max(raw for raw, _ in person.hinges_deg.values()) == pytest.approx(0, abs=1e-4)


def test_a_constant_offset_is_removed(result, truth, tmp_path):
    write_joints(result / "joints.csv", {"a": truth + np.array([0.03, 0.0, 0.04])})
    write_joints(tmp_path / "truth_joints.csv", {"1": truth})
    person = evaluate(result, tmp_path).persons[0]
    assert person.mean_mm == pytest.approx(50)
    assert person.mean_offset_removed_mm == pytest.approx(0, abs=1e-6)


def test_offsets_that_turn_with_the_person_are_removed_in_the_trunks_axes(result, tmp_path):
    rng = np.random.default_rng(3)
    body, offsets = rng.normal(size=(len(JOINTS), 3)), 0.04 * rng.normal(size=(len(JOINTS), 3))
    turns = Rotation.random(N_FRAMES, random_state=4).as_matrix()
    truth = np.einsum("tij,kj->tki", turns, body) + rng.normal(size=(N_FRAMES, 1, 3))
    found = truth + np.einsum("tij,kj->tki", turns, offsets)
    write_joints(result / "joints.csv", {"a": found})
    write_joints(tmp_path / "truth_joints.csv", {"1": truth})
    person = evaluate(result, tmp_path).persons[0]
    assert person.mean_trunk_offset_removed_mm == pytest.approx(0, abs=1e-6)
    assert person.mean_offset_removed_mm > 20


def test_missing_frames_are_counted_and_persons_matched_by_distance(result, truth, tmp_path):
    write_joints(result / "joints.csv", {"a": truth[:9] + 5, "b": truth})
    write_joints(tmp_path / "truth.csv", {"1": truth, "2": truth + 5})
    evaluation = evaluate(result, tmp_path / "truth.csv")
    assert [(p.person, p.truth, p.n_missing) for p in evaluation.persons] == [("a", "2", 3), ("b", "1", 0)]
    assert error_figure(evaluation).axes


def test_who_is_compared_with_whom_is_told_where_names_cross(result, truth, tmp_path):
    write_joints(result / "joints.csv", {"a": truth + 5, "b": truth})
    write_joints(tmp_path / "truth.csv", {"a": truth, "b": truth + 5})
    told = (
        CliRunner()
        .invoke(app, ["result", "evaluate", str(result), "--truth", str(tmp_path / "truth.csv"), "--overwrite"])
        .stdout
    )
    assert "a (truth: b)" in told
    assert "paired by distance, not by name: a of the run with b of the truth, b of the run with a of the truth" in told
    write_joints(tmp_path / "truth.csv", {"a": truth + 5, "b": truth})
    told = (
        CliRunner()
        .invoke(app, ["result", "evaluate", str(result), "--truth", str(tmp_path / "truth.csv"), "--overwrite"])
        .stdout
    )
    assert "truth:" not in told
    assert "by name" not in told


def test_who_has_no_counterpart_is_told_of(result, truth, tmp_path):
    write_joints(result / "joints.csv", {"a": truth})
    write_joints(tmp_path / "truth.csv", {"1": truth + 5, "2": truth})
    told = (
        CliRunner()
        .invoke(app, ["result", "evaluate", str(result), "--truth", str(tmp_path / "truth.csv"), "--overwrite"])
        .stdout
    )
    assert "compared with nobody: 1 of the truth" in told
    write_joints(result / "joints.csv", {"a": truth, "b": truth + 5})
    write_joints(tmp_path / "truth.csv", {"a": truth})
    told = (
        CliRunner()
        .invoke(app, ["result", "evaluate", str(result), "--truth", str(tmp_path / "truth.csv"), "--overwrite"])
        .stdout
    )
    assert "compared with nobody: b of the run" in told
    assert json.loads((result / "evaluation.json").read_text())["left_out"] == ["b"]


def test_a_cell_that_lacks_in_the_truth_costs_one_frame_of_that_joint_alone(result, truth, tmp_path):
    lacking = truth.copy()
    lacking[3, JOINTS.index("left_wrist")] = np.nan
    write_joints(result / "joints.csv", {"a": truth + np.array([0.03, 0.0, 0.04])})
    write_joints(tmp_path / "truth_joints.csv", {"1": lacking})
    text = (tmp_path / "truth_joints.csv").read_text().replace("nan", "")
    (tmp_path / "truth_joints.csv").write_text(re.sub(r"(?m)^.*head_top.*\n", "", text))
    evaluation = evaluate(result, tmp_path)
    person, curves = evaluation.persons[0], evaluation.distances_mm[0]
    assert person.incomplete_frames == {"left_wrist": N_FRAMES - 1, "head_top": 0}
    assert person.joints_mm["left_wrist"] == pytest.approx((50, 0))
    assert np.flatnonzero(np.isnan(curves["left_wrist"])).tolist() == [3]
    assert np.isfinite(curves["right_wrist"]).all()
    assert (person.n_frames, person.n_missing, person.mean_mm) == (N_FRAMES, 0, pytest.approx(50))


def test_a_joint_may_lack_in_every_frame_that_shows_how_the_trunk_is_turned(result, truth, tmp_path):
    """What warns is an error in tests, and a line that nobody understands elsewhere."""
    lacking = truth.copy()
    lacking[:5, JOINTS.index("left_hip")] = np.nan
    lacking[5:, JOINTS.index("head_top")] = np.nan
    write_joints(result / "joints.csv", {"a": truth + np.array([0.03, 0.0, 0.04])})
    write_joints(tmp_path / "truth_joints.csv", {"1": lacking})
    (tmp_path / "truth_joints.csv").write_text((tmp_path / "truth_joints.csv").read_text().replace("nan", ""))
    person = evaluate(result, tmp_path).persons[0]
    assert 0 < person.mean_trunk_offset_removed_mm < 50


def test_who_is_lost_in_every_frame_is_told_of(result, truth, tmp_path):
    write_joints(result / "joints.csv", {"a": np.full_like(truth, np.nan), "b": truth})
    (result / "joints.csv").write_text((result / "joints.csv").read_text().replace("nan", ""))
    write_joints(tmp_path / "truth_joints.csv", {"1": truth, "2": truth + 5})
    evaluation = evaluate(result, tmp_path)
    lost, other = evaluation.persons
    assert (lost.person, lost.truth, lost.n_missing, other.truth) == ("a", "2", N_FRAMES, "1")
    assert "lost in every frame" in error_figure(evaluation).axes[0].get_title()
    shown = CliRunner().invoke(app, ["result", "evaluate", str(result), "--truth", str(tmp_path)]).output
    assert f"{N_FRAMES} of {N_FRAMES}" in shown
    assert "left wrist" in shown  # what is known of the second person alone has its row
    told = json.loads((result / "evaluation.json").read_text(), parse_constant=pytest.fail)
    assert told["persons"][0]["mean_mm"] is None


@pytest.mark.parametrize(
    ("spoilt", "message"),
    [
        (lambda lines: [*lines, lines[1]], "left_shoulder of person 1 is there twice in frame 0"),
        (lambda lines: [lines[0], "0,1,left_shoulder,812.0,30.0,1400.0"], "expected metres, at most 200; divide milli"),
    ],
)
def test_a_table_that_cannot_be_a_truth_is_refused(result, truth, tmp_path, spoilt, message):
    write_joints(result / "joints.csv", {"a": truth})
    write_joints(tmp_path / "truth.csv", {"1": truth})
    lines = (tmp_path / "truth.csv").read_text().splitlines()
    lines.sort(key=lambda line: not line.startswith("0,1,left_shoulder"))
    lines.insert(0, lines.pop(next(k for k, line in enumerate(lines) if line.startswith("frame"))))
    (tmp_path / "truth.csv").write_text("\n".join(spoilt(lines)))
    with pytest.raises(SequenceError, match=message):
        evaluate(result, tmp_path / "truth.csv")


def test_pose_truth_is_compared_with_wrapped_angles(result, truth, tmp_path):
    write_joints(result / "joints.csv", {"a": truth})
    write_joints(tmp_path / "truth_joints.csv", {"1": truth})
    for path, angle, name in ((result / "poses.csv", 179.0, "a"), (tmp_path / "truth_poses.csv", -179.0, "1")):
        with path.open("w") as file:
            file.write("frame,time_s,person,status,torso_x_m,torso_twist_deg\n")
            file.writelines(f"{t},{t},{name},tracked,0.5,{angle}\n" for t in range(N_FRAMES))
    person = evaluate(result, tmp_path).persons[0]
    assert person.parameters == pytest.approx({"torso_x_m": 0.0, "torso_twist_deg": 2.0})
    assert person.angles_rms_deg == pytest.approx(2.0)


def test_a_pose_truth_that_names_nobody_is_that_of_one_person(result, truth, tmp_path):
    """As a table of joints without persons is."""
    write_joints(result / "joints.csv", {"a": truth})
    write_joints(tmp_path / "truth_joints.csv", {"1": truth})
    lines = (tmp_path / "truth_joints.csv").read_text().replace(",1,", ",").replace(",person,", ",")
    (tmp_path / "truth_joints.csv").write_text(lines)
    rows = {"a,": result / "poses.csv", "": tmp_path / "truth_poses.csv"}
    for who, path in rows.items():
        head = "frame,person,torso_x_m\n" if who else "frame,torso_x_m\n"
        path.write_text(head + "".join(f"{t},{who}{0.5 if who else 0.25}\n" for t in range(N_FRAMES)))
    assert evaluate(result, tmp_path).persons[0].parameters == pytest.approx({"torso_x_m": 0.25})


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ("l_elbow", "left_elbow"),
        ("RKnee", "right_knee"),
        ("Head", "head_top"),
        ("Hip", "pelvis"),
        ("toe", "toe"),
        ("L_Wrist", "left_wrist"),
    ],
)
def test_joints_are_known_by_other_names(theirs, ours):
    assert NAMES["gavrila22"].ours(theirs) == ours


def test_two_names_of_one_joint_are_refused():
    points = {"l_elbow": np.zeros(3), "left_elbow": np.ones(3), "Hip": np.ones(3)}
    with pytest.raises(SequenceError, match="l_elbow, left_elbow all mean the joint left_elbow, expected one"):
        NAMES["gavrila22"].of(points)


def test_what_is_compared_of_an_animal_is_told_by_its_run(result, tmp_path):
    joints = NAMES["quadruped"].joints
    entry = {"name": "rex", "joints": joints.model_dump(mode="json"), "sides": ["left", "right"]}
    (result / "run.json").write_text(json.dumps({"persons": [entry]}))
    names = names_of(result)["rex"]
    assert names.joints.evaluated == joints.evaluated
    assert names.ours("snout") == "nose"
    assert names.joints.chains()["hind_left_knee"] == ("hind_left_shoulder", "hind_left_knee", "hind_left_paw")
    assert names_of(result)["anna"].joints.evaluated == JOINTS
    (result / "run.json").write_text(json.dumps({"persons": [entry | {"joints": {"evaluted": []}}]}))
    with pytest.raises(SequenceError, match=r"run\.json: damaged"):
        names_of(result)


def test_silhouettes_of_a_smoothed_result_are_not_told(result, truth, tmp_path):
    """run.json has those of the raw poses."""
    write_joints(result / "joints.csv", {"a": truth})
    write_joints(tmp_path / "truth_joints.csv", {"1": truth})
    for more, expected in (({}, {"FRONT": 0.9}), ({"smoothing": {"use": "rts"}}, {})):
        (result / "run.json").write_text(json.dumps({"summary": {"silhouette_iou": {"FRONT": 0.9}}, **more}))
        assert evaluate(result, tmp_path).silhouette_iou == expected


def test_a_run_that_was_not_finished_is_told_and_so_is_what_was_made_before_it_went_on(
    result, truth, tmp_path, caplog, monkeypatch
):
    smoothed = result / "smoothed"
    smoothed.mkdir()
    (smoothed / "poses.csv").write_text((result / "poses.csv").read_text())
    for folder in (result, smoothed):
        write_joints(folder / "joints.csv", {"a": truth})
    write_joints(tmp_path / "truth_joints.csv", {"1": truth})
    (result / "run.json").write_text(json.dumps({"complete": False, "summary": {"frames": 0}}))
    (smoothed / "run.json").write_text(json.dumps({"complete": True, "smoothing": {}, "summary": {"frames": 10}}))
    assert evaluate(result, tmp_path).silhouette_iou == {}
    assert "the run was not finished" in caplog.text
    caplog.clear()
    evaluate(smoothed, tmp_path)
    assert not caplog.text
    (result / "run.json").write_text(json.dumps({"complete": True, "summary": {"frames": 16}}))
    evaluate(smoothed, tmp_path)
    assert "made when the run had 10 frames, it has 16 now: make it anew" in caplog.text
    caplog.clear()
    monkeypatch.chdir(smoothed)
    evaluate(Path(), tmp_path)
    assert "it has 16 now" in caplog.text


def test_flexion_is_the_angle_between_the_segments():
    joints = np.array([[[0, 0, 0], [0, 0, -1], [np.sin(0.7), 0, -1 - np.cos(0.7)]]])
    assert flexion(joints) == pytest.approx(np.degrees(0.7))
    assert np.isnan(flexion(np.zeros((1, 3, 3)))).all()


def test_faults_are_named(result, truth, tmp_path):
    write_joints(result / "joints.csv", {"a": truth})
    with pytest.raises(SequenceError, match="no such truth file"):
        evaluate(result, tmp_path / "nowhere.csv")
    with pytest.raises(SequenceError, match=r"no joints\.csv there"):
        evaluate(tmp_path, result / "joints.csv")
    write_joints(tmp_path / "odd.csv", {"1": truth}, names={joint: f"x{k}" for k, joint in enumerate(JOINTS)})
    with pytest.raises(SequenceError, match="no joint in common"):
        evaluate(result, tmp_path / "odd.csv")


def test_the_figures_are_those_of_the_recordings_own_script(data, result, tmp_path):
    """Against a perturbed copy of the truth, mean and offset-removed mean over the joints both compare."""
    folder = data("room/D-TwoElbowRot")
    rng = np.random.default_rng(1)
    with (folder / "gt_joints.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if NAMES["gavrila22"].ours(row["joint"]) in JOINTS]
    shifts = {row["joint"]: 0.05 * rng.normal(size=3) for row in rows}
    for row in rows:
        for k, axis in enumerate("xyz"):
            row[axis] = f"{float(row[axis]) + shifts[row['joint']][k] + 0.01 * rng.normal():.6f}"
    moved = tmp_path / "moved.csv"
    with moved.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    (result / "joints.csv").write_text(moved.read_text())
    with (result / "poses.csv").open("w") as file:
        file.write("frame,person\n" + "".join(f"{t},1\n" for t in range(100)))
    report = tmp_path / "report.json"
    script = [sys.executable, str(data("room/score.py")), str(folder), "--joints", str(moved), "--json", str(report)]
    subprocess.run(script, check=True, capture_output=True)
    theirs = json.loads(report.read_text())["people"]["1"]["joints"]
    ours = evaluate(result, folder).persons[0]
    skipped = {"head"}  # theirs alone scores the middle of the head
    assert set(theirs["joints_scored"]) - skipped == set(theirs["joints_scored"])
    assert ours.mean_mm == pytest.approx(theirs["mpjpe_mm"], rel=1e-6)
    assert ours.mean_offset_removed_mm == pytest.approx(theirs["mpjpe_bias_removed_mm"], rel=1e-6)


def test_raw_errors_stand_beside_the_sigmas_that_the_run_tells(result, truth, tmp_path, monkeypatch):
    """Two thirds of a sigma of a constant offset: with it removed, nothing would be left to judge sigmas by."""
    folder = tmp_path / "truth"
    folder.mkdir()
    write_joints(folder / "truth_joints.csv", {"a": truth})
    write_joints(result / "joints.csv", {"a": truth + np.array([0.02, 0, 0])})
    lines = (result / "joints.csv").read_text().splitlines()
    (result / "joints.csv").write_text("\n".join([f"{lines[0]},sigma_m", *(f"{line},0.03" for line in lines[1:])]))
    (result / "models").mkdir()
    (result / "models" / "a.toml").write_bytes(Path(model_path("gavrila22")).read_bytes())
    rows = "".join(f"{t},{t},a,{2 + t % 2},3\n" for t in range(N_FRAMES))
    (result / "sigmas.csv").write_text("frame,time_s,person,left_arm_extension_deg,left_leg_extension_deg\n" + rows)
    found = evaluate(result, folder).persons[0]
    assert found.joint_sigmas_mm == pytest.approx(dict.fromkeys(JOINTS, 30.0))
    assert found.over_sigma() == pytest.approx(2 / 3)
    assert found.hinge_sigmas_deg == pytest.approx({"left_elbow": np.sqrt(6.5), "left_knee": 3.0})
    assert found.over_sigma("knee") == pytest.approx(0, abs=1e-6)
    assert np.isnan(found.over_sigma("hip"))
    monkeypatch.chdir(tmp_path)
    told = CliRunner().invoke(app, ["evaluate", "result", "--truth", "truth"], env={"COLUMNS": "120"}).stdout
    assert re.search(r"left knee, RMS \(offset removed; sigma\) +│ +0\.00 deg \(0\.00; 3\.00\)", told)
    assert re.search(r"left wrist \(offset removed; sigma\) +│ +20\.0 mm \(0\.0; 30\.0\)", told)
    assert re.search(r"joints, error over sigma +│ +0\.7", told)
