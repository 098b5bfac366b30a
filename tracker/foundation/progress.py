"""Progress of a piece of work: the only way in which the library reports, because it never prints."""

from __future__ import annotations

import html
import importlib
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

WARNING = "input: "
"""Begin of a message that stays visible: the input may be wrong."""


def in_words(seconds: float) -> str:
    """A duration in words: `40 s`, `2 min 10 s`."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


class Progress(Protocol):
    """Receives the progress of a piece of work."""

    def __call__(self, what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        """Notes the progress, and returns soon.

        Args:
            what: the work, e.g. `tracking`; alone it is a message.
            done: how much of it is done.
            total: amount of work; 0 if nothing is counted.
            detail: further information, e.g. `12.5 frames/s`.
        """


def within(progress: Progress, label: str) -> Progress:
    """A progress that names the step it belongs to."""

    def labelled(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        progress(f"{label}: {what}", done, total, detail)

    return labelled


class Tally:
    """Counts pieces of work as any thread begins them, and reports `pose 5 of 12`."""

    def __init__(self, progress: Progress, piece: str, total: int = 0) -> None:
        """Nothing is begun.

        Args:
            progress: gets each piece.
            piece: name of a piece.
            total: number of pieces, as far as known.
        """
        self._progress, self._piece, self._total = progress, piece, total
        self._begun, self._lock = 0, threading.Lock()

    def expect(self, n: int) -> None:
        """There are n more."""
        with self._lock:
            self._total += n

    def begin(self) -> None:
        """One more is begun."""
        with self._lock:
            self._begun += 1
            told = f"{self._piece} {self._begun} of {max(self._begun, self._total)}"
        self._progress(told)


def silent(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
    """Reports to nobody."""


def shown() -> Progress:
    """A bar below the cell of a Jupyter notebook; elsewhere nothing."""
    ipython = sys.modules.get("IPython")
    if ipython is None or not hasattr(ipython.get_ipython(), "kernel"):
        return silent
    return NotebookProgress(importlib.import_module("IPython.display").display)


_BETWEEN_S = 0.2
"""Time between two pictures of a bar: a browser draws no more, and tracking waits for none."""

_MOST_LINES = 8
"""Number of lines below a cell: the last steps of the work."""


class NotebookProgress:
    """A line with a bar for each step of the work, below the cell of a notebook; warnings stay above them."""

    def __init__(self, display: Callable[..., Any]) -> None:
        """Shows nothing yet.

        Args:
            display: IPython's function.
        """
        self._display = display
        self._handle: Any = None
        self._warnings: list[str] = []
        self._steps: dict[str, tuple[int, int, str]] = {}
        self._message = ""
        self._drawn_s = 0.0

    def __call__(self, what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        """Notes the progress, and draws if the last picture is old, a step ends, or a message comes."""
        if total:
            self._steps[what] = done, total, detail
            self._message = ""
        elif what.startswith(WARNING):
            self._warnings.append(what)
        else:
            self._message = what
        if total == 0 or done >= total or time.monotonic() - self._drawn_s > _BETWEEN_S:
            self._draw()

    def _draw(self) -> None:
        self._drawn_s = time.monotonic()
        steps = list(self._steps.items())[-_MOST_LINES:]
        plain = [*self._warnings, *(f"{what}: {n} of {of} {detail}".strip() for what, (n, of, detail) in steps)]
        lines = [html.escape(line) for line in self._warnings]
        lines += [
            f'<progress value="{n}" max="{of}"></progress> {html.escape(f"{what}: {n} of {of} {detail}")}'
            for what, (n, of, detail) in steps
        ]
        if self._message:
            plain.append(self._message)
            lines.append(html.escape(self._message))
        content = {"text/plain": "\n".join(plain), "text/html": "<br>".join(lines)}
        if self._handle is None:
            self._handle = self._display(content, raw=True, display_id=True)
        else:
            self._handle.update(content, raw=True)
