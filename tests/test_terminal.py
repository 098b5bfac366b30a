"""What the terminal shows: progress on narrow and wide ones, tables that begin with what is looked for."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console, Group
from rich.table import Table
from typer.testing import CliRunner

from tracker.foundation.errors import ConfigError
from tracker.results.evaluation.comparison import Evaluation, PersonErrors
from tracker.running import commands
from tracker.running.cli import app
from tracker.running.commands import ProgressBar, evaluate
from tracker.running.commands.run import _print_tracked
from tracker.running.jobs import load_job
from tracker.running.jobs._record import _Pace
from tracker.running.jobs.track import TrackOutcome
from tracker.tracking.doubts import Doubts

DETAIL = "12.5 frames/s, about 2 min 10 s left, 3 lost, 12 doubtful"


@pytest.mark.parametrize(("width", "n_lines"), [(60, 2), (80, 2), (99, 2), (100, 1), (140, 1)])
def test_a_narrow_terminal_has_the_detail_below_the_bar(width, n_lines):
    """Whole wherever there is room for it."""
    shown = Console(width=width, file=io.StringIO(), force_terminal=True, color_system=None)
    bar = ProgressBar(shown)
    bar("tracking", 30, 400, DETAIL)
    with shown.capture() as capture:
        for part in bar._bar.get_renderables():
            shown.print(Group(part))
    lines = [line for line in capture.get().splitlines() if line.strip()]
    assert len(lines) == n_lines
    assert "tracking" in lines[0]
    assert "30/400" in lines[0]
    assert ("frames/s" in lines[0]) == (n_lines == 1)
    assert max(map(len, lines)) <= width
    if width >= 80 and n_lines == 2:
        assert lines[1].strip() == DETAIL


def test_a_finished_step_takes_one_line(capsys):
    shown = Console(width=80, file=io.StringIO(), force_terminal=True, color_system=None)
    bar = ProgressBar(shown)
    bar("decoding", 4, 4, "done")
    bar("tracking", 1, 4, DETAIL)
    with shown.capture() as capture:
        for part in bar._bar.get_renderables():
            shown.print(Group(part))
    assert len([line for line in capture.get().splitlines() if line.strip()]) == 3


def test_a_warning_is_a_line_of_its_own_beside_a_bar_too():
    shown = Console(width=80, file=io.StringIO())
    bar = ProgressBar(shown)
    bar("tracking", 1, 4, DETAIL)
    bar("forwards: frame 3, 4 to go")
    bar("input: nobody moves [in any view]")
    assert shown.file.getvalue().splitlines() == ["input: nobody moves [in any view]"]


def test_what_is_not_counted_has_no_number_of_how_many():
    """A user saw a start at "0/?" for 25 minutes; it tells its own numbers."""
    shown = Console(width=120, file=io.StringIO(), force_terminal=True, color_system=None)
    bar = ProgressBar(shown)
    for n in (1, 2):
        bar(f"start: pose {n} of 12")
    with shown.capture() as capture:
        for part in bar._bar.get_renderables():
            shown.print(Group(part))
    assert "start: pose 2 of 12" in capture.get()
    assert "?" not in capture.get()


def test_what_was_told_with_other_numbers_moves_along_in_the_last_line():
    """Of a hundred frames no hundred lines, among which a warning would be lost."""
    shown = Console(width=80, file=io.StringIO())
    with ProgressBar(shown) as bar:
        for frame in range(100):
            bar(f"forwards: frame {frame}, {100 - frame} to go")
            if frame == 50:
                bar("input: nobody moves")
                assert [task.description for task in bar._bar.tasks] == ["forwards: frame 50, 50 to go"]
        bar("tracking", 1, 4, DETAIL)
        bar("back: frame 3, 2 to go")
        assert [task.description for task in bar._bar.tasks] == ["tracking"]
        bar("tracking", 4, 4)
    lines = shown.file.getvalue().splitlines()
    assert lines[:2] == ["forwards: frame 0, 100 to go", "input: nobody moves"]
    assert "forwards" not in "".join(lines[1:])


def test_names_and_paths_are_shown_as_they_are():
    """What stands in brackets is no markup: rich would swallow it, or fail at `[/`."""
    shown = Console(width=120, file=io.StringIO(), force_terminal=True, color_system=None)
    bar = ProgressBar(shown)
    bar("recordings [a]", 1, 4, "anna [old] done [/]")
    with shown.capture() as capture:
        for part in bar._bar.get_renderables():
            shown.print(Group(part))
    assert "recordings [a]" in capture.get()
    assert "anna [old] done [/]" in capture.get()
    with commands.console.capture() as capture:
        commands.console.print("results[1]/anna :dog: [/]", Table("name [b]"), commands.marked("look", "view [c]"))
    assert all(text in capture.get() for text in ("results[1]/anna :dog: [/]", "name [b]", "look: view [c]"))


def test_a_sentence_with_a_path_stays_in_one_line():
    """Where it is piped there are 80 columns; what the terminal wraps can still be copied."""
    shown = Console(width=40, file=io.StringIO())
    folder, told = Path("results") / ("long" * 30), "the doubts, in one line of more than forty columns"
    ProgressBar(shown)(f"squat: 4 frames, results in {folder}")
    assert len(shown.file.getvalue().splitlines()) == 1
    outcome = TrackOutcome(
        folder, 4, SimpleNamespace(none=True, advice=str, sentence=lambda: told, why=str), seconds=75.0
    )
    with commands.console.capture() as capture:
        _print_tracked(outcome)
    first = "tracked 4 frames in 1 min 15 s, 0.1 frames/s all included"
    assert capture.get().splitlines() == [first, f"results in {folder}: no recordings chosen", told]


def test_an_evaluation_starts_with_what_is_looked_for(monkeypatch):
    shown = Console(width=80, file=io.StringIO())
    monkeypatch.setattr(evaluate, "console", shown)
    person = PersonErrors(
        person="anna",
        truth="anna",
        n_frames=75,
        n_missing=2,
        mean_mm=23.4,
        median_mm=21.0,
        p95_mm=50.0,
        mean_offset_removed_mm=11.5,
        median_offset_removed_mm=10.0,
        mean_trunk_offset_removed_mm=4.0,
        joints_mm={"left_wrist": (30.0, 12.0)},
        parameters={"torso_twist_deg": 1.25},
        hinges_deg={"left_elbow": (4.0, 2.0)},
    )
    evaluate.print_evaluation(Evaluation(persons=(person,), silhouette_iou={}, distances_mm={}))
    rows = [line for line in shown.file.getvalue().splitlines() if line.startswith("│")]
    told = [row.split("│")[1].strip() for row in rows]
    means = ["joint distance, mean", "mean, joint offsets removed", "mean, removed as the trunk turns"]
    assert told[:4] == [*means, "joint angles, RMS"]
    assert told[4].startswith("left elbow")
    assert "2 of 75" in rows[5]
    assert told[-2:] == ["joint distance, median", "joint distance, 95 %"]


def test_a_person_is_changed_on_the_command_line(tmp_path):
    (tmp_path / "rig.toml").touch()
    text = 'persons = [{ name = "anna", model = "gavrila22" }, { name = "ben", model = "human" }]\n'
    (tmp_path / "run.toml").write_text(text + '[reading]\nuse = "video"\npath = "{view}.mp4"\nrig = "rig.toml"\n')
    job = load_job("track", tmp_path / "run.toml", ["persons.0.model=human", "persons.1.stature_m=1.9"])
    assert [(one.name, one.model, one.stature_m) for one in job.persons] == [
        ("anna", job.persons[1].model, None),
        ("ben", job.persons[1].model, 1.9),
    ]


@pytest.mark.skipif(shutil.which("bodytrack") is None, reason="the command is not on the path")
def test_the_shell_completes_commands_and_options():
    def completed(words, position):
        environment = {**os.environ, "_BODYTRACK_COMPLETE": "complete_bash"}
        asked = environment | {"COMP_WORDS": words, "COMP_CWORD": str(position)}
        return subprocess.run(["bodytrack"], env=asked, capture_output=True, text=True, check=False).stdout.split()

    assert completed("bodytrack result ev", 2) == ["evaluate"]
    assert completed("bodytrack ev", 1) == []
    assert completed("bodytrack run --res", 2) == ["--resume"]


def test_a_pace_says_what_is_left_and_keeps_how_long_stages_took():
    pace = _Pace(4)
    told = [pace.after(SimpleNamespace(seconds={"search": 20.0, "synthesis": 5.0}), Doubts()) for _ in range(4)]
    assert told[:3] == [f"0.0 frames/s, about {left} left" for left in ("1 min 15 s", "50 s", "25 s")]
    assert "left" not in told[3]
    assert pace.in_all == {"search": 80.0, "synthesis": 20.0}


@pytest.mark.parametrize("asked", [[], ["--verbose"]])
def test_times_of_stages_are_told_where_they_are_asked_for(monkeypatch, tmp_path, asked):
    outcome = TrackOutcome(tmp_path, 4, Doubts(n_frames=4, found=frozenset({"anna"})), seconds=1.0)
    outcome = replace(outcome, stages_s={"synthesis": 0.02, "search": 0.16})
    monkeypatch.setattr("tracker.running.jobs.load_job", lambda *_: None)
    monkeypatch.setattr("tracker.running.commands.run.done", lambda *_: outcome)
    told = CliRunner().invoke(app, ["run", "run.toml", *asked])
    assert told.exit_code == 0, told.output
    assert ("stages of tracking, ms a frame: search 40, synthesis 5" in told.output) == bool(asked)
    both = CliRunner().invoke(app, ["run", "a.toml", "b.toml", "--verbose"])
    assert isinstance(both.exception, ConfigError)
