"""Jobs: one contract, one key check, configurations that load again from anywhere."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

import pytest
import tomli_w
import typer
from small_jobs import JOBS, SECTIONS, Waiting, smallest
from typer.testing import CliRunner

import tracker.running.jobs
from tracker.bodies.subject import Subject
from tracker.foundation.configuration.components import find
from tracker.foundation.errors import ConfigError, TrackerError
from tracker.running.cli import add_jobs
from tracker.running.jobs import Job, described, execute, job_from, load_job
from tracker.running.jobs._inputs import fingerprints

# The contract


@pytest.mark.parametrize("use", JOBS)
def test_every_job_follows_the_contract_and_describes_itself(use: str, tmp_path: Path) -> None:
    job = job_from(use, smallest(use), "job.toml", tmp_path, "mine")
    assert isinstance(job, Job)
    assert job.name == "mine"
    table = described(job)
    assert table["job"] == use
    written = tomli_w.dumps(table)
    again = tmp_path / "elsewhere" / "config.toml"
    again.parent.mkdir()
    again.write_text(written)
    assert load_job(use, again) == job


@pytest.mark.parametrize("use", JOBS)
def test_every_job_refuses_a_wrong_key_with_the_nearest_one(use: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r'job\.toml: unknown key "nmae"; did you mean "name"'):
        job_from(use, {**smallest(use), "nmae": "x"}, "job.toml", tmp_path, "mine")
    with pytest.raises(ConfigError, match=r'job\.toml: unknown section "nmae"'):
        job_from(use, {**smallest(use), "nmae": {}}, "job.toml", tmp_path, "mine")


@pytest.mark.parametrize("use", JOBS)
def test_every_field_of_a_job_is_documented(use: str) -> None:
    fields = find("jobs", use).__pydantic_fields__
    assert fields
    assert [name for name, field in fields.items() if not field.description] == []


@pytest.mark.parametrize("use", [use for use in JOBS if "reading" in smallest(use)])
def test_inputs_are_missed_before_a_folder_is_made(use: str, tmp_path: Path) -> None:
    with pytest.raises(TrackerError):
        execute(job_from(use, smallest(use), "job.toml", tmp_path, "mine"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_saved_configuration_loads_from_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A job was asked for with relative paths; what it saves holds in another working directory too."""
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "run.toml").write_text(tomli_w.dumps(smallest("track")))
    monkeypatch.chdir(tmp_path / "here")
    job = load_job("track", Path("run.toml"))
    saved = tomli_w.dumps(described(job))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "saved.toml").write_text(saved)
    again = load_job("track", Path("saved.toml"))
    assert again == job
    assert again.reading.rig == tmp_path / "here" / "rig.toml"
    assert Path(again.reading.path) == tmp_path / "here" / "{view}.mp4"
    assert again.persons[0].model.is_absolute()


def test_a_path_through_the_latest_link_stays_right_when_the_link_moves_on(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    (tmp_path / "latest").symlink_to("one")
    (tmp_path / "one" / "rig.toml").symlink_to("shared")
    table = {**smallest("track"), "reading": {**SECTIONS["reading"], "rig": "latest/rig.toml"}}  # type: ignore[dict-item]
    rig = job_from("track", table, "run.toml", tmp_path, "mine").reading.rig
    assert rig == tmp_path / "one" / "rig.toml"  # the file itself may be a link: its name says what it is


def test_a_component_of_a_section_need_not_be_named_to_be_changed(tmp_path: Path) -> None:
    table = {**smallest("track"), "estimation": {"then": {"step_deg": 2.0}}, "evidence": "contours"}
    with pytest.raises(ConfigError, match=r'\[estimation\] then: unknown key "step_deg"'):
        job_from("track", table, "run.toml", tmp_path, "mine")
    table["estimation"] = {"first": {"step_deg": 2.0}}
    assert job_from("track", table, "run.toml", tmp_path, "mine").estimation.first.step_deg == 2.0


def test_single_recordings_of_a_saved_configuration_can_be_overridden(tmp_path: Path) -> None:
    path = tmp_path / "saved.toml"
    job = job_from("track", {**smallest("track"), "recordings": {"plots": False}}, "run.toml", tmp_path, "mine")
    path.write_text(tomli_w.dumps(described(job)))
    assert load_job("track", path) == job
    changed = load_job("track", path, ["recordings.overlay=false", "recordings.report.pictures=2"])
    assert [type(one).__name__ for one in changed.recordings] == ["CsvTable", "Report", "RunJson", "Journal"]
    assert changed.recordings[1].pictures == 2
    other = job_from("track", {**smallest("track"), "recordings": ["journal", "overlay"]}, "x", tmp_path, "mine")
    assert job_from("track", described(other), "x", tmp_path, "other") == other


def test_what_is_found_on_opening_is_told_and_logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(job: Waiting, earlier: Path | None = None) -> int:
        logging.getLogger("tracker").warning("camera %s is left out", "b")
        return 1

    said: list[str] = []
    monkeypatch.setattr(Waiting, "open", opened)
    folder = execute(Waiting(), tmp_path / "out", progress=lambda what, *_: said.append(what))
    assert said[0] == "camera b is left out"
    assert (folder / "log.txt").read_text().count("camera b is left out") == 1


# A new job


COUNTING = '''
"""Counting: the frames of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from tracker.foundation.configuration.components import component
from tracker.foundation.files import write_whole
from tracker.running.jobs import ResultFolder
from tracker.foundation.progress import Progress


@component
class CountJob:
    """Counts."""

    resumable: ClassVar[bool] = False

    name: str = "count"
    """Of the results."""

    to: int = 3
    """Where counting ends."""

    def open(self, earlier: Path | None = None) -> range:
        """Nothing to open."""
        return range(self.to)

    def execute(self, opened: range, folder: ResultFolder, progress: Progress) -> CountOutcome:
        """Counts."""
        for k in opened:
            progress("counting", k + 1, len(opened))
        write_whole(folder.path / "count.txt", str(len(opened)))
        return CountOutcome(folder.path, len(opened))


@dataclass(frozen=True)
class CountOutcome:
    """What was counted."""

    folder: Path
    n_counted: int
'''


def test_adding_a_job_is_adding_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file in the folder is a job, a command with the usual options, and listed with its sections."""
    (tmp_path / "jobs").mkdir()
    (tmp_path / "jobs" / "count.py").write_text(COUNTING)
    (tmp_path / "count.toml").write_text('job = "count"\nname = "mine"\n')
    monkeypatch.setattr("tracker.running.jobs.__path__", [*tracker.running.jobs.__path__, str(tmp_path / "jobs")])
    monkeypatch.setattr("tracker.running.cli._JOBS", tmp_path / "jobs")
    monkeypatch.chdir(tmp_path)
    app = typer.Typer()
    app.command("other")(lambda: None)
    add_jobs(app)
    assert "Counting: the frames of a recording." in CliRunner().invoke(app, ["--help"]).output
    done = CliRunner().invoke(app, ["count", "count.toml", "--set", "to=5"], catch_exceptions=False)
    assert "\ncounted: 5" in done.output
    assert (tmp_path / "results" / "mine" / "latest" / "count.txt").read_text() == "5"
    wrong = CliRunner().invoke(app, ["count", "count.toml", "--set", "too=5"])
    assert isinstance(wrong.exception, ConfigError)
    assert 'did you mean "to"' in str(wrong.exception)
    sys.modules.pop("tracker.running.jobs.count", None)


def test_the_files_of_a_skin_are_inputs_as_the_model_is(tmp_path: Path) -> None:
    model = tmp_path / "anna.toml"
    model.write_text('[skin]\nsurface = "scan.ply"\nweights = "absent.npz"\n')
    (tmp_path / "scan.ply").write_text("ply\n")
    subject = Subject(name="anna", model=model)
    first = fingerprints(subject, ())
    assert list(first) == [str(model), str(tmp_path / "scan.ply")]
    (tmp_path / "scan.ply").write_text("another\n")
    assert {name for name, print_ in fingerprints(subject, ()).items() if print_ != first[name]} == {
        str(tmp_path / "scan.ply")
    }


@pytest.mark.parametrize(
    ("subject", "expected"),
    [
        (Subject(), False),
        (Subject(stature_m=1.8), True),
        (Subject(stature_m=1.8, shape="model"), False),
        (Subject(shape="recording"), True),
    ],
)
def test_scaled_models_are_fitted_unless_told_otherwise(subject: Subject, expected: bool) -> None:
    assert subject.is_fitted is expected
