"""`bodytrack surface`: surfaces measured by least squares matching."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from tracker.running.commands.options import Config, Frames, Output, Overrides, done, with_range
from tracker.running.commands.terminal import console, marked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tracker.running.jobs.surface import SurfaceSummary


def measure(config: Config, output: Output = None, set_: Overrides = None, frames: Frames = None) -> None:
    """Measures the surface that two or more views show: a point cloud with sigmas, pictures, CSV."""
    from tracker.running.jobs import load_job

    job = load_job("surface", config, with_range(set_, frames))
    outcome = done(job, output)
    console.print(_table(job.name, outcome.frames))
    for summary in outcome.frames:
        for warning in summary.warnings:
            console.print(marked("warning", f"frame {summary.frame}: {warning}"), soft_wrap=True, highlight=False)
    told = f"results in {outcome.folder}: {', '.join(outcome.frames[-1].files)}, surface.json"
    console.print(told, highlight=False, soft_wrap=True)


def _table(name: str, summaries: Sequence[SurfaceSummary]) -> Table:
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
