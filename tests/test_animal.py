"""An animal from its model file alone: simulated, bootstrapped along its lying axis, tracked, reported, evaluated."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from recordings import cycle_for, joint_errors_mm, small_simulation
from typer.testing import CliRunner

from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person
from tracker.foundation.resources import model_path
from tracker.running.cli import app
from tracker.running.jobs import execute, load_job
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.initialization._persons import Found
from tracker.tracking.initialization._placement import placements, stands_upright, without_legs
from tracker.tracking.initialization._visual_hull import TorsoAxis

SIZE, PIXEL_MM = (540, 432), 8.3
"""Pictures with lower legs nine pixels wide, and a pixel at the animal; in smaller ones blur joins a leg's edges."""

HINGE_DEG = 2 * np.degrees(PIXEL_MM * np.sqrt(1 / 12) * np.sqrt(1 + 4 + 1) / 300)
"""Three joints, each uniformly off within a pixel, at both ends of two bones of 0.3 m: twice the RMS."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a trot."""
    folder = tmp_path_factory.mktemp("animal") / "trot"
    write_sequence(Recipe(model="quadruped", seconds=0.24, size=SIZE), folder)
    return folder


def test_an_animal_needs_no_setting_outside_its_file(recording: Path, tmp_path: Path) -> None:
    """Bootstrapped, tracked and evaluated.

    An error that is uniform within a pixel in each of three directions has an RMS of sqrt(3 / 12) pixels.
    """
    result = execute(
        load_job("track", recording / "config.toml", ["recordings.overlay=false"]), tmp_path / "result"
    ).folder
    with (result / "poses.csv").open() as file:
        statuses = [row["status"] for row in csv.DictReader(file)]
    assert statuses == ["bootstrapped", *["tracked"] * 5]
    told = CliRunner().invoke(app, ["result", "evaluate", str(result), "--truth", str(recording)])
    assert told.exit_code == 0, told.output
    assert "hind left knee" in told.output
    person = json.loads((result / "evaluation.json").read_text())["persons"][0]
    animal = load_body(model_path("quadruped"))
    assert set(person["joints_mm"]) == set(animal.joints.evaluated)
    assert set(person["hinges_deg"]) == set(animal.joints.hinges)
    assert person["mean_mm"] < PIXEL_MM * np.sqrt(3 / 12)
    # the nose hangs on trunk, neck and head, whose errors add up
    assert person["p95_mm"] < 3 * PIXEL_MM * np.sqrt(3 / 12)
    assert max(raw for raw, _ in person["hinges_deg"].values()) < HINGE_DEG
    assert "trot" in (result / "report.html").read_text()
    assert (result / "parameters.png").stat().st_size > 0


@pytest.mark.parametrize("heading_deg", [35.0, 170.0])
def test_an_animal_is_found_whichever_way_it_faces(heading_deg: float) -> None:
    simulation = small_simulation("bow", n_frames=1, model="quadruped", heading_deg=heading_deg, size=SIZE)
    start = cycle_for(simulation).initialization.start(
        next(simulation.frames()), simulation.scene, cycle_for(simulation).stages
    )
    assert joint_errors_mm(simulation, 0, 0, start.poses[0]).mean() < 1.5 * PIXEL_MM
    assert start.evidence[0][0] is not None


@pytest.mark.parametrize("model", ["gavrila22", "human"])
def test_persons_stand_and_animals_lie(model: str) -> None:
    assert stands_upright(load_body(model_path(model)))
    assert not stands_upright(load_body(model_path("quadruped")))


def test_a_lying_body_is_laid_along_its_axis_both_ways_without_roll() -> None:
    animal = load_body(model_path("quadruped"))
    direction = np.array([np.cos(2.0) * np.cos(0.2), np.sin(2.0) * np.cos(0.2), np.sin(0.2)])
    middle = np.array([[0.3, -0.4, 0.7]])
    for sign, q in zip((1, -1), placements(animal, TorsoAxis(middle[0], direction), middle), strict=True):
        marks = dict(zip(animal.landmark_names, animal.landmarks_in_world(q), strict=True))
        along = marks["withers"] - marks["hips"]
        np.testing.assert_allclose(along / np.linalg.norm(along), sign * direction, atol=1e-4)
        assert abs((marks["front_left_shoulder"] - marks["front_right_shoulder"])[2]) < 1e-3
        assert np.linalg.norm((marks["withers"] + marks["hips"]) / 2 - middle[0]) < 0.2


def test_the_axis_of_an_animal_is_that_of_what_its_legs_carry() -> None:
    simulation = small_simulation("", n_frames=1, model="quadruped")
    animal: Person = simulation.scene.persons[0]
    rng = np.random.default_rng(0)
    placed = animal.body.world_from_part(animal.q)
    within = rng.uniform(-0.5, 0.5, (200, 3)) * animal.body.shapes[:, None, :3]
    points = (np.einsum("pij,pnj->pni", placed[:, :3, :3], within) + placed[:, None, :3, 3]).reshape(-1, 3)
    found = Found(points, (None,) * len(simulation.scene.rig))
    kept = without_legs(found, animal.body, simulation.scene.rig).points
    assert 0 < len(kept) < len(points)
    assert kept[:, 2].min() > 0.25
    lower = [k for k, part in enumerate(animal.body.parts) if part.name.endswith("lower")]
    assert len(kept) >= len(points) * (1 - len(lower) / len(animal.body.parts)) * 0.8
    assert without_legs(found, load_body(model_path("human")), simulation.scene.rig) is found
