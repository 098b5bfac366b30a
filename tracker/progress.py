"""Progress on the terminal."""

from __future__ import annotations

from collections import Counter, deque
from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tracker.run import Run
from tracker.trajectory import Step


class RunProgress:
    """A progress bar with frames/s and the time each stage takes; an `Observer` of a run."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[detail]}"),
            TimeRemainingColumn(),
            console=console,
        )
        self._task: TaskID | None = None
        self._recent: deque[dict[str, float]] = deque(maxlen=25)
        self._lost = 0
        self._rate = ""

    def __enter__(self) -> RunProgress:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._task is not None and self._rate:
            self._bar.update(self._task, detail=self._rate)
        self._bar.stop()

    def counted(self, what: str, done: int, total: int) -> None:
        """Shows a count of something that is not tracking."""
        if self._task is None or self._bar.tasks[-1].description != what:
            self._task = self._bar.add_task(what, total=total, detail="")
        self._bar.update(self._task, completed=done, total=total)

    def started(self, run: Run, n_frames: int, folder: Path) -> None:
        """Shows the bar."""
        self._console.print(f"{run.name}: {n_frames} frames, results in {folder}", highlight=False)
        self._task = self._bar.add_task("tracking", total=n_frames, detail="")

    def stepped(self, step: Step) -> None:
        """Advances the bar."""
        self._recent.append(step.seconds)
        self._lost += any(estimate.lost for estimate in step.estimates)
        total = Counter[str]()
        for seconds in self._recent:
            total.update(seconds)
        n = len(self._recent)
        stages = " ".join(f"{stage} {1000 * value / n:.0f}" for stage, value in total.most_common(3))
        rate = n / max(sum(total.values()), 1e-9)
        lost = f", {self._lost} lost" if self._lost else ""
        self._rate = f"{rate:.1f} frames/s ({stages} ms){lost}"
        if self._task is not None:
            self._bar.update(self._task, advance=1, detail=self._rate)

    def told(self, message: str) -> None:
        """Shows what takes long or is worth knowing."""
        if message.startswith("synthesis:"):
            self._console.print(message, highlight=False)
        elif self._task is not None:
            self._bar.update(self._task, detail=message)


class CountedProgress:
    """A progress bar for each step of something that is not tracking."""

    def __init__(self, console: Console) -> None:
        columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
        self._bar = Progress(*columns, console=console)
        self._task: TaskID | None = None

    def __enter__(self) -> CountedProgress:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def told(self, what: str, done: int, total: int) -> None:
        """Shows how far a step is; a step that begins again gets a bar of its own."""
        task = None if self._task is None else self._bar.tasks[self._task]
        if self._task is None or task is None or task.description != what or done < task.completed:
            if self._task is not None:
                self._bar.stop_task(self._task)
            self._task = self._bar.add_task(what, total=total)
        self._bar.update(self._task, completed=done, total=total)
