"""`bodytrack result recognize`: tables and pictures of what was done, libraries that grow, mistakes in one line."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from motions import made_up, performed
from typer.testing import CliRunner

from tracker.bodies.body.description import load_body
from tracker.foundation.errors import ConfigError, ModelError
from tracker.foundation.resources import model_path
from tracker.results.recognition import Course
from tracker.results.recognition.library import Description, add_performance, load_library
from tracker.running.cli import app
from tracker.synthesis.simulation.movements import poses_of

BODY = load_body(model_path("gavrila22"))
LIBRARY = load_library(())


@pytest.fixture
def squat_result(tmp_path):
    """A result in which somebody squats twice after a second of which nothing is known, lost for a while."""
    times = np.arange(0, 5.2, 0.04)
    lost = np.zeros(len(times), bool)
    lost[:10] = True
    return performed(BODY, poses_of("squat", BODY, times, heading_deg=70, place=(2, 1)), lost).result(tmp_path / "run")


def told(*arguments):
    done = CliRunner().invoke(app, ["result", "recognize", *map(str, arguments)])
    if isinstance(done.exception, (ConfigError, ModelError)):
        return str(done.exception)
    assert done.exit_code == 0, done.output
    return done.output


def test_the_command_writes_a_table_and_a_picture(squat_result):
    output = told(squat_result)
    assert "squat" in output
    with (squat_result / "movements.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["movement"] for row in rows if row["angle_deg"]].count("squat") >= 1
    assert rows[0]["movement"] == "lost"
    assert {row["person"] for row in rows} == {"anna"}
    last = rows[-1]
    assert (last["movement"], float(last["end_s"])) == ("squat", pytest.approx(5.16, abs=0.2))
    assert float(last["angle_deg"]) < 2
    assert (squat_result / "movements.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_says_where_nothing_is_known(squat_result, tmp_path):
    cartwheel = next(iter(load_library(()).movements["cartwheel"].performances.values()))
    add_performance(tmp_path / "mine", "cartwheel", "a", Course(0.0, cartwheel, np.ones(68, bool)), Description())
    assert "anna: none of 1 known movements fits" in told(squat_result, "--library", tmp_path / "mine")


def test_a_result_is_added_and_then_recognized(squat_result, tmp_path):
    mine = tmp_path / "mine"
    output = told("--add", squat_result, "knee_bend", "--library", mine, "--frames", "65:130", "--about", "ours")
    assert "knee_bend" in output
    assert (mine / "knee_bend" / "made_up_anna.csv").is_file()
    found = told(squat_result, "--library", mine, "--library", "bundled", "--output", tmp_path / "out")
    assert "knee_bend" in found
    assert (tmp_path / "out" / "movements.csv").is_file()


@pytest.mark.parametrize("repeats", [(), ("--repeats",)])
def test_movements_of_an_animal_are_told_by_a_library_of_its_own(squat_result, tmp_path, repeats):
    body, mine, times = load_body(model_path("quadruped")), tmp_path / "mine", np.arange(0, 2.4, 0.04)
    never = np.zeros(len(times), bool)
    known, asked = (
        performed(body, poses_of("trot", body, times + late_s, heading_deg=turn), never).result(tmp_path / f"run{turn}")
        for late_s, turn in ((0.0, 10), (0.3, 200))
    )
    output = told(asked)
    assert "the movements are of another body (left_forearm, left_shin, left_thigh, ... only of the movements" in output
    assert "a person's landmarks are called left_shoulder, " in output
    told("--add", known, "trot", "--library", mine, *repeats)
    assert "trot" in told(asked, "--library", mine)
    both = "--library", mine, "--library", "bundled", "--overwrite"
    assert "movements of another body than those in" in told(asked, *both)
    assert "mine: movements of another body: choose another --library" in told(
        "--add", squat_result, "squat", "--library", mine
    )


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("--add",), "expected a name"),
        (("--add", "x"), "expected one folder of your own"),
        (("--add", "x", "--library", "bundled"), "expected one folder of your own"),
        (("--add", "x", "--library", "mine", "--person", "ana"), 'did you mean "anna"'),
        (("--add", "x", "--library", "mine", "--frames", "5-9"), "expected A:B"),
        (("--add", "x", "--library", "mine", "--frames", "500:"), "the result has frames 0 to 129"),
        (("--add", "x", "--library", "mine", "--frames", "0:40"), "is lost in some of the frames"),
        (("x",), "only with --add"),
        (("--frames", "0:3"), "only with --add"),
        (("--library", "nowhere"), "nowhere: no such folder"),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_written(squat_result, tmp_path, monkeypatch, arguments, fault):
    monkeypatch.chdir(tmp_path)
    assert fault in told(squat_result, *arguments)
    assert not (tmp_path / "mine").exists()
    assert not (squat_result / "movements.csv").exists()


def test_a_person_lost_in_every_frame_is_not_said_to_do_something_unknown(tmp_path):
    times = np.arange(0, 1.2, 0.04)
    movement = performed(BODY, poses_of("squat", BODY, times), np.ones(len(times), bool))
    output = told(movement.result(tmp_path / "run"))
    assert "anna: lost in every frame" in output
    assert "none of" not in output


def test_a_single_frame_is_no_movement(tmp_path):
    movement = made_up("gavrila22")
    folder = replace(movement, steps=movement.steps[:1]).result(tmp_path / "run")
    assert "--add: the result has frames 10 to 10, and a movement takes two or more" in told(
        "--add", folder, "x", "--library", tmp_path / "mine"
    )


def test_several_persons_are_told_apart(tmp_path):
    folder = made_up("gavrila22", "human").result(tmp_path / "run")
    assert "person2: none of" in told(folder)
    assert "choose one with --person: person1, person2" in told("--add", folder, "x", "--library", tmp_path / "mine")
