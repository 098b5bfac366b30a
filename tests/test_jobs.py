"""Jobs: one contract, one key check, folders that belong to one job, configurations that load again from anywhere."""

from __future__ import annotations

import logging
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import tomli_w
import typer
from typer.testing import CliRunner

import tracker.jobs
from tracker.camera import Camera
from tracker.commands.job import add_jobs
from tracker.components import available, component, find
from tracker.config import read_config
from tracker.errors import CalibrationError, ConfigError, SequenceError, TrackerError
from tracker.files import GrowingFile, remove_unfinished, replacing, whole_folder, write_json, write_whole
from tracker.jobs import Job, ResultFolder, described, execute, job_from, load_job
from tracker.jobs._folder import result_folder
from tracker.jobs._inputs import fingerprints
from tracker.kernels.ahead import Group, all_cached, warm_up
from tracker.progress import Progress, silent, within
from tracker.subject import Subject

JOBS = available("jobs")
SECTIONS = {
    "reading": {"use": "video", "path": "{view}.mp4", "rig": "rig.toml"},
    "persons": [{"name": "anna", "stature_m": 1.7}],
    "calibration": {"use": "reference_bar", "length_m": 1.0},
    "pairs": [{"front": {"mask": "front.png"}, "side": {"mask": "side.png"}}],
    "stature_m": 1.7,
    "moments": [{"cloud": "points.ply"}],
    "scan": {"surface": "scan.ply", "weights": "weights.npz", "joints": "joints.json"},
}
"""What a section needs at least."""


def smallest(use: str) -> dict[str, Any]:
    """The shortest table that describes a job."""
    fields = find("jobs", use).__pydantic_fields__
    table = {name: SECTIONS[name] for name, field in fields.items() if field.is_required()}
    if use == "calibrate":
        table["reading"] = {"use": "video", "path": "{view}.mp4", "views": ["left", "right"]}
    return table


@component
class Waiting:
    """Computes, fails or is interrupted as it is told."""

    kernels: ClassVar[Group | None] = None
    resumable: ClassVar[bool] = False

    name: str = "waiting"
    fails: bool = False
    results: int = 1

    def open(self, earlier: Path | None = None) -> int:
        return self.results

    def execute(self, opened: int, folder: ResultFolder, progress: Progress) -> Path:
        for k in range(opened):
            write_whole(folder.path / f"{k}.txt", "found")
            folder.keep()
        (folder.path / "half").mkdir()
        (folder.path / "half" / "written.txt").write_text("ha")
        if self.fails:
            raise SequenceError("the last file is corrupt")
        return folder.path


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
def test_inputs_are_missed_before_kernels_are_compiled_or_a_folder_is_made(
    use: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tracker.jobs.all_cached", lambda group: False)
    monkeypatch.setattr("tracker.jobs.warm_up", lambda progress, group: pytest.fail("compiled for nothing"))
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


# Result folders


def test_two_jobs_of_the_same_second_get_two_folders(tmp_path: Path) -> None:
    """Eight processes that begin at one moment, with the clock standing still."""
    script = textwrap.dedent(
        """
        import sys, time
        from pathlib import Path
        from tracker.jobs._folder import result_folder
        time.strftime = lambda text: "2026-11-21_12-00-00"
        while time.time() < float(sys.argv[1]):
            pass
        with result_folder("same", None) as folder:
            (folder.path / "mine.txt").write_text(sys.argv[2])
            time.sleep(0.2)
            print(folder.path, end="")
        """
    )
    begin = str(time.time() + 4)
    processes = [
        subprocess.Popen([sys.executable, "-c", script, begin, str(k)], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        for k in range(4)
    ]
    folders = [tmp_path / process.communicate()[0] for process in processes]
    assert [process.returncode for process in processes] == [0] * 4
    assert len(set(folders)) == 4
    assert [(folder / "mine.txt").read_text() for folder in folders] == [str(k) for k in range(4)]
    latest = tmp_path / "results" / "same" / "latest"
    assert latest.is_symlink()
    assert latest.resolve() in folders
    assert len(list((tmp_path / "results" / "same").iterdir())) == 5


def test_of_two_jobs_with_the_same_output_one_is_refused(tmp_path: Path) -> None:
    with result_folder("one", tmp_path / "out") as first:
        write_whole(first.path / "first.txt", "")
        with pytest.raises(ConfigError, match="not empty"), result_folder("two", tmp_path / "out"):
            pass
    assert (tmp_path / "out" / "first.txt").is_file()


@pytest.mark.parametrize("made", ["not there", "empty"])
def test_a_job_that_fails_before_its_first_result_leaves_nothing(made: str, tmp_path: Path) -> None:
    output = tmp_path / "new" / "out"
    if made == "empty":
        output.mkdir(parents=True)
    with pytest.raises(SequenceError):
        execute(Waiting(fails=True, results=0), output)
    assert [path.name for path in tmp_path.rglob("*")] == (["new", "out"] if made == "empty" else [])


def test_a_dated_job_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SequenceError):
        execute(Waiting(fails=True, results=0))
    assert list(tmp_path.iterdir()) == []


def test_what_was_computed_before_an_error_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SequenceError):
        execute(Waiting(fails=True, results=2))
    latest = tmp_path / "results" / "waiting" / "latest"
    assert {path.name for path in latest.iterdir()} >= {"0.txt", "1.txt", "config.toml", "log.txt"}


def test_the_latest_link_moves_on_and_the_folder_tells_how_it_was_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    first, second = execute(Waiting()), execute(Waiting(results=3))
    assert first != second
    latest = tmp_path / "results" / "waiting" / "latest"
    assert latest.resolve() == second.resolve()
    saved = read_config(latest / "config.toml")
    assert saved["results"] == 3


@pytest.mark.parametrize(
    "name", ["", "..", "a/b", "../../../escaped", "a\\b", "a\0b", "/tmp/a", 300 * "a", " ", "a\nb"]
)
def test_a_name_that_is_none_for_a_folder_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for resume in (False, True):
        with pytest.raises(ConfigError, match="name = "):
            execute(Waiting(name=name), resume=resume)
    with pytest.raises(ConfigError, match="name = "):
        execute(Waiting(name=name), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["..", "a/b", "../../x", "a\\b", "a\0b", 300 * "a"])
def test_persons_and_cameras_are_not_called_as_no_file_can_be(name: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"a person is called .*(files are called after|expected)"):
        job_from("track", {**smallest("track"), "persons": [{"name": name}]}, "run.toml", tmp_path, "mine")
    with pytest.raises(CalibrationError, match=r"camera .*(files are called after|expected)"):
        Camera.looking_at(name, (640, 480), 500.0, (0.0, 0.0, 1.0), np.array([1.0, 0.0, 1.0]))


def test_an_output_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(ConfigError, match="is a file"):
        execute(Waiting(), tmp_path / "out")


def test_a_job_that_cannot_be_resumed_says_so(tmp_path: Path) -> None:
    with pytest.raises(SequenceError, match="no run to resume"):
        execute(Waiting(), tmp_path / "out", resume=True)
    execute(Waiting(), tmp_path / "out")
    with pytest.raises(ConfigError, match="cannot be resumed"):
        execute(Waiting(), tmp_path / "out", resume=True)


# Files and progress


def test_a_file_is_written_as_a_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    write_json(path, {"a": 1})
    before = path.read_bytes()

    def spoilt() -> None:
        with replacing(path) as unfinished:
            assert unfinished.suffix == ".json"
            unfinished.write_text("half")
            raise SequenceError("stopped")

    with pytest.raises(SequenceError):
        spoilt()
    assert path.read_bytes() == before
    assert [other.name for other in tmp_path.iterdir()] == ["table.json"]


def test_a_replaced_file_keeps_its_mode_and_a_new_one_has_the_usual(tmp_path: Path) -> None:
    (tmp_path / "usual").write_text("")
    write_whole(tmp_path / "new", b"x")
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "usual").stat().st_mode
    (tmp_path / "new").chmod(0o640)
    write_whole(tmp_path / "new", "y")
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o640


LIMITED = """
import resource, signal, sys
from pathlib import Path
from tracker.files import GrowingFile
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
file = GrowingFile(Path(sys.argv[1]))
file.add(600 * "a")
try:
    file.add(600 * "b")
except OSError as error:
    print(error.filename)
file.add(100 * "c")
"""


def test_what_does_not_fit_on_the_disk_is_taken_back(tmp_path: Path) -> None:
    command = [sys.executable, "-c", LIMITED, str(tmp_path / "table.csv")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text() == 600 * "a" + 100 * "c"


def test_a_file_that_waits_takes_its_place_later(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("old")
    file = GrowingFile(tmp_path / "table.csv", waits=True)
    file.add("new")
    assert (tmp_path / "table.csv").read_text() == "old"
    file.take_place()
    file.add(" and more")
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]
    assert (tmp_path / "table.csv").read_text() == "new and more"
    GrowingFile(tmp_path / "table.csv", waits=True)
    remove_unfinished(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


def test_progress_says_what_it_is_a_step_of() -> None:
    said: list[tuple[str, int, int]] = []
    within(lambda what, done=0, total=0, detail="": said.append((what, done, total)), "left - right")("seeds", 1, 2)
    assert said == [("left - right: seeds", 1, 2)]
    silent("anything")


def test_compiling_is_told_to_its_end() -> None:
    said: list[tuple[int, int]] = []
    warm_up(lambda what, done=0, total=0, detail="": said.append((done, total)), "calibration")
    assert all_cached("calibration")
    assert [done for done, _ in said] == list(range(said[0][1] + 1))


# A new job


COUNTING = '''
"""Counting: the frames of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from tracker.components import component
from tracker.files import write_whole
from tracker.jobs import ResultFolder
from tracker.kernels.ahead import Group
from tracker.progress import Progress


@component
class CountJob:
    """Counts."""

    kernels: ClassVar[Group | None] = None
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
    monkeypatch.setattr("tracker.jobs.__path__", [*tracker.jobs.__path__, str(tmp_path / "jobs")])
    monkeypatch.setattr("tracker.commands.job._JOBS", tmp_path / "jobs")
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
    sys.modules.pop("tracker.jobs.count", None)


def test_two_processes_do_not_write_to_one_folder(tmp_path: Path) -> None:
    """A run that is still at work is not resumed beside itself."""
    with result_folder("one", tmp_path / "out") as folder:
        script = "import sys; from pathlib import Path; from tracker.jobs._folder import logged\n"
        script += "with logged(Path(sys.argv[1])): pass"
        command = [sys.executable, "-c", script, str(folder.path)]
        other = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "a job is at work there" in other.stderr


def test_a_folder_is_moved_into_place_as_a_whole(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "a" / "b") as unfinished:
        (unfinished / "x").write_text("1")
        assert not (tmp_path / "a" / "b").exists()
    assert [path.name for path in (tmp_path / "a").rglob("*")] == ["b", "x"]
    with pytest.raises(ConfigError, match="not empty"), whole_folder(tmp_path / "a" / "b"):
        pass
    with pytest.raises(SequenceError), whole_folder(tmp_path / "a" / "c"):
        raise SequenceError("stopped")
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"]


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
