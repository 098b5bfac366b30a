"""`bodytrack run` of many recordings."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.table import Table

from tracker.running.commands.terminal import ProgressBar, console

if TYPE_CHECKING:
    from tracker.running.batching import Summary

_FOLDER = Path("results/batch")
"""Of a batch without --output."""


@dataclass(frozen=True)
class Side:
    """How many recordings are tracked side by side, and where."""

    jobs: int | None = None
    """At a time; None: as many as cores."""

    scheduler: str | None = None
    """Address of a Dask scheduler; None: on this machine."""


def track_many(
    configs: Sequence[Path], overrides: Sequence[str], output: Path | None, resume: bool, beside: Side
) -> None:
    """Tracks many recordings side by side; a broken one fails alone."""
    from tracker.foundation.configuration.components import find
    from tracker.running.batching import plan, run

    planned = plan(configs, overrides, output or _FOLDER, resume)
    fields = {name: value for name, value in dataclasses.asdict(beside).items() if value is not None}
    batching = find("batching", "processes" if beside.scheduler is None else "dask")(**fields)
    with ProgressBar() as progress:
        summaries = run(planned, batching, progress)
    _print(summaries)
    console.print(f"results in {planned.folder}, table in batch.csv", highlight=False, soft_wrap=True)
    states = {summary.state for summary in summaries}
    if states & {"interrupted", "waiting"}:
        raise typer.Exit(130)
    if "failed" in states or any(one.n_frames and one.n_lost == one.n_frames for one in summaries):
        raise typer.Exit(2)


def _print(summaries: tuple[Summary, ...]) -> None:
    """A row a recording, and below the table the line of each that failed."""
    table = Table("recording", "state")
    for title in ("frames", "lost", "doubtful", "ambiguous", "frames/s"):
        table.add_column(title, justify="right")
    for one in summaries:
        counts = one.n_frames, one.n_lost, one.n_doubtful, one.n_ambiguous
        rate = f"{one.n_frames / one.seconds:.1f}" if one.seconds and one.n_frames else ""
        style = {"done": "", "failed": "red"}.get(one.state, "yellow")
        table.add_row(one.name, one.state, *(map(str, counts) if one.n_frames else [""] * 4), rate, style=style)
    console.print(table)
    for one in summaries:
        if one.fault:
            console.print(f"{one.name}: {one.fault}", style="red", highlight=False, soft_wrap=True)
