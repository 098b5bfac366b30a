"""A model file of segments and parts alone is complete; one whose landmarks give no axis says so, or does without."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
import pytest
import tomli_w
from recordings import SMALL, cycle_for, small_simulation
from typer.testing import CliRunner

from tracker.acquisition.silhouette_task import SilhouetteSettings
from tracker.acquisition.things import _is_near_the_trunk
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.foundation.errors import ModelError
from tracker.foundation.resources import model_path
from tracker.images.plate import Plate
from tracker.running.cli import app
from tracker.running.jobs import execute, load_job
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.stance import StanceInitialization

BARE = ("name", "segments", "parts")

TABLES = "recordings=['csv_table','journal','run_json']"


def written(folder: Path, *kept: str, **changes: Any) -> Path:
    """The 22-parameter body with some sections of its file, and others in place of them."""
    table = tomllib.loads(model_path("gavrila22").read_text(encoding="utf-8"))
    path = folder / "bare.toml"
    path.write_text(tomli_w.dumps({key: table[key] for key in kept} | changes), encoding="utf-8")
    return path


def plates_of(scene: Scene) -> tuple[Plate, ...]:
    return tuple(Plate(np.zeros((*SMALL[::-1], 3), np.uint8)) for _ in scene.rig.names)


def test_joints_and_free_ends_are_the_landmarks_of_a_file_without_any(tmp_path: Path) -> None:
    body, whole = load_body(written(tmp_path, *BARE)), load_body(model_path("gavrila22"))
    assert {body.mirror.of(name) for name in body.landmark_names} == set(body.landmark_names)
    assert body.marked_limbs == body.limbs == ("left_upper_arm", "right_upper_arm", "left_thigh", "right_thigh")
    marks, known = body.landmarks_in_world(body.rest()), whole.landmarks_in_world(whole.rest())
    gaps = np.linalg.norm(marks[:, None] - known, axis=2).min(axis=0)
    names = ("left_shoulder", "right_elbow", "left_hip", "right_knee")
    np.testing.assert_allclose([gaps[whole.landmark_names.index(name)] for name in names], 0.0, atol=1e-9)
    assert body.start.head == "head_end"
    assert "left_forearm" in body.joints.hinges
    scene = Scene((Person("one", body, body.rest()),), small_simulation(n_frames=1).scene.rig)
    assert "pca" in AutoInitialization().check(scene, plates_of(scene))
    assert "stance" in AutoInitialization().check(scene, (None,) * 4)


def test_a_person_of_segments_and_parts_is_found_tracked_and_evaluated(tmp_path: Path) -> None:
    recipe = Recipe("sway", model=str(written(tmp_path, *BARE)), seconds=3 / 25, size=SMALL)
    config = write_sequence(recipe, tmp_path / "filmed")
    result = execute(load_job("track", config, [TABLES]), tmp_path / "result").folder
    told = CliRunner().invoke(app, ["result", "evaluate", str(result), "--truth", str(config.parent)])
    assert told.exit_code == 0, told.output
    (median,) = (line for line in told.output.splitlines() if "joint distance, median" in line)
    # a pixel is 12.5 mm at the person
    assert float(median.split()[-3]) < 12.5


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> BodyModel:
    """A body with landmarks on either side, and none on the midline."""
    whole = tomllib.loads(model_path("gavrila22").read_text(encoding="utf-8"))["landmarks"]
    sides = {name: mark for name, mark in whole.items() if name.startswith(("left_", "right_"))}
    return load_body(written(tmp_path_factory.mktemp("pairs"), *BARE, landmarks=sides))


def test_a_body_without_an_axis_is_refused_before_plates_in_time(pairs: BodyModel) -> None:
    scene = Scene((Person("one", pairs, pairs.rest()),), small_simulation(n_frames=1).scene.rig)
    with pytest.raises(ModelError, match="two landmarks on the body's long axis"):
        AutoInitialization().check(scene, plates_of(scene))
    assert "stance" in AutoInitialization().check(scene, (None,) * 4)


def test_a_body_without_an_axis_is_looked_for_in_stances_where_backdrops_are_made(pairs: BodyModel) -> None:
    simulation = small_simulation(n_frames=1)
    (frame,), plates = simulation.frames(), simulation.plates
    scene = Scene((Person("one", pairs, pairs.rest()),), simulation.scene.rig)
    stance = StanceInitialization(stances_deg=({"arm_abduction": 10.0},), hypotheses=1, farthest_m=6.0)
    stages = cycle_for(simulation, plates=(None,) * 4).stages
    start = AutoInitialization(stance=stance).start(frame, scene, replace(stages, backdrops=lambda: plates))
    gaps = pairs.landmarks_in_world(start.poses[0]) - pairs.landmarks_in_world(simulation.poses[0][0])
    assert np.linalg.norm(gaps.mean(axis=0)) < 0.1


@pytest.mark.parametrize(
    ("build", "where"),
    [
        (lambda: StanceInitialization(stances_deg=()), "stances_deg"),
        (lambda: SilhouetteSettings(coarse_deg={"arm_abduction": ()}), "arm_abduction"),
    ],
)
def test_lists_of_nothing_to_try_are_refused(build: Callable[[], object], where: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=rf"{where}\n.*at least 1 item"):
        build()


def test_a_limb_that_carries_no_part_is_near_no_trunk(tmp_path: Path) -> None:
    table = tomllib.loads(model_path("gavrila22").read_text(encoding="utf-8"))
    trunk = table["segments"][0]["name"]
    tails = [
        {"name": f"{side}_tail", "parent": trunk, "joint": [-0.1, y, 0.9]}
        | {"parameters": [{"name": f"{side}_wag", "axis": [0, 0, 1], "limits_deg": [-30, 30]}]}
        for side, y in (("left", 0.05), ("right", -0.05))
    ]
    body = load_body(written(tmp_path, "name", "parts", segments=[*table["segments"], *tails]))
    assert "left_tail" in body.limbs
    whole = load_body(model_path("gavrila22"))
    np.testing.assert_array_equal(_is_near_the_trunk(body), _is_near_the_trunk(whole))
