"""Exports of a finished result: the command, lost and uneven frames, the wide table."""

from __future__ import annotations

import csv
import logging
import re
from dataclasses import replace

import numpy as np
import pytest
from exported import FOUND, HUNDREDTH_MM, motion_of, vars_of
from motions import LOST, MODELS, N_FRAMES, SIGMA, made_up, performed
from typer.testing import CliRunner

from tracker.bodies.body.description import load_body
from tracker.foundation.configuration.components import find
from tracker.foundation.errors import ConfigError
from tracker.results.recording.bvh import Bvh
from tracker.results.recording.glb import Glb
from tracker.results.recording.mot import Mot
from tracker.results.recording.osim import Osim
from tracker.results.recording.trc import Trc
from tracker.results.recording.wide_table import WideTable
from tracker.running.cli import app
from tracker.running.commands.result import FORMATS
from tracker.tracking.estimate import Status


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
                assert unit * float(row[f"{parameter.name}_sigma_{parameter.unit}"]) == pytest.approx(SIGMA, abs=1e-5)
            for name, place in zip(body.landmark_names, body.landmarks_in_world(motion.q[t]), strict=True):
                found = [float(row[f"{name}_{axis}_m"]) for axis in "xyz"]
                np.testing.assert_allclose(found, place, atol=HUNDREDTH_MM)


@pytest.mark.parametrize("recording", [Bvh(), Glb(), Mot()])
def test_who_is_lost_in_all_frames_is_in_no_format_that_needs_a_pose(recording, tmp_path, caplog):
    """A file of the pose at rest would be an export of somebody who stands."""
    movement = made_up("gavrila22", "gavrila22")
    gone = [
        replace(step, estimates=(replace(step.estimates[0], status=Status.LOST), step.estimates[1]))
        for step in movement.steps
    ]
    replace(movement, steps=gone).record(recording, tmp_path)
    assert [path.stem for path in tmp_path.glob("person*")] == ["person2"]
    assert [record.getMessage()[:36] for record in caplog.records] == ["person1 is lost in all 12 frames: no"]


def test_lost_frames_that_a_format_cannot_leave_out_are_said(tmp_path, caplog):
    with caplog.at_level(logging.WARNING, "tracker"):
        made_up("gavrila22", "gavrila22").record(Bvh(), tmp_path)
    assert [record.getMessage() for record in caplog.records] == [
        "person1.bvh: person1 is lost in 3 of 12 frames, whose poses are interpolated: the format cannot leave them out"
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


@pytest.mark.parametrize("use", [use for use in FORMATS if use != "opensim"])  # which needs a model of OpenSim's
def test_a_finished_result_is_exported_as_while_tracking(movement, tmp_path, use):
    if use == "isb_angles" and movement.scene.persons[0].body.name == "quadruped":
        pytest.skip("the standard is for persons")
    wanted = movement.record(find("recording", use)(), tmp_path)
    result = movement.result(tmp_path / "result")
    told = CliRunner().invoke(app, ["result", "export", str(result), "--to", use, "--output", str(tmp_path / "out")])
    assert told.exit_code == 0, told.output
    assert told.output.splitlines() == [str(tmp_path / "out" / file.name) for file in wanted]
    for file in wanted:
        assert (tmp_path / "out" / file.name).read_bytes() == file.read_bytes()


def test_several_formats_at_once_into_the_result(tmp_path):
    result = made_up("gavrila22").result(tmp_path / "result")
    told = CliRunner().invoke(app, ["result", "export", str(result), "--to", "trc,c3d", "--y-up"])
    assert told.exit_code == 0, told.output
    assert {path.name for path in (result / "exports").iterdir()} == {"person1.trc", "person1.c3d"}


def test_names_are_such_as_the_readers_take(tmp_path):
    """With spaces BVH had two joints called `left`, OpenSim opened no model, and a tab was one more column."""
    text = (MODELS / "gavrila22.toml").read_text()
    for name, other in (("left_thigh", "left thigh"), ("left_shin", "left/shin")):
        text = text.replace(f'"{name}"', f'"{other}"')
    text = text.replace('"left_leg_twist"', '"left leg\\ttwist"')
    (tmp_path / "odd.toml").write_text(text)
    body = load_body(tmp_path / "odd.toml")
    assert {"left thigh", "left/shin"} <= {segment.name for segment in body.segments}
    odd, plain = (performed(one, np.zeros((2, one.dof))) for one in (body, load_body(MODELS / "gavrila22.toml")))
    (tmp_path / "odd").mkdir()
    (tmp_path / "plain").mkdir()
    for recording in (Bvh(), Trc(), Mot(), Osim()):
        (made,) = odd.record(recording, tmp_path / "odd")
        (expected,) = plain.record(recording, tmp_path / "plain")
        assert made.read_text() == expected.read_text()


def test_an_export_that_is_refused_leaves_what_was_there(tmp_path):
    """The table of the format before the one that cannot be written had lost its rows."""
    result = made_up("quadruped").result(tmp_path / "result")
    assert CliRunner().invoke(app, ["result", "export", str(result), "--to", "wide_table"]).exit_code == 0
    before = {path.name: path.read_bytes() for path in (result / "exports").iterdir()}
    assert before
    told = CliRunner().invoke(app, ["result", "export", str(result), "--to", "wide_table,trc,isb_angles"])
    assert isinstance(told.exception, ConfigError), told.output
    assert {path.name: path.read_bytes() for path in (result / "exports").iterdir()} == before
    refused = ["result", "export", str(result), "--to", "isb_angles", "--output", str(tmp_path / "new")]
    assert isinstance(CliRunner().invoke(app, refused).exception, ConfigError)
    assert not (tmp_path / "new").exists()


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
    told = CliRunner().invoke(app, ["result", "export", str(tmp_path / arguments[0]), *arguments[1:]])
    assert isinstance(told.exception, ConfigError), told.output
    assert re.search(re.escape(words), str(told.exception))
    assert "\n" not in str(told.exception)
