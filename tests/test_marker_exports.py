"""Landmarks and surface markers in TRC and C3D, read back with other libraries, to a hundredth of a millimetre."""

from __future__ import annotations

import sys
from dataclasses import replace

import ezc3d
import numpy as np
import pytest
import trc
from doubted import in_doubt
from exported import FOUND, HUNDREDTH_MM, motion_of, truth
from motions import INTERVAL_S, LOST, N_FRAMES, SIGMA, made_up

from tracker.foundation.errors import ConfigError
from tracker.results.recording._motion import Y_UP, markers_of
from tracker.results.recording.c3d import C3d
from tracker.results.recording.trc import Trc


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


def test_c3d_of_a_long_recording_keeps_to_what_the_format_holds(tmp_path, caplog, monkeypatch):
    """Its rotations are left out where no parameter could say where they begin; the reliabilities spoilt points."""
    monkeypatch.setattr("tracker.results.recording.c3d._LAST_BLOCK", 200)
    movement = made_up("gavrila22")
    places = truth(movement)[1]
    read = ezc3d.c3d(str(movement.record(C3d(), tmp_path)[0]))
    assert read["data"]["rotations"].size == 0
    found = read["data"]["points"][:3].transpose(2, 1, 0) / 1000
    np.testing.assert_allclose(found[FOUND], places[FOUND], atol=HUNDREDTH_MM)
    assert "rotations of segments are left out: 12 frames are too many" in caplog.text
    with pytest.raises(ConfigError, match="65536 frames, a C3D file holds at most 65535"):
        C3d().begin(replace(movement.context(tmp_path), n_frames=65536))


def test_c3d_of_more_points_than_a_list_holds_is_read_back(tmp_path):
    """More than 255, of a body of some 65 segments: nothing could read the file."""
    movement = made_up("gavrila22")
    (person,) = movement.scene.persons
    extra = [replace(person.body.landmarks[k % 10], name=f"mark_{k}") for k in range(250)]
    body = replace(person.body, landmarks=(*person.body.landmarks, *extra))
    many = replace(movement, scene=replace(movement.scene, persons=(replace(person, body=body),)))
    names, places = truth(many)
    read = ezc3d.c3d(str(many.record(C3d(), tmp_path)[0]))
    point = read["parameters"]["POINT"]
    assert point["LABELS"]["value"] + point["LABELS2"]["value"] == names
    assert len(names) > 255
    found = read["data"]["points"][:3].transpose(2, 1, 0) / 1000
    np.testing.assert_allclose(found[FOUND], places[FOUND], atol=HUNDREDTH_MM)


def test_doubt_is_told_by_the_reliabilities(tmp_path):
    movement = made_up("gavrila22")
    sure, limb, all_of_it = (movement.steps[t].estimates[0] for t in (0, 1, 2))
    doubted = (sure, in_doubt(limb, "left_arm"), in_doubt(all_of_it, whole=True))
    steps = [replace(step, estimates=(one,)) for step, one in zip(movement.steps, doubted, strict=False)]
    shares = motion_of(replace(movement, steps=steps)).shares
    arm = movement.scene.persons[0].body.parts_of("left_arm")
    assert np.nanmin(shares[0]) == 0.75
    np.testing.assert_array_equal(shares[1] == 0, arm)
    assert (shares[2] == 0).all()


def test_sigmas_are_those_of_the_poses():
    """Against finite differences of the markers: sigma of each parameter 1/1024 rad or m, independent."""
    motion = motion_of(made_up("human"))
    markers = markers_of(motion.body)
    q, step = motion.q[0], 1e-6
    moved = motion.points(q + step * np.eye(motion.body.dof), markers) - motion.points(
        q - step * np.eye(len(q)), markers
    )
    wanted = SIGMA * np.sqrt(((moved / (2 * step)) ** 2).sum(axis=(0, 2)))
    np.testing.assert_allclose(motion.sigmas(markers)[0], wanted, rtol=1e-6)


def test_without_ezc3d_the_package_to_install_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(ConfigError, match="pip install ezc3d"):
        C3d().begin(made_up("gavrila22").context(tmp_path))
