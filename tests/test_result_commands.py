"""`bodytrack result`: reports and results that replace nothing unasked, and commands that were called otherwise."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from motions import made_up
from typer.testing import CliRunner

from tracker.foundation.errors import ConfigError
from tracker.results.recording.csv_table import CsvTable
from tracker.running.batching import Summary
from tracker.running.batching.processes import Processes
from tracker.running.cli import EARLIER, app

COMMANDS = {
    "evaluate": ["--truth", "TRUTH"],
    "export": ["--to", "trc,wide_table"],
    "recognize": [],
    "smooth": [],
}
"""Those that need no images and no markers, with what they are asked for."""

RUN = """
persons = [{ name = "anna", stature_m = 1.7 }]
[reading]
use = "video"
path = "{view}.mp4"
rig = "rig.toml"
"""


@pytest.fixture(scope="module")
def tracked(tmp_path_factory) -> Path:
    movement = made_up("gavrila22")
    folder = movement.result(tmp_path_factory.mktemp("results") / "result")
    movement.record(CsvTable(), folder)
    return folder


@pytest.fixture
def result(tracked, tmp_path) -> Path:
    return Path(shutil.copytree(tracked, tmp_path / "result"))


@pytest.fixture
def recordings(tmp_path) -> list[str]:
    """Two configurations of recordings that are not there."""
    (tmp_path / "rig.toml").touch()
    for name in ("anna", "bert"):
        (tmp_path / f"{name}.toml").write_text(f'name = "{name}"\n{RUN}')
    return [str(tmp_path / f"{name}.toml") for name in ("anna", "bert")]


def asked(command: str, result: Path) -> list[str]:
    words = [str(result / "joints.csv") if word == "TRUTH" else word for word in COMMANDS[command]]
    return [command, str(result), *words]


def files(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Each file with its identity, which one that replaces it does not share."""
    return {str(path): (path.stat().st_ino, path.read_bytes()) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_replaced_unasked(command, result):
    raw = files(result)
    words = ["result", *asked(command, result)]
    first = CliRunner().invoke(app, words)
    assert first.exit_code == 0, first.output
    made = files(result)
    assert made.keys() > raw.keys(), "it writes something"
    assert raw.items() <= made.items()
    again = CliRunner().invoke(app, words)
    assert isinstance(again.exception, ConfigError), again.output
    assert "choose another --output, or replace it with --overwrite" in str(again.exception)
    assert files(result) == made
    replaced = CliRunner().invoke(app, [*words, "--overwrite"])
    assert (replaced.exit_code, replaced.stdout) == (0, first.stdout)
    after = files(result)
    assert after.keys() == made.keys()
    assert all((after[path] == made[path]) == (path in raw) for path in made), "anew, and only what is its own"
    assert not list(result.rglob(".*"))


def test_what_is_no_smooth_result_is_never_replaced_by_one(result, tmp_path):
    """Neither the run nor any other folder, whatever is asked for."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("years of work")
    before = files(tmp_path)
    for output in (result, tmp_path / "mine", tmp_path):
        words = ["result", "smooth", str(result), "--output", str(output), "--overwrite"]
        assert "is not empty: choose another --output" in str(CliRunner().invoke(app, words).exception)
    assert files(tmp_path) == before


def test_a_smooth_result_is_replaced_with_what_was_made_of_it(result):
    smooth = ["result", "smooth", str(result)]
    assert CliRunner().invoke(app, smooth).exit_code == 0
    assert CliRunner().invoke(app, ["result", "export", str(result / "smoothed"), "--to", "trc"]).exit_code == 0
    assert (result / "smoothed" / "exports" / "person1.trc").is_file()
    assert CliRunner().invoke(app, [*smooth, "--overwrite", "--use", "spline"]).exit_code == 0
    assert not (result / "smoothed" / "exports").exists(), "it was of other poses"


@pytest.mark.parametrize("earlier", EARLIER)
def test_an_earlier_spelling_says_the_new_one(earlier):
    done = CliRunner().invoke(app, [earlier, "--help"])
    assert done.exit_code == 0
    now = "bodytrack run --batch" if earlier == "batch" else f"bodytrack result {earlier}"
    assert done.stderr.splitlines() == [f"look: `bodytrack {earlier}` is called `{now}` now"]
    assert f"Usage: root {' '.join(now.removesuffix(' --batch').split()[1:])} " in done.stdout
    assert f" {earlier} " not in CliRunner().invoke(app, ["--help"]).stdout


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "smooth"])
def test_an_earlier_spelling_writes_where_and_as_often_as_it_did(command, result):
    raw = set(files(result))
    for _ in range(2):
        done = CliRunner().invoke(app, asked(command, result))
        assert done.exit_code == 0, done.output
        assert len(done.stderr.splitlines()) == 1
    new = set(files(result)) - raw
    assert new
    assert all(Path(path).parent == result for path in new)
    listed = ["export", str(result), "--to", "trc", "wide_table"]
    assert CliRunner().invoke(app, listed).exit_code == 0


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (["run", "anna", "bert"], {"anna", "bert"}),
        (["run", "anna", "--batch"], {"anna"}),
        (["run", "anna", "--jobs", "2"], {"anna"}),
        (["batch", "anna"], {"anna"}),
    ],
)
def test_several_recordings_are_tracked_side_by_side(words, names, recordings, tmp_path, monkeypatch):
    def work(self, tasks):
        return (Summary(task.name, task.folder, "done", n_frames=4, seconds=1.0) for task in tasks)

    monkeypatch.setattr(Processes, "work", work)
    paths = dict(zip(("anna", "bert"), recordings, strict=True))
    done = CliRunner().invoke(app, [*(paths.get(word, word) for word in words), "--output", str(tmp_path / "study")])
    assert done.exit_code == 0, done.output
    rows = (tmp_path / "study" / "batch.csv").read_text().splitlines()[1:]
    assert {row.split(",")[0] for row in rows} == names


def test_what_several_recordings_would_take_is_not_told(recordings):
    told = str(CliRunner().invoke(app, ["run", *recordings, "--dry-run"]).exception)
    assert told == "--dry-run takes one configuration at a time, without --batch, --jobs and --scheduler"
