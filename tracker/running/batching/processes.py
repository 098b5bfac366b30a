"""Processes of this machine, a fresh one for each recording."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

import pydantic

from tracker.foundation.configuration.components import component
from tracker.running.batching import THREADS, Summary, Task, do, n_cores


@component
class Processes:
    """As many processes as cores; one that crashes or runs out of memory does not affect the others."""

    jobs: int = pydantic.Field(default_factory=n_cores, ge=1)
    """Recordings tracked at a time."""

    def work(self, tasks: Sequence[Task]) -> Iterator[Summary]:
        """Begins the next task as soon as one ends; Ctrl-C lets each process finish its frame."""
        waiting, running = list(tasks)[::-1], dict[Connection, tuple[Task, SpawnProcess]]()
        while waiting or running:
            try:
                while waiting and len(running) < self.jobs:
                    task = waiting.pop()
                    answer, process = _begun(task)
                    running[answer] = task, process
                ready = wait(list(running))
            except KeyboardInterrupt:
                waiting.clear()
                for _, process in running.values():
                    if process.pid is not None and process.is_alive():
                        os.kill(process.pid, signal.SIGINT)
                continue
            for answer in [answer for answer in running if answer in ready]:
                task, process = running.pop(answer)
                yield _ended(task, process, answer)


def _begun(task: Task) -> tuple[Connection, SpawnProcess]:
    """A process that runs a task, and its answer."""
    context = multiprocessing.get_context("spawn")
    answer, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(task, theirs), name=task.name)
    with _environment():
        process.start()
    theirs.close()
    return answer, process


def _work(task: Task, answer: Connection) -> None:
    """Runs a task in its own process; only the first process gets the terminal's Ctrl-C, and passes it on."""
    with contextlib.suppress(OSError):
        os.setpgid(0, 0)
    answer.send(do(task))
    answer.close()


def _ended(task: Task, process: SpawnProcess, answer: Connection) -> Summary:
    """Answer of a process, or how it ended without one."""
    try:
        summary: Summary = answer.recv()
    except EOFError:
        process.join()
        code = process.exitcode or 0
        how = f"signal {-code}" + (", perhaps out of memory" if code == -signal.SIGKILL else "")
        fault = f"the process was ended by {how}" if code < 0 else f"the process ended with code {code}"
        summary = Summary(task.name, task.folder, "failed", fault=fault)
    answer.close()
    process.join()
    return summary


@contextlib.contextmanager
def _environment() -> Iterator[None]:
    """Gives one thread to the libraries of processes started meanwhile."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(THREADS)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
