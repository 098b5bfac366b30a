"""`bodytrack surface`: surfaces measured by least squares matching."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from tracker.commands.warmup import prepare_kernels
from tracker.lsm.surface_run import SurfaceSummary, execute_surface_run, load_surface_run
from tracker.progress import CountedProgress
from tracker.run import dated_folder, link_latest

console = Console()


def measure(
    config: Annotated[Path, typer.Argument(help="Configuration, TOML.")],
    output: Annotated[Path | None, typer.Option(help="Result folder; default results/NAME/TIME.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Override: section.key=value; repeatable.")] = None,
) -> None:
    """Measures the surface that two or more views show: a point cloud with sigmas, pictures, CSV."""
    run = load_surface_run(config, set_ or [])
    prepare_kernels("matching")
    folder = output or dated_folder(run.name)
    with CountedProgress(console) as progress:
        summaries = execute_surface_run(run, folder, progress.told)
    if output is None:
        link_latest(folder)
    console.print(_table(run.name, summaries))
    for summary in summaries:
        for warning in summary.warnings:
            console.print(f"[yellow]warning:[/] frame {summary.frame}: {warning}", soft_wrap=True, highlight=False)
    console.print(f"results in {folder} ({', '.join(summaries[-1].files)}, surface.json)", highlight=False)


def _table(name: str, summaries: list[SurfaceSummary]) -> Table:
    table = Table(title=f"{name}: measured surfaces", title_justify="left")
    for column in ("frame", "seeds", "matches", "covered", "points", "rays RMS px", "s0", "median sigma mm", "s"):
        table.add_column(column, justify="right")
    for summary in summaries:
        table.add_row(
            str(summary.frame),
            " ".join(map(str, summary.n_seeds.values())),
            " ".join(map(str, summary.n_matches.values())),
            " ".join(f"{100 * share:.0f} %" for share in summary.coverage.values()),
            str(summary.n_points),
            f"{summary.residual_px:.3f}",
            f"{summary.s0:.2f}",
            f"{summary.median_sigma_mm:.3f}",
            f"{summary.seconds:.1f}",
        )
    return table
