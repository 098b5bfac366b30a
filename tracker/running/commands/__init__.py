"""Commands of the command line that have a file of their own."""

from __future__ import annotations

import io
import logging
import os
import re
import sys
import warnings
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any

import typer
from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Column
from rich.text import Text

from tracker.foundation.errors import ConfigError, os_fault
from tracker.foundation.progress import WARNING

console = Console(markup=False, emoji=False)
"""Prints a text as it stands: names and paths may hold `[...]` or `:...:`."""


def marked(word: str, text: str) -> Text:
    """A line that begins with a word in yellow."""
    return Text.assemble((f"{word}:", "yellow"), f" {text}")


def print_error(told: str | Exception) -> None:
    """Prints one line on the standard error; signs that move the cursor or begin a line are written out."""
    text = os_fault(told) if isinstance(told, OSError) else str(told)
    plain = "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)
    Console(stderr=True).print(Text.assemble(("error:", "bold red"), f" {plain}"), soft_wrap=True, highlight=False)


def print_any_sign() -> None:
    """Writes out signs that the terminal's encoding lacks, as a log does; otherwise a name would end a run."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def quiet_libraries() -> None:
    """Keeps warnings of libraries off the terminal: decoders of pictures in C, numpy, matplotlib, FFmpeg.

    What this program logs appears as a line of its own if no file takes it. The compiled code's standard error goes
    nowhere; from now on only Python writes there.
    """
    if not sys.warnoptions:  # whoever asks Python for warnings gets them
        warnings.simplefilter("ignore")
    logging.lastResort = _Remarks(logging.WARNING)
    try:
        ours = os.dup(2)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        os.close(nowhere)
    except OSError:  # no standard error at all
        return
    kept = sys.stderr.encoding, sys.stderr.errors
    sys.stderr = open(ours, "w", buffering=1, encoding=kept[0], errors=kept[1])  # noqa: PTH123, SIM115 - till the end


class _Remarks(logging.Handler):
    """Prints what this program logs, and nothing of libraries."""

    def emit(self, record: logging.LogRecord) -> None:
        if record.name.partition(".")[0] == "tracker":
            Console(stderr=True).print(marked("look", record.getMessage()), soft_wrap=True, highlight=False)


_WIDE = 100
"""Columns of a terminal that show bar and detail in one line."""


class _Bars(Progress):
    """Bars with their details behind them, or below them on a narrow terminal."""

    def __init__(self, *columns: ProgressColumn, console: Console) -> None:
        self._shown_on = console
        super().__init__(*columns, console=console, expand=True)

    def get_renderables(self) -> Iterable[RenderableType]:
        """The lines that are drawn."""
        if self._shown_on.width >= _WIDE:
            yield self.make_tasks_table(self.tasks)
            return
        bar, self.columns = self.columns, tuple(one for one in self.columns if one is not _DETAIL)
        try:
            for task in self.tasks:
                yield self.make_tasks_table([task])
                if (detail := task.fields["detail"]) and not task.finished:
                    yield Text(f"  {detail}", no_wrap=True, overflow="ellipsis")
        finally:
            self.columns = bar


_DETAIL = TextColumn("{task.fields[detail]}", markup=False, table_column=Column(no_wrap=True, ratio=1))


class _Count(MofNCompleteColumn):
    """How many of how many; empty if nothing is counted."""

    def render(self, task: Task) -> Text:
        """The two numbers."""
        return Text() if task.total is None else super().render(task)


_NUMBER = re.compile(r"\d+")


class ProgressBar:
    """A bar for each thing that is counted; a `tracker.foundation.progress.Progress`.

    A message is a line of its own before anything is counted, and stands beside the bar meanwhile. If only its numbers
    changed, it moves along in the last line. A warning is always a line that stays.
    """

    def __init__(self, shown_on: Console = console) -> None:
        self._console = shown_on
        self._bar = _Bars(
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True)),
            BarColumn(bar_width=20),
            _Count(),
            _DETAIL,
            TimeElapsedColumn(),
            console=shown_on,
        )
        self._task: TaskID | None = None
        self._passing: TaskID | None = None
        self._told: set[str] = set()

    def __enter__(self) -> ProgressBar:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._let_pass()
        self._bar.stop()

    def __call__(self, what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        """Shows how far a step is. A step that begins again gets a new bar."""
        if total == 0:
            self._message(what)
            return
        self._let_pass()
        task = self._counted()
        if self._task is None or task is None or task.description != what or done < task.completed:
            if self._task is not None:
                self._bar.stop_task(self._task)
            self._task = self._bar.add_task(what, total=total, detail=detail)
        self._bar.update(self._task, completed=done, total=total, detail=detail)

    def _message(self, text: str) -> None:
        task, stem = self._counted(), _NUMBER.sub("", text)
        if text.startswith(WARNING):
            self._console.print(text, highlight=False, markup=False, soft_wrap=True)
        elif self._task is not None and task is not None and not task.finished:
            self._bar.update(self._task, detail=text)
        elif stem in self._told:
            if self._passing is None:
                self._passing = self._bar.add_task(text, total=None, detail="")
            self._bar.update(self._passing, description=text)
        else:
            self._told.add(stem)
            self._let_pass()
            self._console.print(text, highlight=False, markup=False, soft_wrap=True)

    def _counted(self) -> Task | None:
        """What is counted now, or was last."""
        return next((task for task in self._bar.tasks if task.id == self._task), None)

    def _let_pass(self) -> None:
        if self._passing is not None:
            self._bar.remove_task(self._passing)
            self._passing = None


Config = Annotated[Path, typer.Argument(help="Configuration, TOML.")]
Output = Annotated[Path | None, typer.Option(help="Result folder; default results/NAME/TIME.")]
_OVERRIDE = "Override: section.key=value, paths relative to the configuration's folder; repeatable."
Overrides = Annotated[list[str] | None, typer.Option("--set", help=_OVERRIDE)]
Frames = Annotated[str | None, typer.Option(help="Range A:B of frames; either end may be left out.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is there already.")]
"""Option of the commands that work on results: they replace nothing unasked."""


def with_range(overrides: list[str] | None, frames: str | None) -> list[str]:
    """The overrides, with those that choose a range of frames.

    Raises:
        ConfigError: the text is no such range.
    """
    chosen = list(overrides or [])
    if frames is not None:
        match = re.fullmatch(r"(\d*):(\d*)", frames)
        if match is None:
            raise ConfigError(f"--frames {frames}: expected A:B, for instance 0:100, 50: or :100")
        ends = zip(("start", "stop"), match.groups(), strict=True)
        chosen += [f"reading.{key}={int(end)}" for key, end in ends if end]
    return chosen


def done(job: Any, output: Path | None = None, resume: bool = False) -> Any:
    """Does a job while a bar shows how far it is."""
    # what computes takes long to import, which `bodytrack --help` need not wait for
    from tracker.running.jobs import execute

    with ProgressBar() as progress:
        return execute(job, output, resume, progress)
