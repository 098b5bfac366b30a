"""Simulated recordings: the truth on disk is what the pictures show."""

from __future__ import annotations

import csv
import importlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from recordings import small_simulation

from tracker.bodies.body.description import load_body
from tracker.cameras.camera import Camera
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.errors import ConfigError
from tracker.foundation.resources import model_path
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.filming import plan
from tracker.synthesis.simulation.movements import poses_of
from tracker.synthesis.simulation.rendering import draw_persons, mesh_of
from tracker.synthesis.simulation.room import default_rig
from tracker.synthesis.simulation.sequence import Recipe, Simulation, simulate, write_sequence

TIMES = np.arange(0, 4, 0.02)


MODELS = {name: load_body(model_path(name)) for name in ("gavrila22", "human", "quadruped")}


@pytest.mark.parametrize(
    ("model", "movement"), [(name, one) for name, body in MODELS.items() for one in body.movements]
)
def test_movements_are_smooth_within_the_limits_and_stand_on_the_floor(model, movement):
    body = MODELS[model]
    poses = poses_of(movement, body, TIMES, heading_deg=30.0, place=(0.4, -0.2))
    low, high = body.limits.T
    assert ((poses >= low - 1e-12) & (poses <= high + 1e-12)).all()
    speed = np.abs(np.diff(poses, axis=0)) / 0.02
    assert np.degrees(speed[:, body.rotates]).max() < 420
    assert speed[:, ~body.rotates].max() < 2.0
    eta, omega = np.linspace(-np.pi / 2, np.pi / 2, 41)[:, None], np.linspace(-np.pi, np.pi, 61)[None]
    for q in poses[::20]:
        placed = body.world_from_part(q)
        heights = [
            (part.shape.surface(eta, omega)[0] @ placed[p, 2, :3]).min() + placed[p, 2, 3]
            for p, part in enumerate(body.parts)
        ]
        assert min(heights) == pytest.approx(0, abs=2e-3)


def test_a_squat_keeps_its_feet():
    body = MODELS["gavrila22"]
    marks = [body.landmark_names.index(f"{side}_ankle") for side in ("left", "right")]
    feet = body.landmarks_in_world(poses_of("squat", body, TIMES))[:, marks, :2].mean(axis=1)
    assert np.linalg.norm(feet - feet[0], axis=1).max() < 1e-9


def test_an_unknown_movement_names_the_nearest():
    with pytest.raises(ConfigError, match='no movement "sqat" of model "gavrila22"; did you mean "squat"'):
        simulate(Recipe("sqat"))


def test_a_recording_has_a_frame_at_least():
    too_short = Recipe("squat", seconds=0.2, fps=2.0)
    with pytest.raises(ConfigError, match=r"0\.2 s at 2 frames per second: no frame, expected 0\.5 s or more"):
        simulate(too_short)
    with pytest.raises(ConfigError, match="no frame"):
        plan(too_short, default_rig())
    assert Recipe("squat", seconds=0.5, fps=2.0).times.tolist() == [0.0]


def test_pictures_and_masks_agree_with_the_tracer():
    """Rasterizer and contour tracer share no code but the surface: outlines meet to a pixel."""
    simulation = simulate(Recipe("walking_on_the_spot", seconds=0.6))
    scene = simulation.scene.with_pose(0, simulation.poses[0][12])
    contours, silhouettes = CpuSynthesis(step_px=4.0).contours(scene), CpuSynthesis().silhouettes(scene)
    meshes = (mesh_of(scene.persons[0]),)
    for v, camera in enumerate(scene.rig.cameras):
        _, mask = draw_persons(simulation.plates[v].picture, camera, scene, meshes)
        overlap = np.count_nonzero(mask & silhouettes[v]) / np.count_nonzero(mask | silhouettes[v])
        # of a pixel's four samples two count as half: the mask reaches a quarter of a pixel beyond the outline
        assert overlap > 0.975
        assert np.count_nonzero(silhouettes[v] & ~mask) < 5
        inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
        outside = cv2.distanceTransform(1 - mask.astype(np.uint8), cv2.DIST_L2, 5)
        view = contours.of(v)
        columns, rows = np.round(view.pixels).astype(int).T
        # No contour lies off the person, and the whole outline is covered by contours.
        assert outside[rows, columns].max() < 1.5
        outline = np.argwhere((inside > 0) & (inside <= 1.0))[:, ::-1]
        gaps = np.linalg.norm(outline[:, None] - view.pixels[None], axis=2).min(axis=1)
        assert np.percentile(gaps, 99) < 4.0


@pytest.mark.parametrize("lens", [0.0, -0.3])
def test_who_is_partly_behind_the_camera_or_outside_its_lens_is_drawn_all_the_same(lens):
    """Beyond 46 degrees the second camera's lens images nothing; the second person is behind the first camera."""
    simulation = simulate(Recipe("arm_swing", seconds=0.04, persons=2, size=(32, 24)))
    scene, meshes, plate = simulation.scene, simulation.meshes(), np.full((288, 360, 3), 128, np.uint8)
    before, behind = (scene.persons[k].body.landmarks_in_world(simulation.poses[k][0]).mean(axis=0) for k in (0, 1))
    away = (before - behind) / np.linalg.norm(before - behind)
    place = before - away * (0.8 if lens == 0 else 1.3)
    camera = replace(
        Camera.looking_at("A", (360, 288), 200, tuple(place), before), distortion=np.array([lens, 0, 0, 0])
    )
    alone = draw_persons(plate, camera, replace(scene, persons=scene.persons[:1]), meshes[:1])[1]
    _, mask = draw_persons(plate, camera, scene, meshes)
    np.testing.assert_array_equal(mask, alone)
    body, q = scene.persons[0].body, simulation.poses[0][0]
    chest = body.landmark_names.index("neck")
    column, row = np.round(camera.project(body.landmarks_in_world(q)[chest] - (0, 0, 0.2))).astype(int)
    assert mask[row, column]


def test_the_same_seed_gives_the_same_pictures():
    first, again, other = (next(small_simulation(seed=seed).frames()).images for seed in (1, 1, 2))
    for a, b, c in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(a, b)
        assert (a != c).any()


def test_an_open_shutter_gathers_what_happens_meanwhile():
    """The frames of eight cameras in a row, each an eighth of the exposure long, add up to the picture."""
    still = {"noise_grey": 0.0, "blur_px": 0.0, "size": (320, 256), "movement": "arm_swing"}
    fast = simulate(Recipe(seconds=0.8, fps=400.0, **still))
    every = fast.poses[0][::16][7:10]
    exposed = Simulation(Recipe(seconds=0.12, fps=25.0, exposure_s=0.04, **still), fast.scene, (every,), fast.plates)
    found = list(exposed.frames())
    # poses go evenly from one frame to the next
    moments = 1 + (np.arange(8) + 0.5) / 8 - 0.5
    between = np.array([np.interp(moments, np.arange(len(every)), values) for values in every.T]).T
    many = Simulation(Recipe(seconds=8 / 400, fps=400.0, **still), fast.scene, (between,), fast.plates)
    wanted = np.mean([frame.images for frame in many.frames()], axis=0)
    assert np.abs(np.array(found[1].images) - wanted).max() <= 0.5
    sharp = Simulation(replace(exposed.recipe, exposure_s=0.0), fast.scene, (every,), fast.plates)
    assert np.abs(np.array(found[1].images) - np.array(list(sharp.frames())[1].images, dtype=float)).max() > 50


def test_a_view_that_is_a_frame_late_shows_the_next_one():
    in_step = Recipe("arm_swing", seconds=0.16, size=(160, 128), noise_grey=0.0)
    expected = list(simulate(in_step).frames())
    for t, frame in enumerate(simulate(replace(in_step, delays_s=(0.0, 0.04, 0.0, 0.02))).frames()):
        np.testing.assert_array_equal(frame.images[0], expected[t].images[0])
        np.testing.assert_array_equal(frame.images[1], expected[min(t + 1, 3)].images[1])
        between = np.array([(one != expected[t].images[3]).any() for one in (frame.images[3], expected[t].images[3])])
        assert between.tolist() == [t < 3, False]


def test_a_view_that_repeats_a_frame_is_one_behind_from_there_on():
    in_step = Recipe("arm_swing", seconds=0.2, size=(160, 128), noise_grey=0.0)
    expected = list(simulate(in_step).frames())
    behind = replace(in_step, repeats_from=(None, 2, None, None))
    for t, frame in enumerate(simulate(behind).frames()):
        for v in range(4):
            shown = expected[t - (v == 1 and t >= 2)]
            np.testing.assert_array_equal(frame.images[v], shown.images[v])


def test_half_the_light_is_half_as_bright_and_as_noisy():
    usual = Recipe("arm_swing", seconds=0.04, size=(160, 128), noise_grey=0.0)
    for noise in (0.0, 5.0):
        bright, dark = (
            np.array(next(simulate(replace(usual, noise_grey=noise, light=light)).frames()).images, dtype=float)
            for light in (1.0, 0.5)
        )
        # the same noise, for the seed is the same
        assert np.abs(dark - bright / 2).mean() < 0.6 + noise / 2
        assert abs(dark.mean() / bright.mean() - 0.5) < 0.01


def test_clothes_of_one_colour_have_no_seams():
    person = simulate(Recipe(seconds=0.04, size=(32, 24))).scene.persons[0]
    worn = [{tuple(np.round(colour / colour.max(), 1)) for colour in mesh_of(person, k).colours} for k in (0, 2)]
    # skin, hair, and what is worn
    assert len(worn[0]) > len(worn[1]) == 3


def test_a_recording_on_disk_holds_its_truth(tmp_path):
    recipe = Recipe("turn", seconds=0.12, size=(320, 256))
    config = write_sequence(recipe, tmp_path / "sequence")
    folder = config.parent
    simulation = simulate(recipe)
    rig = load_rig(folder / "rig.toml")
    for mine, theirs in zip(rig.cameras, simulation.scene.rig.cameras, strict=True):
        np.testing.assert_allclose(mine.camera_from_world, theirs.camera_from_world, atol=1e-9)
    body = load_body(folder / "model.toml")
    with (folder / "truth_poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    poses = [[float(row[p.column]) * (np.pi / 180 if p.rotates else 1) for p in body.parameters] for row in rows]
    np.testing.assert_allclose(poses, simulation.poses[0], atol=1e-6)
    with (folder / "truth_joints.csv").open() as file:
        joints = [[float(row[axis]) for axis in ("x_m", "y_m", "z_m")] for row in csv.DictReader(file)]
    expected = body.landmarks_in_world(simulation.poses[0]).reshape(-1, 3)
    np.testing.assert_allclose(joints, expected, atol=1e-6)
    with pytest.raises(ConfigError, match="not empty"):
        write_sequence(recipe, folder)


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "scripts")
    (tmp_path / "file [a]").touch()
    with pytest.raises(typer.Exit):
        importlib.import_module("simulate_sequence").main(output=tmp_path / "file [a]" / "sequence")
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert "file [a]" in told  # rich would take it for a style


def test_nothing_is_left_of_a_recording_that_fails(tmp_path):
    def stop(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        write_sequence(Recipe(seconds=0.08, size=(320, 256)), tmp_path / "sequence", stop)
    assert list(tmp_path.iterdir()) == []
