"""A model of OpenSim's own moved as the person: markers, set-up files, and, where OpenSim is installed, its outcome."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from exported import FOUND
from motions import INTERVAL_S, MODELS, made_up, performed
from osim_samples import osim_like_rajagopals
from typer.testing import CliRunner

from tracker.bodies.body.description import load_body
from tracker.foundation.configuration.tables import build
from tracker.foundation.errors import ConfigError, ModelError
from tracker.results.marker_layouts import read_markers
from tracker.results.recording._motion import Y_UP
from tracker.results.recording._osim_model import FILES, OsimName
from tracker.results.recording._osim_run import opensim_installed
from tracker.results.recording.opensim import Opensim
from tracker.running.cli import app


@pytest.fixture
def model(tmp_path):
    """A model whose bodies and coordinates are called as Rajagopal's, with our joints, taller, unable to turn round."""
    return osim_like_rajagopals(tmp_path)


def walking(turned_deg=0.0, n_frames=20):
    """Somebody who bends knees, hips and elbows and turns round, a metre up."""
    body = load_body(MODELS / "human.toml")
    q, t = np.zeros((n_frames, body.dof)), np.arange(n_frames) / n_frames
    q[:, body.index("torso_z")] = 0.93
    q[:, body.index("torso_twist")] = np.radians(turned_deg) * t
    for name, most in (("leg_extension", 40), ("leg_elevation", 30), ("arm_extension", 60)):
        q[:, body.columns(name)] = np.radians(most * (1 + np.sin(6 * t)) / 2 + 5)[:, None]
    return performed(body, q)


def files_of(movement, model, folder, **told):
    return {path.name: path for path in movement.record(Opensim(model=model, **told), folder)}


def tree(path):
    return ElementTree.parse(path).getroot()


def test_markers_of_the_movement_are_those_of_our_body_by_the_names_of_the_field(model, tmp_path, caplog):
    movement = made_up("human")
    files = files_of(movement, model, tmp_path)
    markers = read_markers(files["person1_own.trc"])
    assert {"RHip", "LKnee", "LElbow", "RWrist", "midHip", "Neck", "Nose", "Head"} <= set(markers.names)
    body = movement.scene.persons[0].body
    assert len(markers.times_s) == len(FOUND)  # frames in which the person is lost are not there
    np.testing.assert_allclose(markers.times_s, 0.4 + INTERVAL_S * np.array(FOUND), atol=1e-6)
    for name, ours in (("RHip", "right_hip"), ("LAnkle", "left_ankle"), ("Head", "head_top")):
        k = body.landmark_names.index(ours)
        places = np.array([body.landmarks_in_world(movement.poses[0][t])[k] for t in FOUND])
        np.testing.assert_allclose(markers.points[:, list(markers.names).index(name)], places @ Y_UP.T, atol=2e-6)
    bodies = {
        entry.get("name"): entry.findtext("socket_parent_frame")
        for entry in tree(files["person1_own_markers.xml"]).iter("Marker")
    }
    assert set(bodies) == set(markers.names)
    assert bodies["RKnee"] == "/bodyset/tibia_r"
    assert bodies["left_forearm_surface_2"] == "/bodyset/ulna_l"
    assert not any("shoulder_surface" in name for name in bodies)  # the model has no collar bones
    assert opensim_installed() or "OpenSim is not installed" in caplog.text


def test_a_model_that_names_its_markers_gets_these_names(model, tmp_path):
    root = tree(model)
    objects = root.find("Model/MarkerSet/objects")
    for name in ("RKJC", "LHJC", "Hip"):
        ElementTree.SubElement(objects, "Marker", {"name": name})
    ElementTree.ElementTree(root).write(model)
    names = set(read_markers(files_of(walking(), model, tmp_path)["anna_own.trc"]).names)
    assert {"RKJC", "LKnee", "LHJC", "RHip", "Hip"} <= names
    assert not {"RKnee", "LHip", "midHip"} & names


def test_it_is_scaled_in_the_reference_pose_by_lengths_between_joint_centres(model, tmp_path):
    movement = walking()
    files = files_of(movement, model, tmp_path, mass_kg=61.5)
    upright = read_markers(files["anna_own_static.trc"])
    body = movement.scene.persons[0].body
    places = dict(zip(upright.names, upright.points[0], strict=True))
    assert upright.points[..., 1].min() == pytest.approx(0, abs=1e-6)  # on the floor
    np.testing.assert_array_equal(upright.points[0], upright.points[1])
    k, h = (body.landmark_names.index(f"right_{name}") for name in ("knee", "hip"))
    thigh = body.landmarks[k].point - body.landmarks[h].point
    np.testing.assert_allclose(places["RKnee"] - places["RHip"], Y_UP @ thigh, atol=2e-6)
    tool = tree(files["anna_own_scale.xml"]).find("ScaleTool")
    assert tool.findtext("mass") == "61.5"
    assert tool.findtext("GenericModelMaker/model_file") == "anna_own_unscaled.osim"
    measured = {one.get("name"): one for one in tool.iter("Measurement")}
    assert [pair.text for pair in measured["left_thigh"].iter("markers")] == ["LHip LKnee"]
    assert [(one.get("name"), one.findtext("axes")) for one in measured["hips"].iter("BodyScale")] == [("pelvis", "Z")]
    weights = {one.get("name"): one.findtext("weight") for one in tool.iter("IKMarkerTask")}
    assert (weights["RKnee"], weights["Neck"], weights["left_thigh_surface_1"]) == ("1000", "0", "0")
    held = {one.get("name"): one.findtext("value") for one in tool.iter("IKCoordinateTask")}
    assert held["knee_angle_r"] == "0"
    assert "torso_z" not in held  # the model stands where the markers are


def test_a_sure_marker_weighs_more_than_one_in_doubt(model, tmp_path):
    movement = walking()
    body, steps = movement.scene.persons[0].body, []
    for step in movement.steps:
        covariance = step.estimates[0].covariance.copy()
        k = body.index("left_arm_extension")
        covariance[k, k] = 0.3**2  # a forearm that may be elsewhere
        steps.append(replace(step, estimates=(replace(step.estimates[0], covariance=covariance),)))
    path = files_of(replace(movement, steps=steps), model, tmp_path)["anna_own_ik.xml"]
    weights = {one.get("name"): float(one.findtext("weight")) for one in tree(path).iter("IKMarkerTask")}
    assert 0.9 < weights["RWrist"] <= 1
    assert weights["LWrist"] == pytest.approx(0.01**2 / (0.01**2 + (0.3 * 0.278) ** 2), rel=0.1)
    assert weights["LElbow"] == pytest.approx(weights["RElbow"], abs=0.01)


def test_the_model_may_turn_all_round_and_its_limbs_may_not(model, tmp_path):
    root = tree(files_of(walking(), model, tmp_path)["anna_own_unscaled.osim"])
    clamped = {one.get("name"): one.findtext("clamped") for one in root.iter("Coordinate")}
    assert (clamped["torso_twist"], clamped["knee_angle_l"]) == ("false", "true")


def test_files_of_before_opensim_4_are_read(tmp_path):
    joints = (("pelvis", "ground", "pelvis_rotation"), ("femur_l", "pelvis", "hip_l"), ("tibia_l", "femur_l", "knee_l"))
    bodies = "".join(
        f'<Body name="{name}"><Joint><CustomJoint><parent_body>{parent}</parent_body><CoordinateSet><objects>'
        f'<Coordinate name="{coordinate}"><clamped>true</clamped></Coordinate></objects></CoordinateSet></CustomJoint>'
        f"</Joint></Body>{f'<Body name={chr(34)}{name[:-1]}r{chr(34)}/>' if name != 'pelvis' else ''}"
        for name, parent, coordinate in joints
    )
    old = tmp_path / "old.osim"
    old.write_text(
        f'<OpenSimDocument Version="30000"><Model name="old"><BodySet>{bodies}</BodySet></Model></OpenSimDocument>'
    )
    root = tree(files_of(walking(), old, tmp_path)["anna_old_unscaled.osim"])
    assert [one.findtext("clamped") for one in root.iter("Coordinate")] == ["false", "true", "true"]


def test_masses_are_those_that_persons_tell(model, tmp_path):
    movement = walking()
    told = {"config": {"persons": [{"name": "anna", "mass_kg": 70.25}]}}
    recorder = Opensim(model=model).begin(replace(movement.context(tmp_path), details=told))
    for step in movement.steps:
        recorder.write(step)
    (path,) = (path for path in recorder.finish() if path.name.endswith("_scale.xml"))
    assert tree(path).findtext("ScaleTool/mass") == "70.25"
    unknown = files_of(movement, model, tmp_path)["anna_own_scale.xml"]
    assert tree(unknown).findtext("ScaleTool/mass") == "-1"  # as the lengths make it


def test_a_person_has_a_mass(tmp_path):
    assert build("recording", {"use": "opensim", "model": "a.osim"}, "", tmp_path).model == tmp_path / "a.osim"
    with pytest.raises(ConfigError, match="mass_kg = 61000"):
        build("recording", {"use": "opensim", "model": "a.osim", "mass_kg": 61000}, "", tmp_path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("<OpenSimDocument><Model", "not an XML file"),
        ('<!DOCTYPE a><OpenSimDocument Version="40000"/>', "a document type in it"),
        ("<OpenSimDocument><ScaleTool/></OpenSimDocument>", "no model of OpenSim in it"),
        ('<OpenSimDocument><Model name="arm"/></OpenSimDocument>', "no left_hip in common"),
        (None, "No such file"),
    ],
)
def test_what_is_no_such_model_is_told(tmp_path, content, words):
    path = tmp_path / "a.osim"
    if content is not None:
        path.write_text(content)
    with pytest.raises((ConfigError, ModelError), match=words):
        files_of(walking(), path, tmp_path)


def test_who_has_no_legs_gets_no_files(model, tmp_path):
    with pytest.raises(ModelError, match=r'"quadruped" and own\.osim have no left_hip'):
        files_of(made_up("quadruped"), model, tmp_path)


def test_models_are_looked_for_by_a_word(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    with pytest.raises(ConfigError, match=r"Rajagopal2016\.osim or .* give the path"):
        OsimName().resolved("rajagopal", tmp_path)
    with pytest.raises(ConfigError, match='did you mean "rajagopal"'):
        OsimName().resolved("rajagopol", tmp_path)
    place = tmp_path / "Documents" / "OpenSim" / "4.5" / "Models" / "Rajagopal"
    place.mkdir(parents=True)
    (place / FILES["rajagopal"][0]).touch()
    assert OsimName().resolved("rajagopal", tmp_path) == str(place / "Rajagopal2016.osim")


def test_it_is_exported_by_the_command(model, tmp_path):
    result = made_up("human").result(tmp_path / "result")
    arguments = ["result", "export", str(result), "--to", "opensim", "--output", str(tmp_path / "out")]
    done = CliRunner().invoke(app, [*arguments, "--model", str(model), "--mass-kg", "person1=72"])
    assert done.exit_code == 0, done.output
    assert tree(tmp_path / "out" / "person1_own_scale.xml").findtext("ScaleTool/mass") == "72"
    for more, words in (
        ([], "--model needs --to"),
        (["--model", str(model), "--mass-kg", "72kg"], "--mass-kg 72kg: expected kilograms"),
        (["--model", str(model), "--mass-kg", "nils=72"], 'no person is called "nils"'),
    ):
        told = CliRunner().invoke(app, [*arguments, *more])
        assert isinstance(told.exception, ConfigError), told.output
        assert words in str(told.exception)


needs_opensim = pytest.mark.skipif(not opensim_installed(), reason="OpenSim is not installed (extra `oracle`)")


@needs_opensim
def test_opensim_moves_a_model_with_our_joints_as_we_do(model, tmp_path, caplog):
    """Somebody who is smaller, and turns all round, which the model by itself cannot."""
    movement = walking(turned_deg=300)
    files = files_of(movement, model, tmp_path)
    outcome = json.loads(files["anna_own.json"].read_text())
    assert outcome["frames"] == len(movement.steps)
    assert outcome["marker_rms_mm"] < 1
    differences = outcome["opensim_less_ours_deg"]
    assert set(differences) == {
        f"{side}_{joint}_flexion" for side in ("left", "right") for joint in ("hip", "knee", "elbow")
    }
    assert all(abs(one["offset"]) < 0.5 and one["rms"] < 0.5 for one in differences.values()), differences
    assert not caplog.records


@needs_opensim
def test_what_opensim_cannot_do_is_told_and_the_set_up_is_left(model, tmp_path, caplog):
    model.write_text(model.read_text().replace("CustomJoint", "CostumJoint"))
    with caplog.at_level(logging.WARNING, "tracker"):
        files = files_of(walking(), model, tmp_path)
    assert "OpenSim did not move own.osim" in caplog.text
    assert "anna_own_ik.xml" in files
    assert "anna_own.mot" not in files


@needs_opensim
def test_the_model_of_pose2sim_moves_as_the_person(tmp_path):
    try:
        path = Path(OsimName().resolved("pose2sim", tmp_path))
    except ConfigError:
        pytest.skip("Pose2Sim is not installed: its wheel ships the model (pip install --no-deps pose2sim)")
    outcome = json.loads(files_of(walking(turned_deg=300), path, tmp_path)[f"anna_{path.stem}.json"].read_text())
    assert outcome["marker_rms_mm"] <= 20
    assert all(one["rms"] <= 3 for one in outcome["opensim_less_ours_deg"].values()), outcome
