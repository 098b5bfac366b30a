"""Jobs: what a configuration describes, and its execution into a folder; one file a job."""

from __future__ import annotations

import logging
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import tomli_w

from tracker.foundation.configuration.components import available, find
from tracker.foundation.configuration.tables import Table, build_class, component_name, described_fields
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.files import write_json, write_whole
from tracker.foundation.progress import Progress, silent
from tracker.running.jobs._folder import (
    CONFIG,
    ResultFolder,
    begin_anew,
    check_output,
    interrupted_folder,
    link_latest,
    logged,
    remembered,
)
from tracker.running.jobs._folder import result_folder as _result_folder
from tracker.running.jobs._inputs import INPUTS, Fingerprints, check_inputs, check_same, fingerprints, read_own

__all__ = [
    "CONFIG",
    "INPUTS",
    "Job",
    "ResultFolder",
    "begin_anew",
    "check_inputs",
    "check_same",
    "described",
    "execute",
    "fingerprints",
    "job_from",
    "link_latest",
    "load_job",
    "read_own",
    "versions",
]

log = logging.getLogger("tracker")


@runtime_checkable
class Job(Protocol):
    """A component whose fields are the sections of its configuration."""

    resumable: ClassVar[bool]
    """Whether an interrupted job can be continued; the opened inputs then have the recording as `sequence`."""

    @property
    def name(self) -> str:
        """Name of the results."""
        ...

    def open(self, earlier: Path | None = None) -> Any:
        """Opens and checks all inputs; takes seconds at most.

        Args:
            earlier: result folder of an interrupted job that is continued.

        Returns:
            What `execute` needs of them.

        Raises:
            TrackerError: an input cannot be used.
        """
        ...

    def execute(self, opened: Any, folder: ResultFolder, progress: Progress) -> Any:
        """Computes and writes the results.

        Args:
            opened: the inputs, from `open`.
            folder: the results' folder; the job calls `keep()` with the first result.
            progress: told how far it is.

        Returns:
            What was found, in numbers.

        Raises:
            TrackerError: the results so far stay.
        """
        ...


def load_job(use: str, path: Path, overrides: Sequence[str] = ()) -> Any:
    """Reads the configuration of a job.

    Args:
        use: the job, a file in `tracker/running/jobs/`.
        path: TOML file; relative paths in it start at its folder.
        overrides: `section.key=value`.

    Raises:
        ConfigError: names file, section, key and the nearest valid one.
    """
    return job_from(use, read_own(use, path, overrides), path.name, path.parent, path.stem)


def job_from(use: str, table: Table, source: str, folder: Path, name: str) -> Any:
    """A job from the content of its configuration.

    Args:
        use: the job.
        table: its sections; the key `job` may name the same job.
        source: of the table, for messages.
        folder: where relative paths start.
        name: of the job, if the table has none.

    Raises:
        ConfigError: names section, key and the nearest valid one.
    """
    told = table.get("job", use)
    if told not in available("jobs"):
        raise ConfigError(f'{source}: job = "{told}": no such job; {nearest(str(told), available("jobs"))}')
    if told != use:
        raise ConfigError(
            f'{source}: describes the job "{told}", but "{use}" was asked for; `bodytrack show jobs` lists both'
        )
    sections = {key: value for key, value in table.items() if key != "job"}
    return build_class(find("jobs", use), {"name": name} | sections, source, folder)


def described(job: Job) -> Table:
    """The resolved configuration; `job_from` makes an equal job of it, from any folder."""
    return {"job": component_name(type(job)), **described_fields(job)}


def execute(job: Job, output: Path | None = None, resume: bool = False, progress: Progress = silent) -> Any:
    """Runs a job: opens its inputs, makes its folder, and writes its results there.

    Args:
        job: the job to run.
        output: result folder; None for `results/<name>/<time>`, with the link `latest`.
        resume: continue an interrupted job in `output`, or in the latest folder. The result is the same to the bit on
            the same machine with the same versions of the libraries; elsewhere it differs by rounding.
        progress: told how far it is.

    Returns:
        The job's summary, in numbers.

    Raises:
        TrackerError: the folder is removed if nothing was computed before.
    """
    if resume:
        return _resumed(job, interrupted_folder(job.name, output), progress)
    check_output(job.name, output)
    with remembered() as remarks:
        opened = job.open()
    _tell(remarks, progress)
    with _result_folder(job.name, output) as folder:
        for remark in remarks:
            log.handle(remark)
        write_whole(folder.path / CONFIG, tomli_w.dumps(described(job)))
        if job.resumable:
            folder.inputs = _inputs(job, opened)
            write_json(folder.path / INPUTS, folder.inputs)
        return job.execute(opened, folder, progress)


def _resumed(job: Job, folder: Path, progress: Progress) -> Any:
    if not job.resumable:
        raise ConfigError(f"a job of the kind {component_name(type(job))} cannot be resumed: do it anew")
    check_same(described(job), folder)
    with logged(folder):
        with remembered() as remarks:
            opened = job.open(folder)
        inputs = _inputs(job, opened)
        check_inputs(folder, inputs)
        _tell(remarks, progress)
        write_json(folder / INPUTS, inputs)
        write_whole(folder / CONFIG, tomli_w.dumps(described(job)))
        return job.execute(opened, ResultFolder(folder, latest=False, kept=True, inputs=inputs), progress)


def _inputs(job: Job, opened: Any) -> Fingerprints:
    """Fingerprints of the inputs of a job that can be resumed; nothing for the others."""
    return fingerprints(job, opened.sequence.rig.names) if job.resumable else {}


def _tell(remarks: Sequence[logging.LogRecord], progress: Progress) -> None:
    """Writes what opening the inputs logged before there was a log file."""
    for remark in remarks:
        if remark.levelno >= logging.WARNING:
            progress(remark.getMessage())


def versions() -> dict[str, str]:
    """Versions of the program and its libraries, for the record."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in ("bodytrack", "numpy", "scipy", "opencv-python-headless", "av"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
