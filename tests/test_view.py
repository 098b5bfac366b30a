"""`bodytrack view`: what the scene holds, on this machine only, until Ctrl-C."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import PROGRAM, browser
from doubted import in_doubt
from motions import LOST, MODELS, N_FRAMES, made_up
from staged import Server
from typer.testing import CliRunner

from tracker.bodies.body.surface import segments_in_world
from tracker.bodies.subject import Subject
from tracker.cameras.frame import Frame
from tracker.foundation.errors import ConfigError
from tracker.results.result import load_result
from tracker.running.cli import app
from tracker.running.jobs import execute, load_job
from tracker.running.programs import load_run
from tracker.running.viewing.images import Pictures
from tracker.running.viewing.stage import BLUE, ORANGE, RED, Stage, colours_of_doubt, serving
from tracker.running.viewing.viewer import LiveRun, Viewer, _strip, view_result
from tracker.synthesis.simulation.sequence import Recipe, write_sequence


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A configuration of six simulated frames, and its result."""
    folder = tmp_path_factory.mktemp("view")
    config = write_sequence(Recipe("arm_swing", seconds=0.24, size=(360, 288)), folder / "sequence")
    start = ["initialization.use=given", "initialization.poses=truth_poses.csv", 'recordings=["run_json","journal"]']
    execute(load_job("track", config, start), folder / "result")
    return folder


def test_every_part_of_a_body_stands_where_it_was_found(tmp_path):
    movement = made_up("human", "quadruped")
    server = Server()
    stage = Stage(server, movement.scene)
    step = movement.steps[0]
    stage.show(step.estimates)
    for person, estimate in zip(movement.scene.persons, step.estimates, strict=True):
        placed = segments_in_world(person.body, estimate.q)
        turned = person.body.world_from_part(estimate.q)
        for p, (part, k) in enumerate(zip(person.body.parts, person.body.segments_of_parts, strict=True)):
            mesh = server.nodes[f"/persons/{person.name}/{part.name}"]
            np.testing.assert_allclose(mesh.position, placed[k, :3, 3])
            w, *v = mesh.wxyz
            corners = mesh.arguments[0] + 2 * np.cross(v, np.cross(v, mesh.arguments[0]) + w * mesh.arguments[0])
            local = (corners + mesh.position - turned[p, :3, 3]) @ turned[p, :3, :3]
            np.testing.assert_allclose(part.shape.inside_outside(local), 1, atol=2e-3)
            assert mesh.visible
    stage.show(movement.steps[LOST.start].estimates)
    seen = [node.visible for name, node in server.nodes.items() if name.startswith("/persons/person1")]
    assert not any(seen)


def orange_parts(person, estimate):
    return {
        p.name
        for p, colour in zip(person.body.parts, colours_of_doubt(person, estimate), strict=True)
        if colour == ORANGE
    }


def test_what_is_unsure_is_orange():
    movement = made_up("human")
    person, estimate = movement.scene.persons[0], movement.steps[0].estimates[0]
    assert set(colours_of_doubt(person, estimate)) == {BLUE}
    arm = {"left_shoulder", "left_upper_arm", "left_forearm", "left_hand"}
    assert orange_parts(person, in_doubt(estimate, "left_arm")) == arm
    assert set(colours_of_doubt(person, in_doubt(estimate, whole=True))) == {ORANGE}


def test_a_head_that_the_trunk_carries_is_orange_without_it():
    movement = made_up("gavrila22")
    person, estimate = movement.scene.persons[0], movement.steps[0].estimates[0]
    assert orange_parts(person, in_doubt(estimate, "head")) == {"head"}
    mixed = orange_parts(person, in_doubt(estimate, "head", "left_arm"))
    assert mixed == {"head", "left_upper_arm", "left_forearm", "left_hand"}


def test_a_single_lost_frame_among_thousands_is_seen_in_the_strip():
    movement = made_up("gavrila22")
    viewer = Viewer(Server(), movement.scene, 0.04, 3000)
    for k in range(3000):
        step = movement.steps[LOST.start if k == 1234 else 0]
        viewer.add(replace(step, frame=Frame(k, 0.04 * k, (None, None))))
    strip = _strip(viewer._frames, movement.scene)
    assert (strip == RED).all(axis=2).any(axis=0).sum() == 1
    viewer.tell_doubts()
    worst = viewer._server.nodes["worst frames"]
    assert worst.options[1] == "49.360 s: person1 lost"
    worst.value = worst.options[1]
    worst.on[0](None)
    viewer.draw()
    assert viewer.shown == 1234


def test_bodies_that_the_run_has_fitted_are_drawn():
    """A viewer begins with the models; the frames of the run come with the bodies that they were tracked with."""
    movement, server = made_up("human"), Server()
    viewer = Viewer(server, movement.scene, 0.04, N_FRAMES)
    as_modelled = np.array(server.nodes["/persons/person1/left_thigh"].arguments[0])
    fitted = Subject(model=MODELS / "human.toml", stature_m=1.5).description().build()
    step = movement.steps[0]
    viewer.add(replace(step, scene=step.scene.with_bodies({0: fitted})))
    viewer.draw()
    thigh = server.nodes["/persons/person1/left_thigh"]
    assert np.ptp(thigh.arguments[0][:, 2]) < 0.95 * np.ptp(as_modelled[:, 2])
    assert thigh.visible
    names = [segment.name for segment in fitted.segments]
    where = segments_in_world(fitted, step.estimates[0].q)[names.index("left_thigh"), :3, 3]
    np.testing.assert_allclose(thigh.position, where)


def test_images_are_straight_and_centred():
    """A point in space is seen in a kept image where a pinhole camera with a centred principal point has it."""
    rig = made_up("gavrila22").scene.rig
    camera = rig.cameras[0]
    image = np.zeros((720, 1280, 3), np.uint8)
    point = np.array([0.1, -0.6, 0.5])
    u, v = np.round(camera.project(point)).astype(int)
    image[v - 8 : v + 9, u - 8 : u + 9] = 255
    pictures = Pictures(rig, 10)
    pictures.add(Frame(3, 0.12, (image, None)))
    kept, missing = pictures.of(3)
    assert missing is None
    assert kept.shape == (225, 400, 3)
    weights = kept[..., 0].astype(float)
    found = [(weights.sum(axis=k) * np.arange(weights.shape[1 - k])).sum() / weights.sum() for k in (0, 1)]
    plain = replace(camera, distortion=np.zeros(5)).in_camera(point)
    f = np.diag(camera.matrix)[:2] * 400 / 1280
    np.testing.assert_allclose(found, f * plain[:2] / plain[2] + [199.5, 112], atol=0.5)
    assert pictures.of(4) is None


def test_who_stops_reading_has_stopped():
    """A thread that still reads while Python ends complains on the terminal: `stop` waits for it."""
    taken, go_on = [], threading.Event()

    def frames():
        for index in range(1000):
            taken.append(index)
            go_on.wait(10)
            yield Frame(index, index / 25, (None,))

    pictures = Pictures(made_up("gavrila22").scene.rig, 1000)
    pictures.read(frames())
    threading.Timer(0.2, go_on.set).start()
    pictures.stop()
    assert go_on.is_set()
    assert len(taken) <= 2


def test_a_finished_result_is_served_on_this_machine_only(tracked):
    result = load_result(tracked / "result")
    with serving(18080) as server:
        assert server.get_host() == "127.0.0.1"
        viewer, fault = view_result(result, server)
        assert fault == ""
        viewer.seek(4)
        end = time.monotonic() + 120
        while viewer.pictures.n_kept < 6 and time.monotonic() < end:
            viewer.serve(0.05)
        viewer.serve(0.1)
        assert viewer.shown == result.frames[4]
        assert viewer.pictures.of(int(result.frames[4]))[0].shape == (320, 400, 3)
        page = urllib.request.urlopen(f"http://127.0.0.1:{server.get_port()}", timeout=10).read()
        assert b"<html" in page
        viewer.pictures.stop()


def test_a_result_without_its_recording_is_shown_without_images(tmp_path):
    movement = made_up("gavrila22")
    with serving(18090) as server:
        viewer, fault = view_result(load_result(movement.result(tmp_path / "out")), server)
        assert "config.toml" in fault
        viewer.serve(0.05)
        assert viewer.shown == 10
        assert viewer.n_frames == N_FRAMES


def test_a_run_is_looked_at_while_it_tracks(tracked):
    start = ["initialization.use=given", "initialization.poses=truth_poses.csv"]
    run, told = load_run(tracked / "sequence" / "config.toml", start), []
    with serving(18100) as server:
        live = LiveRun(run, server, lambda what, done=0, total=0, detail="": told.append((what, done, total)))
        while not live.done.is_set():
            live.viewer.serve(0.05)
        live.viewer.serve(0.05)
        assert live.fault is None
        assert told[-1] == ("tracking", 6, 6)
        assert live.viewer.shown == 5  # it follows
        assert live.viewer.pictures.n_kept == 6
        live.close()


def test_ctrl_c_ends_it(tracked):
    command = [sys.executable, "-m", "tracker", "view", str(tracked / "result"), "--port", "18110"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # a shell that runs the tests in the background has its children ignore Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    line = process.stdout.readline()
    assert re.fullmatch(r"look at http://127\.0\.0\.1:\d+; Ctrl-C ends it\n", line), line
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=120)
    assert told == ""
    assert process.returncode == 0


def test_without_viser_the_package_to_install_is_named(tracked, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    told = CliRunner().invoke(app, ["view", str(tracked / "result")])
    assert isinstance(told.exception, ConfigError)
    assert str(told.exception).endswith("pip install viser")


def test_settings_of_a_result_are_not_changed(tracked):
    told = CliRunner().invoke(app, ["view", str(tracked / "result"), "--set", "estimation.step_deg=3"])
    assert isinstance(told.exception, ConfigError)
    assert "is a result" in str(told.exception)


@pytest.mark.skipif(PROGRAM is None, reason="no Chromium (apt-get install chromium)")
def test_a_browser_shows_the_scene(tracked, tmp_path):
    with serving(18120) as server, browser(tmp_path / "profile") as page:
        viewer, _ = view_result(load_result(tracked / "result"), server)
        page.open(f"http://127.0.0.1:{server.get_port()}")
        end = time.monotonic() + 120
        while not page.value("document.body.innerText.includes('person1')") and time.monotonic() < end:
            viewer.serve(0.1)
        viewer.serve(1.0)
        text = page.value("document.body.innerText")
        assert "tracked" in text or "bootstrapped" in text
        assert page.value("document.querySelectorAll('canvas').length") > 0
        page.picture(tmp_path / "view.png")
        assert page.errors == []
