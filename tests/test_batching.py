"""Many recordings: checked first, done side by side, broken ones alone, resumed, told in a table."""

from __future__ import annotations

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from typer.testing import CliRunner

import tracker
import tracker.results.smoothed_result
from tracker.foundation.configuration.components import find
from tracker.foundation.errors import ConfigError
from tracker.running.batching import Batch, Summary, Task, do, plan, run
from tracker.running.batching.dask import Dask
from tracker.running.batching.processes import Processes
from tracker.running.cli import app
from tracker.running.jobs import described, execute, load_job
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

GIVEN = [
    "initialization.use=given",
    "initialization.poses=truth_poses.csv",
    "recordings=[{use='csv_table'},{use='journal'},{use='run_json'}]",
    "reading.downscale=1",
    "evidence=contours",
    "estimation=twist_icp",
    "persons.0.shape=model",
    "persons.0.carries=[]",
    "passes=1",
]
"""How persons are tracked is not the matter here; of one pass, each frame is written at once."""


@pytest.fixture(scope="module")
def sequence(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("batch") / "sequence"
    write_sequence(Recipe("arm_swing", seconds=0.24, size=(360, 288)), folder)
    return folder


@pytest.fixture(scope="module")
def written(sequence) -> list[Path]:
    """Three recordings of the same videos; the second one's are cut off."""
    shutil.copytree(sequence, broken := sequence.parent / "broken", dirs_exist_ok=True)
    (broken / "FRONT.mp4").write_bytes(b"no video")
    found = []
    for name, folder in (("anna", sequence), ("bert", broken), ("cleo", sequence)):
        text = (folder / "config.toml").read_text().splitlines()
        lines = [f'name = "{name}"', *(line for line in text if not line.startswith("name"))]
        (folder / f"{name}.toml").write_text("\n".join(lines))
        found.append(folder / f"{name}.toml")
    return found


@pytest.fixture
def configs(written) -> Iterator[list[Path]]:
    """Their configurations, which a test may change."""
    texts = [path.read_text() for path in written]
    yield list(written)
    for path, text in zip(written, texts, strict=True):
        path.write_text(text)


@pytest.fixture(scope="module")
def alone(written, tmp_path_factory) -> Path:
    """The first one's result, of a run on its own."""
    folder = tmp_path_factory.mktemp("alone") / "anna"
    return execute(load_job("track", written[0], GIVEN), folder).folder


class InTurn:
    """Does tasks in this process: that others do them is shown above."""

    def work(self, tasks):
        return map(do, tasks)


def states(summaries):
    return {one.name: one.state for one in summaries}


def table(folder):
    with (folder / "batch.csv").open(newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


@pytest.mark.parametrize("batching", [Processes(jobs=2), Dask(jobs=1)], ids=["processes", "dask"])
def test_a_broken_recording_fails_alone(configs, alone, tmp_path, batching):
    """The other one ends with what it finds on its own, to the last bit."""
    batch = plan(configs[:2], GIVEN, tmp_path / "out")
    if isinstance(batching, Processes):
        killed = Task("killed", {"name": Killing()}, tmp_path / "out" / "killed")
        batch = replace(batch, tasks=(killed, *batch.tasks))
    summaries = {one.name: one for one in run(batch, batching)}
    anna, bert = summaries["anna"], summaries["bert"]
    assert (anna.state, anna.n_frames, anna.n_lost, anna.folder) == ("done", 6, 0, tmp_path / "out" / "anna")
    assert anna.seconds > 0
    assert bert.state == "failed"
    assert "FRONT.mp4" in bert.fault
    assert "\n" not in bert.fault
    assert not bert.folder.exists()
    if isinstance(batching, Processes):
        fault = "the process was ended by signal 9, perhaps out of memory"
        assert (summaries["killed"].state, summaries["killed"].fault) == ("failed", fault)
    rows = table(tmp_path / "out")
    assert (rows["anna"]["state"], rows["anna"]["frames"], rows["bert"]["fault"]) == ("done", "6", bert.fault)
    wanted, found = (tracker.load_result(folder).persons[0].poses for folder in (alone, anna.folder))
    np.testing.assert_array_equal(found, wanted)


def test_all_configurations_are_checked_first(configs, tmp_path):
    configs[0].write_text(configs[0].read_text() + "\n[estimationn]\n")
    copy = configs[2].with_name("dora.toml")
    shutil.copy(configs[2], copy)
    with pytest.raises(ConfigError) as told:
        plan([*configs, copy], GIVEN, tmp_path / "out")
    text = str(told.value)
    assert text.startswith("2 of 4 configurations are wrong, nothing was begun: ")
    assert 'unknown section "estimationn"; did you mean "estimation"' in text
    assert f'{copy}: name = "cleo" as in {configs[2]}' in text
    assert not (tmp_path / "out").exists()


def test_a_batch_is_resumed_folder_by_folder(configs, alone, tmp_path):
    """What is done stays, what was interrupted goes on, what failed is tried again."""
    out = tmp_path / "out"
    shutil.copytree(alone, out / "anna")
    before = (out / "anna" / "steps.jsonl").stat().st_mtime_ns

    def interrupt(what, done=0, total=0, detail=""):
        if what == "tracking" and done == 3:
            raise KeyboardInterrupt

    execute(load_job("track", configs[2], GIVEN), out / "cleo", progress=interrupt)
    with pytest.raises(ConfigError, match="anna is not empty: --resume goes on with it"):
        plan(configs, GIVEN, out)
    batch = plan(configs, GIVEN, out, resume=True)
    assert [(task.name, task.resume) for task in batch.tasks] == [("bert", False), ("cleo", True)]
    assert [(one.name, one.state, one.n_frames) for one in batch.finished] == [("anna", "done", 6)]
    summaries = run(replace(batch, tasks=batch.tasks[1:]), InTurn())
    assert states(summaries) == {"anna": "done", "cleo": "done"}
    assert (out / "anna" / "steps.jsonl").stat().st_mtime_ns == before
    poses = [tracker.load_result(out / name).persons[0].poses for name in ("anna", "cleo")]
    np.testing.assert_array_equal(*poses)
    with pytest.raises(
        ConfigError, match="stride = 1, but 2 is asked for"
    ):  # half of one configuration and half of another
        plan(configs, [*GIVEN, "reading.stride=2"], out, resume=True)


@pytest.mark.parametrize("config", ["", 'name = "other"\n'])
def test_what_was_killed_before_its_first_frame_begins_anew(configs, tmp_path, config):
    """Its configuration may be empty yet, or another one: nothing was computed with it."""
    out = tmp_path / "out"
    (out / "anna" / "models").mkdir(parents=True)
    (out / "anna" / "config.toml").write_text(config)
    batch = plan(configs[:1], GIVEN, out, resume=True)
    assert [(task.resume, task.anew) for task in batch.tasks] == [(False, True)]
    summary = do(batch.tasks[0])
    assert (summary.state, summary.n_frames, summary.fault) == ("done", 6, "")


def test_rows_of_what_is_done_stay_as_they_were(configs, alone, tmp_path):
    """run.json counts persons, not frames, and no seconds; it tells where there is no row of the same frames."""
    out = tmp_path / "out"
    shutil.copytree(alone, out / "anna")
    before = Summary("anna", out / "anna", "done", 6, 2, 1, 3, seconds=1.5)
    run(Batch((), (before,), out), Processes(jobs=1))
    assert plan(configs[:1], GIVEN, out, resume=True).finished == (before,)
    run(Batch((), (replace(before, n_frames=5),), out), Processes(jobs=1))
    assert plan(configs[:1], GIVEN, out, resume=True).finished == (Summary("anna", out / "anna", "done", 6),)


def test_what_is_extended_or_lacks_its_smooth_poses_is_not_done(configs, tmp_path):
    out, short = tmp_path / "out", [*GIVEN, "reading.stop=5"]
    execute(load_job("track", configs[0], short), out / "anna")

    def resumed(overrides):
        return [task.resume for task in plan(configs[:1], overrides, out, resume=True).tasks]

    assert resumed(short) == []
    assert resumed(GIVEN) == [True]
    assert resumed([*GIVEN, "reading.stop=6"]) == [True]
    config = (out / "anna" / "config.toml").read_text()
    with_smoothing = [*short, "smoothing=spline"]
    text = tomli_w.dumps(described(load_job("track", configs[0], with_smoothing)))
    (out / "anna" / "config.toml").write_text(text)  # as it began, and stopped when the raw poses were whole
    assert text != config
    assert resumed(with_smoothing) == [True]
    tracker.results.smoothed_result.write_smoothed(tracker.load_result(out / "anna"), find("smoothing", "spline")())
    assert resumed(with_smoothing) == []


class Killing:
    """Where it is unpickled, the process ends as if memory had run out."""

    def __reduce__(self):
        return _kill, ()


def _kill():
    os.kill(os.getpid(), signal.SIGKILL)


def test_what_is_our_fault_is_told_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("tracker.running.batching.job_from", lambda *_: 1 / 0)
    summary = do(Task("anna", {}, tmp_path))
    assert (summary.state, summary.fault.split(":")[0]) == ("failed", "ZeroDivisionError")


def test_ctrl_c_leaves_usable_results_and_says_what_waits(sequence, tmp_path):
    """Sent to the first process alone, as a terminal would not: it passes it on and waits."""
    long = tmp_path / "long"
    config = write_sequence(Recipe("arm_swing", seconds=1.6, size=(240, 192)), long)
    names = []
    for name in ("anna", "bert", "cleo"):
        text = [line for line in config.read_text().splitlines() if not line.startswith("name")]
        (long / f"{name}.toml").write_text("\n".join([f'name = "{name}"', *text]))
        names.append(str(long / f"{name}.toml"))
    # a search in each frame, so that the last one is far when the signal comes
    overrides = [word for override in (*GIVEN, "estimation=hybrid") for word in ("--set", override)]
    command = [sys.executable, "-m", "tracker", "run", *names, "--jobs", "1", "--output", str(tmp_path / "out")]
    process = subprocess.Popen(
        [*command, *overrides],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ,
        # a shell that runs the tests in the background has its children ignore Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    journal = tmp_path / "out" / "anna" / "steps.jsonl"
    end = time.monotonic() + 600
    while not (journal.is_file() and journal.stat().st_size > 4_000):
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < end
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=600)
    assert process.returncode == 130, output
    rows = table(tmp_path / "out")
    assert {name: row["state"] for name, row in rows.items()} == {
        "anna": "interrupted",
        "bert": "waiting",
        "cleo": "waiting",
    }
    assert 0 < len(tracker.load_result(tmp_path / "out" / "anna").frames) < 40


def test_the_command_tells_a_row_a_recording(configs, tmp_path, monkeypatch):
    monkeypatch.setattr(
        Processes,
        "work",
        lambda self, tasks: (Summary(t.name, t.folder, "failed", fault="broken") for t in tasks),
    )
    arguments = ["run", *map(str, configs), "--output", str(tmp_path / "out"), "--jobs", "3"]
    told = CliRunner().invoke(app, arguments)
    assert told.exit_code == 2, told.output
    for name in ("anna", "bert", "cleo"):
        assert f"{name}: broken" in told.output
    assert "batch.csv" in told.output


def test_a_scheduler_that_does_not_answer_is_one_clear_line(configs, tmp_path):
    with pytest.raises(ConfigError, match=r"--scheduler tcp://127\.0\.0\.1:9: no scheduler answers there"):
        run(plan(configs, GIVEN, tmp_path / "out"), Dask(scheduler="tcp://127.0.0.1:9", timeout_s=1.0))
