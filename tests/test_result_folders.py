"""Folders belong to one job; files are whole or not there; progress is told to its end."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_jobs import Waiting, smallest

from tracker.cameras.camera import Camera
from tracker.foundation.configuration.tables import read_config
from tracker.foundation.errors import CalibrationError, ConfigError, SequenceError
from tracker.foundation.files import GrowingFile, remove_unfinished, replacing, whole_folder, write_json, write_whole
from tracker.foundation.progress import silent, within
from tracker.running.jobs import execute, job_from
from tracker.running.jobs._folder import result_folder

# Result folders


RACE = """
import multiprocessing, sys, time
from pathlib import Path
from tracker.running.jobs._folder import result_folder

def job(k, begin):
    begin.wait()
    with result_folder("same", None) as folder:
        (folder.path / "mine.txt").write_text(str(k))
        time.sleep(0.2)
        Path(f"told_{k}").write_text(str(folder.path))

time.strftime = lambda text: "2026-11-21_12-00-00"
context = multiprocessing.get_context("fork")
begin = context.Barrier(4)
jobs = [context.Process(target=job, args=(k, begin)) for k in range(4)]
for one in jobs:
    one.start()
for one in jobs:
    one.join()
sys.exit(max(abs(one.exitcode) for one in jobs))
"""


def test_two_jobs_of_the_same_second_get_two_folders(tmp_path: Path) -> None:
    """Four processes that begin at one moment, with the clock standing still; one loads the program for all."""
    subprocess.run([sys.executable, "-c", RACE], cwd=tmp_path, check=True)
    folders = [tmp_path / (tmp_path / f"told_{k}").read_text() for k in range(4)]
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
from tracker.foundation.files import GrowingFile
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


def test_two_processes_do_not_write_to_one_folder(tmp_path: Path) -> None:
    """A run that is still at work is not resumed beside itself."""
    with result_folder("one", tmp_path / "out") as folder:
        script = "import sys; from pathlib import Path; from tracker.running.jobs._folder import logged\n"
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
