"""Batching: tracks many recordings side by side, each in its own process."""

from __future__ import annotations

import csv
import io
import json
import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

import cv2

from tracker.foundation.errors import ConfigError, TrackerError, os_fault
from tracker.foundation.files import write_whole
from tracker.foundation.progress import Progress, silent
from tracker.results.recording.journal import FILE, Journal
from tracker.results.smoothed_result import FOLDER as SMOOTHED
from tracker.running.jobs import CONFIG, begin_anew, check_same, described, execute, job_from, load_job
from tracker.running.jobs.track import TrackJob, TrackOutcome

State = Literal["done", "interrupted", "failed", "waiting"]
TABLE = "batch.csv"
"""File in the folder of the batch."""

_COLUMNS = "name", "state", "frames", "lost", "doubtful", "with_ambiguous_limbs", "seconds", "folder", "fault"


@dataclass(frozen=True)
class Summary:
    """Outcome of one recording."""

    name: str
    folder: Path
    state: State
    n_frames: int = 0
    n_lost: int = 0
    n_doubtful: int = 0
    n_ambiguous: int = 0
    """Frames in which a limb is ambiguous or a person doubtful."""

    seconds: float = 0.0
    fault: str = ""
    """Why it failed, in one line."""


def earlier_rows(path: Path) -> dict[str, dict[str, str]]:
    """The rows of an earlier batch's table by their names; empty if it cannot be read."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return {row["name"]: row for row in csv.DictReader(file)}
    except (OSError, ValueError, KeyError, csv.Error):
        return {}


def finished(name: str, folder: Path, row: dict[str, str], asked: Mapping[str, Any]) -> Summary | None:
    """The summary of a complete run; None for any other, such as a run that shall be extended.

    Args:
        name: of the recording.
        folder: of the run.
        row: its row in an earlier table: run.json counts persons rather than frames, and has no seconds.
        asked: its present resolved configuration.
    """
    try:
        told = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        summary = told["summary"]
        if not told["complete"] or told["config"]["reading"].get("stop") != asked["reading"].get("stop"):
            return None
        if "smoothing" in asked and not (folder / SMOOTHED / "run.json").is_file():  # it is made last
            return None
        if row.get("state") == "done" and row.get("frames") == str(summary["frames"]):
            n_lost, n_doubtful, n_ambiguous = (int(row[column]) for column in _COLUMNS[3:6])
            return Summary(
                name, folder, "done", summary["frames"], n_lost, n_doubtful, n_ambiguous, float(row["seconds"])
            )
        counts, n_ambiguous = Counter(summary.get("by_status", {})), summary.get("frames_with_ambiguous_limbs", 0)
        return Summary(name, folder, "done", summary["frames"], counts["lost"], counts["doubtful"], n_ambiguous)
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        return None


def write_table(path: Path, summaries: Iterable[Summary]) -> None:
    """Replaces the table as a whole; rows are sorted by name."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(_COLUMNS)
    for one in sorted(summaries, key=lambda summary: summary.name):
        counts = one.n_frames, one.n_lost, one.n_doubtful, one.n_ambiguous
        writer.writerow([one.name, one.state, *counts, f"{one.seconds:.1f}", one.folder, one.fault])
    write_whole(path, text.getvalue())


__all__ = [
    "TABLE",
    "THREADS",
    "Batch",
    "Batching",
    "State",
    "Summary",
    "Task",
    "do",
    "n_cores",
    "plan",
    "run",
]

THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of a process with one core: libraries that take all cores obstruct each other."""


@dataclass(frozen=True)
class Task:
    """One recording of a batch, completely resolved: any machine can track it."""

    name: str
    table: dict[str, Any]
    """Its configuration, paths absolute."""

    folder: Path
    """Its result folder, absolute."""

    resume: bool = False
    """Whether an interrupted run lies there."""

    anew: bool = False
    """Whether the run there stopped before its first frame, so that there is nothing to resume."""


@runtime_checkable
class Batching(Protocol):
    """A component that runs tasks on some machine."""

    def work(self, tasks: Sequence[Task]) -> Iterator[Summary]:
        """Runs tasks, each by `do`; a failed task does not stop the others.

        Args:
            tasks: the recordings.

        Yields:
            One summary a task as soon as it ends, in any order; after Ctrl-C those of the tasks begun.
        """
        ...


@dataclass(frozen=True)
class Batch:
    """The recordings to track, with all configurations checked."""

    tasks: tuple[Task, ...]
    finished: tuple[Summary, ...]
    """Recordings that an earlier batch has finished."""

    folder: Path


def plan(configs: Sequence[Path], overrides: Sequence[str], folder: Path, resume: bool = False) -> Batch:
    """Checks all configurations and plans the batch.

    Args:
        configs: of the recordings.
        overrides: `section.key=value`, for all of them.
        folder: of the batch; each recording's result is a folder in it, named after the recording.
        resume: leave out finished recordings, continue interrupted ones.

    Raises:
        ConfigError: some configurations are wrong, two have the same name, or there are results already.
    """
    jobs = _checked(configs, overrides)
    target = folder.resolve()
    tasks, done, before = [], [], earlier_rows(target / TABLE)
    for name, job in jobs.items():
        here = target / name
        begun = here.is_dir() and any(here.iterdir())
        if begun and not resume:
            raise ConfigError(f"{here} is not empty: --resume goes on with it, or choose another --output")
        anew = begun and _nothing_computed(job, here)
        if begun and not anew:
            check_same(described(job), here)
        if begun and (summary := finished(name, here, before.get(name, {}), described(job))):
            done.append(summary)
        else:
            tasks.append(Task(name, described(job), here, resume=begun and not anew, anew=anew))
    return Batch(tuple(tasks), tuple(done), target)


def _checked(configs: Sequence[Path], overrides: Sequence[str]) -> dict[str, TrackJob]:
    """The job of each configuration by its name; reports all faults at once."""
    jobs: dict[str, TrackJob] = {}
    whose: dict[str, Path] = {}
    faults = []
    for path in configs:
        try:
            job = load_job("track", path, overrides)
        except TrackerError as error:
            faults.append(f"{path}: {error}")
            continue
        if job.name in jobs:
            faults.append(f'{path}: name = "{job.name}" as in {whose[job.name]}: the results would be mixed')
        jobs[job.name], whose[job.name] = job, path
    if faults:
        raise ConfigError(
            f"{len(faults)} of {len(configs)} configurations are wrong, nothing was begun: {'; '.join(faults)}"
        )
    return jobs


def _nothing_computed(job: TrackJob, folder: Path) -> bool:
    """Whether a run was killed before it began its journal; False for a run that keeps none."""
    keeps_journal = any(isinstance(recording, Journal) for recording in job.recordings)
    begun = any((folder / name).exists() for name in (FILE, "poses.csv"))
    return keeps_journal and (folder / CONFIG).is_file() and not begun


def do(task: Task) -> Summary:
    """Tracks one recording; every fault is in the summary, none is raised."""
    cv2.setNumThreads(1)
    begin = time.perf_counter()
    try:
        job = job_from("track", task.table, task.name, Path("/"), task.name)
        if task.anew:
            begin_anew(task.folder)
        return _summary(task, execute(job, task.folder, task.resume))
    except KeyboardInterrupt:
        return Summary(task.name, task.folder, "interrupted", seconds=time.perf_counter() - begin)
    except TrackerError as error:
        fault = str(error)
    except OSError as error:
        fault = os_fault(error)
    except Exception as error:
        fault = f"{type(error).__name__}: {error}: a fault of bodytrack; run it alone with --debug"
    return Summary(task.name, task.folder, "failed", seconds=time.perf_counter() - begin, fault=" ".join(fault.split()))


def _summary(task: Task, outcome: TrackOutcome) -> Summary:
    doubts = outcome.doubts
    ambiguous = {frame for frames in doubts.ambiguous.values() for frame in frames}
    state: State = "interrupted" if outcome.interrupted else "done"
    found = outcome.n_frames, len(doubts.lost), len(doubts.doubtful), len(ambiguous)
    return Summary(task.name, task.folder, state, *found, seconds=outcome.seconds)


def run(batch: Batch, batching: Batching, progress: Progress = silent) -> tuple[Summary, ...]:
    """Tracks all recordings; `batch.csv` shows the progress at any time.

    Args:
        batch: the planned batch.
        batching: runs the tasks.
        progress: gets the number of finished recordings.

    Returns:
        A summary of each recording, in the order of their names; `waiting` if Ctrl-C came before it began.
    """
    batch.folder.mkdir(parents=True, exist_ok=True)
    summaries = {task.name: Summary(task.name, task.folder, "waiting") for task in batch.tasks}
    summaries |= {summary.name: summary for summary in batch.finished}
    write_table(batch.folder / TABLE, summaries.values())
    n_tasks = len(batch.tasks)
    progress("recordings", 0, n_tasks)
    for n_done, summary in enumerate(batching.work(batch.tasks), start=1):
        summaries[summary.name] = summary
        progress("recordings", n_done, n_tasks, f"{summary.name} {summary.state}")
        write_table(batch.folder / TABLE, summaries.values())
    return tuple(summaries[name] for name in sorted(summaries))


def n_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
