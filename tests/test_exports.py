"""Exports read back with other programs' libraries, to a hundredth of a millimetre."""

from __future__ import annotations

import csv
import json
import logging
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import bvhio
import ezc3d
import numpy as np
import pygltflib
import pytest
import trc
from motions import INTERVAL_S, LOST, N_FRAMES, made_up
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.cli import app
from tracker.commands.export import FORMATS
from tracker.components import find
from tracker.errors import ConfigError
from tracker.recording._motion import Y_UP, Motions, markers_of
from tracker.recording.bvh import Bvh
from tracker.recording.c3d import C3d
from tracker.recording.glb import Glb
from tracker.recording.mot import Mot
from tracker.recording.osim import Osim
from tracker.recording.trc import Trc
from tracker.recording.wide_table import WideTable

HUNDREDTH_MM = 1e-5
FOUND = [t for t in range(N_FRAMES) if not LOST.start <= t < LOST.stop]


@pytest.fixture(scope="module", params=["gavrila22", "human", "quadruped"])
def movement(request):
    return made_up(request.param, "gavrila22")


def motion_of(movement, k=0):
    motions = Motions(movement.context(None))
    for step in movement.steps:
        motions.add(step)
    return motions.all()[k]


def truth(movement, k=0):
    """Names and places (T, M, 3) of all markers, metres, also where the person was lost."""
    markers = markers_of(movement.scene.persons[k].body)
    motion = motion_of(movement, k)
    return [marker.name for marker in markers], motion.points(motion.q, markers)


def test_markers_fix_every_segment_and_lie_on_its_surface(movement):
    body = movement.scene.persons[0].body
    markers = markers_of(body)
    assert len({marker.name for marker in markers}) == len(markers) == len(body.landmarks) + 3 * len(body.segments)
    for segment in body.segments:
        points = np.array([m.point for m in markers if m.name.startswith(f"{segment.name}_surface_")])
        sides = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        assert sides[1] > 0.01  # no line
        nearest = [
            np.abs(part.shape.inside_outside((points - part.model_from_part[:3, 3]) @ part.model_from_part[:3, :3]) - 1)
            for part in body.parts
            if part.segment == segment.name
        ]
        assert np.min([one.max() for one in nearest]) < 1e-9


def test_lost_frames_are_filled_between_their_neighbours(movement):
    motion = motion_of(movement)
    np.testing.assert_array_equal(motion.filled[FOUND], motion.q[FOUND])
    before, after = motion.q[LOST.start - 1], motion.q[LOST.stop]
    step = (LOST.stop - LOST.start + 1) ** -1
    np.testing.assert_allclose(motion.filled[LOST.start], before + step * (after - before), atol=1e-12)
    turned = motion.q.copy()
    turned[LOST.stop :, motion.body.root.turn] -= 2 * np.pi  # the same poses, the long way round
    again = type(motion)(**{**vars_of(motion), "q": turned})
    difference = again.filled[LOST] - motion.filled[LOST]
    np.testing.assert_allclose(difference, 0, atol=1e-9)


def vars_of(motion):
    names = ("name", "body", "times_s", "interval_s", "q", "lost", "covariances", "shares")
    return {name: getattr(motion, name) for name in names}


@pytest.mark.parametrize("y_up", [False, True])
def test_trc_is_read_back(movement, tmp_path, y_up):
    files = movement.record(Trc(y_up=y_up), tmp_path)
    assert [file.name for file in files] == ["person1.trc", "person2.trc"]
    for k, file in enumerate(files):
        read = trc.TRCData()
        read.load(str(file))
        names, places = truth(movement, k)
        assert read["Markers"] == names
        assert (read["NumFrames"], read["DataRate"], read["Units"]) == (N_FRAMES, 25.0, "m")
        np.testing.assert_allclose(read["Time"], 0.4 + INTERVAL_S * np.arange(N_FRAMES), atol=1e-6)
        found = np.array([read[name] for name in names], dtype=float).transpose(1, 0, 2)
        if y_up:
            found = found @ Y_UP
        if k == 0:
            assert np.isnan(found[LOST]).all()
            places[LOST] = np.nan
        np.testing.assert_allclose(found, places, atol=HUNDREDTH_MM)


@pytest.mark.parametrize("y_up", [False, True])
def test_c3d_is_read_back(movement, tmp_path, y_up):
    files = movement.record(C3d(y_up=y_up), tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(files)
    for k, file in enumerate(files):
        read = ezc3d.c3d(str(file))
        names, places = truth(movement, k)
        point = read["parameters"]["POINT"]
        assert point["LABELS"]["value"] == names
        assert (point["RATE"]["value"][0], point["UNITS"]["value"]) == (25.0, ["mm"])
        assert (point["X_SCREEN"]["value"], point["Y_SCREEN"]["value"]) == (["+X"], ["+Y" if y_up else "+Z"])
        found = read["data"]["points"][:3].transpose(2, 1, 0) / 1000
        rotations = read["data"]["rotations"].transpose(3, 2, 0, 1)
        assert read["parameters"]["ROTATION"]["FRAMES"]["value"][0] == N_FRAMES
        if y_up:
            found, rotations[..., :3, :] = found @ Y_UP, Y_UP.T @ rotations[..., :3, :]
        motion = motion_of(movement, k)
        placed = motion.segments(motion.q)
        placed[..., :3, 3] *= 1000
        if k == 0:
            assert np.isnan(found[LOST]).all()
            assert np.isnan(rotations[LOST]).all()
            places[LOST] = placed[LOST] = np.nan
        np.testing.assert_allclose(found, places, atol=HUNDREDTH_MM)
        np.testing.assert_allclose(rotations[..., :3, 3], placed[..., :3, 3], atol=0.01)
        np.testing.assert_allclose(rotations[..., :3, :3], placed[..., :3, :3], atol=1e-6)


def test_c3d_tells_how_sure_it_is(movement, tmp_path):
    """Read with the other library: residuals, and the 17th value of every rotation."""
    file = movement.record(C3d(), tmp_path)[0]
    read = ezc3d.c3d(str(file))
    residuals = read["data"]["meta_points"]["residuals"][0].T
    assert (residuals[LOST] == -1).all()
    motion = motion_of(movement)
    sigmas_mm = 1000 * motion.sigmas(markers_of(motion.body))
    np.testing.assert_array_equal(residuals[FOUND], np.clip(np.ceil(sigmas_mm[FOUND]), 1, 127))
    assert len(np.unique(residuals[FOUND])) > 1
    start = 512 * (int(read["parameters"]["ROTATION"]["DATA_START"]["value"][0]) - 1)
    n = N_FRAMES * len(motion.body.segments) * 17
    reliabilities = np.frombuffer(file.read_bytes(), "<f4", n, start).reshape(N_FRAMES, -1, 17)[..., -1]
    assert (reliabilities[LOST] == -1).all()
    assert set(np.unique(reliabilities[FOUND])) <= {0.0, 0.75}  # 0: the segment whose only part is hidden
    assert (reliabilities[FOUND] == 0.75).any()


def test_doubt_is_told_by_the_reliabilities(tmp_path):
    movement = made_up("gavrila22")
    sure, limb, all_of_it = (movement.steps[t].estimates[0] for t in (0, 1, 2))
    doubted = (sure, replace(limb, ambiguous=("left_arm",)), replace(all_of_it, doubtful=True))
    steps = [replace(step, estimates=(one,)) for step, one in zip(movement.steps, doubted, strict=False)]
    shares = motion_of(replace(movement, steps=steps)).shares
    arm = movement.scene.persons[0].body.parts_of("left_arm")
    assert np.nanmin(shares[0]) == 0.75
    np.testing.assert_array_equal(shares[1] == 0, arm)
    assert (shares[2] == 0).all()


def test_bvh_is_read_back(movement, tmp_path):
    """Every joint of every frame, forward kinematics by bvhio."""
    files = movement.record(Bvh(), tmp_path)
    for k, file in enumerate(files):
        motion = motion_of(movement, k)
        joints = motion.segments(motion.filled)[..., :3, 3]
        assert f"Frame Time: {INTERVAL_S:.8f}" in file.read_text()
        root = bvhio.readAsHierarchy(str(file))
        layout = {joint.Name: joint for joint, _, _ in root.layout()}
        assert set(layout) >= {segment.name for segment in motion.body.segments}
        for t in range(N_FRAMES):
            root.loadPose(t)
            found = np.array([list(layout[s.name].PositionWorld) for s in motion.body.segments])
            np.testing.assert_allclose(found / 100 @ Y_UP, joints[t], atol=HUNDREDTH_MM)


def test_bvh_angles_go_on_without_jumps(tmp_path):
    movement = made_up("gavrila22", "gavrila22")
    text = movement.record(Bvh(), tmp_path)[1].read_text()
    rows = np.array([line.split() for line in text.split("Frame Time")[1].splitlines()[1:]], dtype=float)
    assert len(rows) == N_FRAMES
    assert np.abs(np.diff(rows[:, 3:], axis=0)).max() < 90


def accessor(gltf, index):
    """An array of a GLB file, by pygltflib's account of where it lies."""
    told = gltf.accessors[index]
    view = gltf.bufferViews[told.bufferView]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[told.type]
    kind = {5126: "<f4", 5121: "u1", 5125: "<u4"}[told.componentType]
    flat = np.frombuffer(gltf.binary_blob(), kind, told.count * width, view.byteOffset)
    return flat.reshape(told.count, width) if width > 1 else flat


def in_world(gltf, keys, n, t):
    """(4, 4) of a node in frame t: its keys over its own placement, on its parent's."""
    node, own = gltf.nodes[n], np.eye(4)
    own[:3, 3] = keys[n, "translation"][t] if (n, "translation") in keys else node.translation or 0
    if (n, "rotation") in keys or node.rotation:
        turn = keys[n, "rotation"][t] if (n, "rotation") in keys else node.rotation
        own[:3, :3] = Rotation.from_quat(turn).as_matrix()
    parent = next((k for k, other in enumerate(gltf.nodes) if n in (other.children or ())), None)
    return own if parent is None else in_world(gltf, keys, parent, t) @ own


def test_glb_is_read_back(movement, tmp_path):
    """Every vertex of every frame, skinned as the specification says, lies where its part's surface does."""
    for k, file in enumerate(movement.record(Glb(), tmp_path)):
        gltf, motion = pygltflib.GLTF2().load(str(file)), motion_of(movement, k)
        primitive, skin = gltf.meshes[0].primitives[0], gltf.skins[0]
        points, bones = (accessor(gltf, getattr(primitive.attributes, name)) for name in ("POSITION", "JOINTS_0"))
        binds = accessor(gltf, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        keys = {}
        for channel in gltf.animations[0].channels:
            sampler = gltf.animations[0].samplers[channel.sampler]
            np.testing.assert_allclose(accessor(gltf, sampler.input), INTERVAL_S * np.arange(N_FRAMES), atol=1e-6)
            keys[channel.target.node, channel.target.path] = accessor(gltf, sampler.output)
        placed = motion.body.world_from_part(motion.filled)
        n_part = len(points) // len(motion.body.parts)
        eta, omega = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, 13), 2 * np.pi * np.arange(16) / 16, indexing="ij")
        for t in range(N_FRAMES):
            moves = np.array([in_world(gltf, keys, joint, t) for joint in skin.joints]) @ binds
            skinned = (moves[bones[:, 0]] @ np.pad(points, ((0, 0), (0, 1)), constant_values=1.0)[..., None])[:, :3, 0]
            for p, part in enumerate(motion.body.parts):
                surface, _ = part.shape.surface(eta, omega)
                wanted = surface.reshape(-1, 3) @ placed[t, p, :3, :3].T + placed[t, p, :3, 3]
                found = skinned[p * n_part : (p + 1) * n_part] @ Y_UP
                np.testing.assert_allclose(found, wanted, atol=HUNDREDTH_MM)
        extras = gltf.animations[0].extras
        assert extras.get("interpolated_frames") == (list(range(LOST.start, LOST.stop)) if k == 0 else None)


def test_glb_faces_look_outwards_and_turns_are_short(movement, tmp_path):
    gltf = pygltflib.GLTF2().load(str(movement.record(Glb(), tmp_path)[1]))
    primitive = gltf.meshes[0].primitives[0]
    points, normals = (accessor(gltf, getattr(primitive.attributes, name)) for name in ("POSITION", "NORMAL"))
    corners = points[accessor(gltf, primitive.indices).reshape(-1, 3)].astype(float)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = (across * normals[accessor(gltf, primitive.indices).reshape(-1, 3)[:, 0]]).sum(axis=1)
    assert (facing > 0).mean() > 0.99
    for channel in gltf.animations[0].channels:
        if channel.target.path == "rotation":
            turns = accessor(gltf, gltf.animations[0].samplers[channel.sampler].output)
            assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0).all()


def test_the_validator_of_the_format_finds_nothing(movement, tmp_path):
    """Khronos' gltf-validator, where node and the package are at hand (npm install gltf-validator)."""
    script = (
        "const v = require('gltf-validator'), fs = require('fs');"
        "v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))"
        ".then(r => console.log(JSON.stringify(r.issues)))"
    )
    if shutil.which("node") is None or subprocess.run(["node", "-e", "require('gltf-validator')"], check=False,
                                                      capture_output=True).returncode:  # fmt: skip
        pytest.skip("no gltf-validator for node")
    for file in movement.record(Glb(), tmp_path):
        told = subprocess.run(["node", "-e", script, str(file)], capture_output=True, text=True, check=True)
        issues = json.loads(told.stdout)
        assert issues["messages"] == []


def test_the_wide_table_is_read_back(movement, tmp_path):
    for k, file in enumerate(movement.record(WideTable(), tmp_path)):
        motion, body = motion_of(movement, k), movement.scene.persons[k].body
        with file.open(newline="") as opened:
            rows = list(csv.DictReader(opened))
        assert [row["frame"] for row in rows] == [str(10 + t) for t in range(N_FRAMES)]
        np.testing.assert_allclose([float(row["time_s"]) for row in rows], motion.times_s, atol=1e-6)
        for t, row in enumerate(rows):
            assert row["status"] == ("lost" if motion.lost[t] else "tracked")
            values = {name: value for name, value in row.items() if name.endswith(("_deg", "_m"))}
            assert len(values) == 2 * body.dof + 3 * len(body.landmarks)
            if motion.lost[t]:
                assert set(values.values()) == {""}
                continue
            for parameter, q in zip(body.parameters, motion.q[t], strict=True):
                unit = np.pi / 180 if parameter.rotates else 1.0
                assert unit * float(row[parameter.column]) == pytest.approx(q, abs=1e-5)
                assert unit * float(row[f"{parameter.name}_sigma_{parameter.unit}"]) == pytest.approx(1e-3, abs=1e-5)
            for name, place in zip(body.landmark_names, body.landmarks_in_world(motion.q[t]), strict=True):
                found = [float(row[f"{name}_{axis}_m"]) for axis in "xyz"]
                np.testing.assert_allclose(found, place, atol=HUNDREDTH_MM)


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


def test_a_joint_that_opensim_lacks_becomes_two(tmp_path):
    """The quadruped's neck turns and then slides along itself."""
    file = made_up("quadruped").record(Osim(), tmp_path)[0]
    model = ElementTree.parse(file).getroot().find("Model")
    joints = {
        joint.get("name"): [c.get("name") for c in joint.iter("Coordinate")] for joint in model.iter("CustomJoint")
    }
    assert (joints["neck_between_1_joint"], joints["neck_joint"]) == (["neck_pitch"], ["neck_stretch"])


def test_lost_frames_that_a_format_cannot_leave_out_are_said(tmp_path, caplog):
    with caplog.at_level(logging.WARNING, "tracker"):
        made_up("gavrila22", "gavrila22").record(Bvh(), tmp_path)
    assert [record.getMessage() for record in caplog.records] == [
        f"{tmp_path / 'person1.bvh'}: person1 is lost in 3 of 12 frames, whose poses are interpolated: "
        "the format cannot leave them out"
    ]


def test_uneven_frames_are_put_on_even_times():
    """A dropped frame and one taken late: the places between are interpolated, the gap counts as lost."""
    movement = made_up("gavrila22")
    motion = motion_of(replace(movement, steps=movement.steps[7:]))
    assert motion.even() is motion
    times = np.array([0.4, 0.44, 0.47, 0.60, 0.64])
    uneven = type(motion)(**{**vars_of(motion), "times_s": times}).even()
    np.testing.assert_allclose(uneven.times_s, 0.4 + 0.04 * np.arange(7))
    np.testing.assert_array_equal(uneven.lost, [False, False, False, True, True, False, False])
    np.testing.assert_allclose(uneven.q[[0, 1, 5, 6]], motion.q[[0, 1, 3, 4]], atol=1e-12)
    share = 0.01 / 0.13
    np.testing.assert_allclose(uneven.q[2], (1 - share) * motion.q[2] + share * motion.q[3], atol=1e-12)


def test_sigmas_are_those_of_the_poses():
    """Against finite differences of the markers: sigma of each parameter 1 mrad or 1 mm, independent."""
    motion = motion_of(made_up("human"))
    markers = markers_of(motion.body)
    q, step = motion.q[0], 1e-6
    moved = motion.points(q + step * np.eye(motion.body.dof), markers) - motion.points(
        q - step * np.eye(len(q)), markers
    )
    wanted = 1e-3 * np.sqrt(((moved / (2 * step)) ** 2).sum(axis=(0, 2)))
    np.testing.assert_allclose(motion.sigmas(markers)[0], wanted, rtol=1e-6)


@pytest.mark.parametrize("use", FORMATS)
def test_a_finished_result_is_exported_as_while_tracking(movement, tmp_path, use):
    if use == "isb_angles" and movement.scene.persons[0].body.name == "quadruped":
        pytest.skip("the standard is for persons")
    wanted = movement.record(find("recording", use)(), tmp_path)
    result = movement.result(tmp_path / "result")
    told = CliRunner().invoke(app, ["export", str(result), "--to", use, "--output", str(tmp_path / "out")])
    assert told.exit_code == 0, told.output
    assert told.output.splitlines() == [str(tmp_path / "out" / file.name) for file in wanted]
    for file in wanted:
        assert (tmp_path / "out" / file.name).read_bytes() == file.read_bytes()


def test_several_formats_at_once_into_the_result(tmp_path):
    result = made_up("gavrila22").result(tmp_path / "result")
    told = CliRunner().invoke(app, ["export", str(result), "--to", "trc", "c3d", "--y-up"])
    assert told.exit_code == 0, told.output
    assert {"person1.trc", "person1.c3d"} <= {path.name for path in result.iterdir()}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["RESULT"], "--to: expected one or more of"),
        (["RESULT", "--to", "trk"], '--to trk: no such format; did you mean "trc"'),
        (["NOWHERE", "--to", "trc"], "expected the folder of a run"),
        (["DAMAGED", "--to", "trc"], "not a JSON file"),
        (["OTHER", "--to", "trc"], "damaged, or of another version (KeyError"),
        (["EMPTY", "--to", "trc"], "no frame was tracked"),
    ],
)
def test_what_cannot_be_exported_is_one_clear_line(tmp_path, arguments, words):
    movement = made_up("gavrila22")
    movement.result(tmp_path / "RESULT")
    (movement.result(tmp_path / "DAMAGED") / "run.json").write_text('{"name": ')
    (movement.result(tmp_path / "OTHER") / "run.json").write_text('{"name": "x", "persons": []}')
    (movement.result(tmp_path / "EMPTY") / "steps.jsonl").write_text("")
    told = CliRunner().invoke(app, ["export", str(tmp_path / arguments[0]), *arguments[1:]])
    assert isinstance(told.exception, ConfigError), told.output
    assert re.search(re.escape(words), str(told.exception))
    assert "\n" not in str(told.exception)


def test_without_ezc3d_the_package_to_install_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(ConfigError, match=r'pip install "bodytrack\[export\]"'):
        C3d().begin(made_up("gavrila22").context(tmp_path))
