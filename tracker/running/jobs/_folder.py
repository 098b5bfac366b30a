"""Result folders: each belongs to one job, and stays only if the job computed something."""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import TextIO

from tracker.foundation.errors import ConfigError, SequenceError, name_fault
from tracker.foundation.files import check_empty

_SIGNALS = signal.SIGINT, signal.SIGTERM


class Stop:
    """Whether a job shall stop."""

    def __init__(self) -> None:
        self.asked = False
        self.patient = False
        """Whether there is a frame to finish; otherwise the first request ends the job."""

    def heard(self) -> bool:
        """Whether it was asked to stop; the job then ends soon, with what it has."""
        self.patient = True
        return self.asked

    def ask(self, number: int = 0, frame: FrameType | None = None) -> None:
        """Asks it to stop; a second request does not wait.

        Raises:
            KeyboardInterrupt: it was asked before, or there is nothing to finish.
        """
        if self.asked or not self.patient:
            raise KeyboardInterrupt
        self.asked = True


@contextlib.contextmanager
def stopping(stop: Stop | None = None) -> Iterator[Stop]:
    """Takes signals as a request to stop, except in a thread of another program, which decides itself."""
    stop = stop or Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = [(number, signal.signal(number, stop.ask)) for number in _SIGNALS]
    try:
        yield stop
    finally:
        for number, handler in before:
            signal.signal(number, handler)


CONFIG = "config.toml"
"""The resolved configuration in a result folder; the job that creates it owns the folder."""

LOG = "log.txt"

log = logging.getLogger("tracker")


@dataclass
class ResultFolder:
    """A folder that one job writes to."""

    path: Path
    latest: bool
    """Whether the link `latest` beside it shall point at it."""

    kept: bool = False
    inputs: Mapping[str, str] = field(default_factory=dict)
    """Fingerprints of the files that the job reads."""

    def keep(self) -> None:
        """The job has computed something: from now on its files stay, whatever happens."""
        if not self.kept:
            self.kept = True
            if self.latest:
                link_latest(self.path)


def check_output(name: str, output: Path | None) -> None:
    """Refuses an output that cannot be a result folder, before the job computes anything.

    Args:
        name: of the job.
        output: the folder asked for; None for a dated one.

    Raises:
        ConfigError: it is a file or not empty, or no folder can have the name.
    """
    if fault := name_fault(name):
        raise ConfigError(f"name = {fault}; results go to results/NAME/TIME")
    if output is not None:
        check_empty(output)


def interrupted_folder(name: str, output: Path | None) -> Path:
    """The folder of the run to resume: the output, or the latest one of that name.

    Raises:
        SequenceError: there is none.
        ConfigError: no folder can have the name.
    """
    if fault := name_fault(name):
        raise ConfigError(f"name = {fault}")
    folder = output or Path("results") / name / "latest"
    if not folder.is_dir():
        raise SequenceError(f"{folder}: no run to resume there; run without --resume")
    return folder.resolve()


@contextlib.contextmanager
def result_folder(name: str, output: Path | None) -> Iterator[ResultFolder]:
    """Makes a folder for the job; if the job fails before `keep()`, everything is as it was before.

    Args:
        name: of the job.
        output: the folder; None for `results/NAME/TIME`, with a number if another job has that folder.

    Raises:
        ConfigError: the folder holds something, or another job has just taken it.
    """
    check_output(name, output)
    wanted = Path("results") / name / time.strftime("%Y-%m-%d_%H-%M-%S") if output is None else output
    missing = [path for path in (wanted, *wanted.parents) if not path.exists()]
    folder = ResultFolder(_new(wanted) if output is None else _claimed(wanted), latest=output is None)
    try:
        with logged(folder.path):
            yield folder
        folder.keep()
    finally:
        if not folder.kept:
            _emptied(folder.path)
            for path in (folder.path, *missing):
                with contextlib.suppress(OSError):  # another job may have put something there meanwhile
                    if path == folder.path and wanted not in missing:
                        continue
                    path.rmdir()


def _new(wanted: Path) -> Path:
    """A folder that no other job has: creating it succeeds, or fails if it exists."""
    path, k = wanted, 1
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.mkdir()
            (path / CONFIG).touch(exist_ok=False)
            return path
        except FileExistsError:
            k += 1
            path = wanted.with_name(f"{wanted.name}_{k}")
        except FileNotFoundError:  # a job that failed has just removed the parent
            continue


def _claimed(output: Path) -> Path:
    output.mkdir(parents=True, exist_ok=True)
    try:
        (output / CONFIG).touch(exist_ok=False)
    except FileExistsError as error:
        raise ConfigError(f"{output} is not empty: another job began there just now; choose another one") from error
    return output


def begin_anew(folder: Path) -> None:
    """Removes the folder of a job that was stopped before it computed anything.

    Raises:
        ConfigError: another job is at work there.
    """
    with logged(folder):
        _emptied(folder)


def _emptied(folder: Path) -> None:
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def link_latest(folder: Path) -> None:
    """Points the link `latest` beside a folder at it, in one step."""
    link = folder.parent / "latest"
    with contextlib.suppress(OSError):  # a file system without links has no `latest`
        scratch = Path(tempfile.mkdtemp(prefix=".latest-", dir=folder.parent))
        try:
            (scratch / "latest").symlink_to(folder.name)
            os.replace(scratch / "latest", link)  # noqa: PTH105 - Path.replace says the same
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


@contextlib.contextmanager
def logged(folder: Path) -> Iterator[None]:
    """Writes the log to `log.txt` in a folder, and keeps other jobs out of it meanwhile.

    Raises:
        ConfigError: another job is at work there.
    """
    with (folder / LOG).open("a", encoding="utf-8") as file:
        _lock(file, folder)
        handler = _Log(file)
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        log.addHandler(handler)
        log.setLevel(logging.INFO)
        try:
            yield
        finally:
            log.removeHandler(handler)


class _Log(logging.StreamHandler[TextIO]):
    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the library's name
        """The job reports a full disk where it writes results; the log shows no tracebacks of its own."""


def _lock(file: TextIO, folder: Path) -> None:
    """Locks a file until it is closed, or until the process ends, however it ends."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ConfigError(f"{folder}: a job is at work there; wait for it, or choose another --output") from error
    except OSError:  # a file system without locks
        return


@contextlib.contextmanager
def remembered() -> Iterator[list[logging.LogRecord]]:
    """Keeps log messages until there is a folder for them."""
    handler = _Memory()
    log.addHandler(handler)
    try:
        yield handler.records
    finally:
        log.removeHandler(handler)


class _Memory(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.records: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.records.append(record)
