"""The body as an OpenSim model and its movement: by the XML alone, and in OpenSim where it is installed."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from exported import HUNDREDTH_MM, motion_of, truth
from motions import N_FRAMES, made_up
from scipy.spatial.transform import Rotation

from tracker.results.recording._motion import Y_UP, markers_of
from tracker.results.recording.mot import Mot
from tracker.results.recording.osim import Osim


def read_mot(path):
    """Column names and numbers of a MOT file."""
    head, _, table = path.read_text().partition("endheader\n")
    names, *rows = (line.split("\t") for line in table.splitlines())
    told = dict(line.split("=") for line in head.splitlines()[1:])
    assert (told["nRows"], told["nColumns"], told["inDegrees"]) == (str(len(rows)), str(len(names)), "yes")
    return names, np.array(rows, dtype=float)


def test_mot_holds_the_parameters(movement, tmp_path):
    for k, file in enumerate(movement.record(Mot(), tmp_path)):
        motion = motion_of(movement, k)
        names, rows = read_mot(file)
        assert names == ["time", *motion.body.names]
        np.testing.assert_allclose(rows[:, 0], motion.times_s, atol=1e-8)
        radians = np.where(motion.body.rotates, np.radians(rows[:, 1:]), rows[:, 1:])
        np.testing.assert_allclose(radians, motion.filled, atol=1e-8)


def numbers(node, tag):
    return np.array(node.find(tag).text.split(), dtype=float)


def opensim_frames(model, values):
    """(4, 4) of every body in the ground, from the XML alone: frames, axes and coordinates as OpenSim defines them."""
    placed = {"/ground": np.eye(4)}
    for joint in model.iter("CustomJoint"):
        offsets = {}
        for frame in joint.iter("PhysicalOffsetFrame"):
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.from_euler("XYZ", numbers(frame, "orientation")).as_matrix()
            matrix[:3, 3] = numbers(frame, "translation")
            offsets[frame.get("name")] = frame.find("socket_parent").text, matrix
        moved = np.eye(4)
        for axis in joint.iter("TransformAxis"):
            coordinate = axis.find("coordinates")
            amount = values[coordinate.text] if coordinate is not None else 0.0
            if axis.get("name").startswith("rotation"):
                moved[:3, :3] = moved[:3, :3] @ Rotation.from_rotvec(amount * numbers(axis, "axis")).as_matrix()
            else:
                moved[:3, 3] += amount * numbers(axis, "axis")
        (parent, before), (child, after) = offsets["parent_offset"], offsets["child_offset"]
        placed[child] = placed[parent] @ before @ moved @ np.linalg.inv(after)
    return placed


def test_the_opensim_model_moved_by_mot_carries_the_markers(movement, tmp_path):
    models, motions = movement.record(Osim(), tmp_path), movement.record(Mot(), tmp_path)
    for k, (model_file, motion_file) in enumerate(zip(models, motions, strict=True)):
        motion = motion_of(movement, k)
        names, places = truth(movement, k)
        places = motion.points(motion.filled, markers_of(motion.body))
        model = ElementTree.parse(model_file).getroot().find("Model")
        columns, rows = read_mot(motion_file)
        for t in range(N_FRAMES):
            turned = np.where([False, *motion.body.rotates], np.radians(rows[t]), rows[t])
            frames = opensim_frames(model, dict(zip(columns, turned, strict=True)))
            found = {}
            for marker in model.iter("Marker"):
                frame = frames[marker.find("socket_parent_frame").text]
                found[marker.get("name")] = frame[:3, :3] @ numbers(marker, "location") + frame[:3, 3]
            np.testing.assert_allclose([found[name] for name in names] @ Y_UP, places[t], atol=HUNDREDTH_MM)


def test_opensim_itself_moves_the_model(movement, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # it leaves a log where it is imported
    opensim = pytest.importorskip("opensim", reason="OpenSim is not installed (extra `oracle`)")
    opensim.Logger.setLevelString("off")
    models, motions = movement.record(Osim(), tmp_path), movement.record(Mot(), tmp_path)
    for k, (model_file, motion_file) in enumerate(zip(models, motions, strict=True)):
        motion = motion_of(movement, k)
        places = motion.points(motion.filled, markers_of(motion.body))
        model = opensim.Model(str(model_file))
        state = model.initSystem()
        table = opensim.TimeSeriesTable(str(motion_file))
        assert list(table.getColumnLabels()) == list(motion.body.names)
        for t in range(N_FRAMES):
            row = table.getRowAtIndex(t)
            for c, name in enumerate(motion.body.names):
                value = row[c] * (np.pi / 180 if motion.body.rotates[c] else 1)
                model.getCoordinateSet().get(name).setValue(state, value, False)
            model.realizePosition(state)
            found = []
            for mark in markers_of(motion.body):
                place = model.getMarkerSet().get(mark.name).getLocationInGround(state)
                found.append([place[0], place[1], place[2]])
            np.testing.assert_allclose(np.array(found) @ Y_UP, places[t], atol=HUNDREDTH_MM)


def test_a_model_is_called_as_opensim_takes_it(tmp_path):
    movement = made_up("gavrila22")
    anna = replace(movement.scene.persons[0], name="Anna + Bob*\t2")
    named = replace(movement, scene=replace(movement.scene, persons=(anna,)))
    file = named.record(Osim(), tmp_path)[0]
    assert ElementTree.parse(file).getroot().find("Model").get("name") == "Anna___Bob__2"


def test_a_joint_that_opensim_lacks_becomes_two(tmp_path):
    """The quadruped's neck turns and then slides along itself."""
    file = made_up("quadruped").record(Osim(), tmp_path)[0]
    model = ElementTree.parse(file).getroot().find("Model")
    joints = {
        joint.get("name"): [c.get("name") for c in joint.iter("Coordinate")] for joint in model.iter("CustomJoint")
    }
    assert (joints["neck_between_1_joint"], joints["neck_joint"]) == (["neck_pitch"], ["neck_stretch"])
