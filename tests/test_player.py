"""The report's player: what it holds, and that a browser shows and scrubs it without a network."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
from dataclasses import replace

import av
import cv2
import numpy as np
import pytest
from browser import PROGRAM, browser
from doubted import in_doubt
from motions import LOST, N_FRAMES, made_up
from recordings import TrueStart, cycle_for, small_simulation
from rig_samples import FISHEYE

from tracker.cameras.rig import Rig
from tracker.results.recording import RunContext
from tracker.results.recording._motion import Motions
from tracker.results.recording._player import Preview, windows_of
from tracker.results.recording.report import Report
from tracker.tracking.estimate import Status
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.sequence import track


@pytest.fixture(scope="module")
def recorded(limbs_stay):
    """Eight frames of a simulated recording; the third lost, an arm ambiguous in the fifth, the head in the sixth."""
    simulation = small_simulation(n_frames=8)
    steps = list(
        track(
            simulation.frames(),
            simulation.scene,
            cycle_for(simulation, TrueStart(simulation), estimation=TwistIcpEstimation()),
        )
    )
    steps[2] = replace(steps[2], estimates=(replace(steps[2].estimates[0], status=Status.LOST),))
    steps[4] = replace(steps[4], estimates=(in_doubt(steps[4].estimates[0], "left_arm"),))
    steps[5] = replace(steps[5], estimates=(in_doubt(steps[5].estimates[0], "head"),))
    return simulation.scene, steps


def reported(scene, steps, folder, **settings):
    """The page, and where it lies."""
    context = RunContext("test", folder, scene, fps=25.0, interval_s=0.04, n_frames=len(steps))
    recorder = Report(**settings).begin(context)
    for step in steps:
        recorder.write(step)
    (path,) = recorder.finish()
    return path.read_text(), path


def held(page, name):
    return re.search(rf'id="player-{name}">(.*?)</script>', page, re.DOTALL)[1]


def array(text, dtype):
    return np.frombuffer(gzip.decompress(base64.b64decode(text)), dtype)


@pytest.mark.parametrize("models", [("human",), ("gavrila22", "quadruped")])
def test_the_placed_meshes_are_the_bodies(models, tmp_path):
    """Vertices moved by their segments lie on the parts' surfaces, where the exports have them."""
    movement = made_up(*models)
    page, _ = reported(movement.scene, movement.steps, tmp_path)
    scene = json.loads(held(page, "scene"))
    assert scene["frames"] == list(range(10, 10 + N_FRAMES))
    motions = Motions(movement.context(tmp_path))
    for step in movement.steps:
        motions.add(step)
    for person, motion in zip(scene["persons"], motions.all(), strict=True):
        n_segments = len(motion.body.segments)
        points, mine = array(person["points"], "<f4").reshape(-1, 3), array(person["parts_of_points"], "u1")
        bones = np.array(person["segments_of_parts"])[mine]
        placed = array(person["placed"], "<f4").reshape(N_FRAMES, n_segments, 7)
        known = array(person["known"], "u1").reshape(N_FRAMES, len(motion.body.parts))
        assert (known == np.where(motion.lost, 2, 0)[:, None]).all()
        x, y, z, w = np.moveaxis(placed[..., 3:].astype(float), -1, 0)
        turns = np.stack(
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
             2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
             2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=-1
        ).reshape(N_FRAMES, n_segments, 3, 3)  # fmt: skip
        t = N_FRAMES - 1
        world = (turns[t, bones] @ points[..., None])[..., 0] + placed[t, bones, :3]
        parts = motion.body.world_from_part(motion.q[t])
        assert set(mine) == set(range(len(motion.body.parts)))
        for p, part in enumerate(motion.body.parts):
            local = (world[mine == p] - parts[p, :3, 3]) @ parts[p, :3, :3]
            np.testing.assert_allclose(part.shape.inside_outside(local), 1, atol=2e-3)
    assert list(np.flatnonzero(known[:, 0] == 2)) == (list(range(LOST.start, LOST.stop)) if len(models) == 1 else [])


def test_doubts_are_on_their_parts(recorded, tmp_path):
    scene, steps = recorded
    page, _ = reported(scene, steps, tmp_path)
    (person,) = json.loads(held(page, "scene"))["persons"]
    known = array(person["known"], "u1").reshape(8, -1)
    assert (known[2] == 2).all()
    doubted = [{name for name, state in zip(person["parts"], known[k], strict=True) if state} for k in (4, 5)]
    assert doubted == [{"left_upper_arm", "left_forearm", "left_hand"}, {"head"}]
    assert not known[[0, 1, 3]].any()


def test_the_cameras_spread_over_their_images(recorded, tmp_path):
    """The sheets at a metre are imaged on a grid over the image, through a bent lens as well."""
    scene, steps = recorded
    bent = replace(scene.rig.cameras[0], distortion=np.array(FISHEYE))
    scene = replace(scene, rig=Rig((bent, *scene.rig.cameras[1:])))
    told = json.loads(held(reported(scene, steps, tmp_path)[0], "scene"))["cameras"]
    for camera, one in zip(scene.rig.cameras, told, strict=True):
        sheet = np.array(one["sheet"])
        n = len(sheet)
        assert n == (17 if camera is bent else 2)
        points = np.dstack([sheet, np.ones((n, n, 2))]) @ np.array(one["world_from_camera"]).T
        sides = [np.linspace(-0.5, side - 0.5, n) for side in camera.size]
        np.testing.assert_allclose(camera.project(points[..., :3]), np.dstack(np.meshgrid(*sides)), atol=0.02)


@pytest.mark.parametrize(
    "sizes", [[(360, 288)] * 4, [(360, 288)] * 3, [(288, 360)] * 4, [(640, 480), (480, 640)], [(9, 7)]]
)
def test_the_windows_of_the_views_lie_apart_in_the_picture(sizes):
    windows, (width, height) = windows_of(sizes, 640)
    assert (width % 2, height % 2) == (0, 0)
    covered = np.zeros((height, width), int)
    for (left, top, right, bottom), (w, h) in zip(windows * [width, height, width, height], sizes, strict=True):
        assert (right - left) / (bottom - top) == pytest.approx(w / h, rel=0.1 if w > 9 else 0.2)
        covered[round(top) : round(bottom), round(left) : round(right)] += 1
    assert covered.max() == 1
    assert windows.min() >= 0
    assert windows.max() <= 1


def test_the_preview_shows_each_view_in_its_window(recorded):
    scene, steps = recorded
    preview = Preview(RunContext("test", None, scene, 25.0, 0.04, 8))
    for step in steps:
        preview.add(step)
    drawn = preview.drawn(steps[0])
    with av.open(io.BytesIO(preview.finish())) as video:
        frames = [frame.to_ndarray(format="bgr24") for frame in video.decode(video=0)]
    assert len(frames) == 8
    assert np.abs(frames[0].astype(int) - drawn).mean() < 6
    height, width = drawn.shape[:2]
    for v, (left, top, right, bottom) in enumerate(
        np.round(preview.windows * [width, height, width, height]).astype(int)
    ):
        window = drawn[top:bottom, left:right]
        image = cv2.resize(steps[0].frame.images[v], (right - left, bottom - top))
        assert np.median(np.abs(window.astype(int) - image)) <= 1


def test_a_page_of_1000_frames_is_smaller_than_3_mb(recorded, tmp_path):
    scene, steps = recorded
    found = [step for k, step in enumerate(steps) if k != 2]
    many = [
        replace(found[k % 7], frame=replace(found[k % 7].frame, index=k, time_s=0.04 * k), start=None)
        for k in range(1000)
    ]
    page, _ = reported(scene, many, tmp_path)
    assert len(json.loads(held(page, "scene"))["frames"]) == 1000
    assert len(page) < 3e6
    page, _ = reported(scene, many[:100], tmp_path, player_frames=30)
    told = json.loads(held(page, "scene"))
    assert told["frames"] == list(range(0, 100, 4))
    assert told["interval"] == pytest.approx(0.16)


def test_the_worst_frames_come_first(recorded, tmp_path):
    scene, steps = recorded
    spread = [replace(s, frame=replace(s.frame, time_s=float(k))) for k, s in enumerate(steps)]
    page, _ = reported(scene, spread, tmp_path)
    assert re.findall(r'data-seek="([\d.]+)"', page)[:2] == ["2.0000", "4.0000"]
    table = page[page.index("Worst frames") :]
    assert table.index("lost") < table.index("left arm")
    page, _ = reported(scene, steps, tmp_path)  # all within 0.3 s: one entry, and one that is 0.25 s away
    assert len(re.findall("data-seek", page)) <= 2


def test_a_report_without_a_player_holds_none(recorded, tmp_path):
    page, _ = reported(*recorded, tmp_path, player=False)
    assert "<script" not in page
    assert "player-stage" in page.split("</style>")[0]  # styles only


@pytest.mark.skipif(PROGRAM is None, reason="no Chromium (apt-get install chromium)")
@pytest.mark.parametrize("images", [True, False])
def test_a_browser_plays_and_scrubs_the_file(recorded, tmp_path, images):
    scene, steps = recorded
    if not images:
        steps = [replace(step, frame=replace(step.frame, images=(None,) * len(scene.rig))) for step in steps]
    _, path = reported(scene, steps, tmp_path)
    player = "document.getElementById('player')"
    with browser(tmp_path / "profile") as page:
        page.open(f"{path.as_uri()}#t=0.12")
        assert page.wait(f"({player}?.dataset.state ?? 'loading') != 'loading' && {player}.dataset.state") == "ready"
        assert page.value(f"{player}.dataset.frame") == "3"
        assert page.wait(f"{player}.dataset.video") == "shown"
        bright = (
            "(() => { const c = document.querySelector('#player-stage canvas'), d = document.createElement('canvas');"
            "d.width = c.width; d.height = c.height; const x = d.getContext('2d'); x.drawImage(c, 0, 0);"
            "const p = x.getImageData(0, 0, d.width, d.height).data; let n = 0;"
            "for (let i = 0; i < p.length; i += 4) n += p[i + 2] - p[i] > 30; return n / p.length * 4; })()"
        )
        assert 0.005 < page.wait(bright) < 0.5  # the blue body
        page.value("document.querySelector('[data-seek=\"0.0800\"]').click()")
        assert page.value(f"{player}.dataset.frame") == "2"
        assert page.value("document.getElementById('player-label').textContent") == "0.08 s (frame 2)"
        page.wait("!document.getElementById('player-video').seeking")
        assert page.value("Math.floor(document.getElementById('player-video').currentTime * 25)") == 2
        page.value(
            "document.getElementById('player-from').value = 1, document.getElementById('player-from').onchange()"
        )
        page.value("document.getElementById('player-toggle').click()")
        page.wait(f"{player}.dataset.frame == '7'")
        page.wait("document.getElementById('player-toggle').textContent == 'play'")
        assert page.errors == []
