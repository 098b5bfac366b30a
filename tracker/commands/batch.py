"""`bodytrack batch`: many recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from tracker.commands.options import Overrides
from tracker.commands.terminal import ProgressBar, console

if TYPE_CHECKING:
    from tracker.batching import Summary


def batch(
    configs: Annotated[list[Path], typer.Argument(help="Configurations of the recordings, TOML.")],
    output: Annotated[Path, typer.Option(help="Folder of the batch; results go to OUTPUT/NAME.")] = Path(
        "results/batch"
    ),
    jobs: Annotated[int | None, typer.Option(min=1, help="Recordings at a time; default: as many as cores.")] = None,
    resume: Annotated[bool, typer.Option(help="Leave out what is finished, continue what was interrupted.")] = False,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler, tcp://HOST:8786.")] = None,
    set_: Overrides = None,
) -> None:
    """Tracks many recordings side by side; a broken one fails alone."""
    from tracker.batching import plan, run
    from tracker.components import find

    planned = plan(configs, set_ or (), output, resume)
    fields: dict[str, Any] = {} if jobs is None else {"jobs": jobs}
    fields |= {} if scheduler is None else {"scheduler": scheduler}
    batching = find("batching", "processes" if scheduler is None else "dask")(**fields)
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
