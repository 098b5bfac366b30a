"""`bodytrack surface`: surfaces measured by least squares matching."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from tracker.foundation.errors import ConfigError
from tracker.running.commands import (
    Config,
    Frames,
    Output,
    Overrides,
    Overwrite,
    ProgressBar,
    console,
    done,
    marked,
    with_range,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tracker.running.jobs.surface import SurfaceSummary
    from tracker.running.skin_strain import Strained


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


FOLDER = "strain"
"""Folder of the files, in the folder of the following."""


def strain(
    followed: Annotated[Path, typer.Argument(help="Result folder of `bodytrack follow`, in space.")],
    reference: Annotated[int | None, typer.Option(help="Frame without strain; default the first.")] = None,
    every: Annotated[int, typer.Option(min=1, help="Every so many frames, and the last one.")] = 10,
    frames: Frames = None,
    gauge_mm: Annotated[
        float | None, typer.Option(min=0.1, help="Radius of a gauge; default 2.5 times the distance of the points.")
    ] = None,
    view: Annotated[str | None, typer.Option(help="View of the pictures; default the middle one.")] = None,
    body: Annotated[
        Path | None, typer.Option(help="Result of a run: measures how far skin slides over its bones.")
    ] = None,
    person: Annotated[str | None, typer.Option(help="Person of --body; default the first.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder; default FOLLOWED/strain.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Measures how the surface between followed points is stretched and sheared: a table with sigmas, and colours."""
    from tracker.foundation.files import check_free
    from tracker.results.result import load_result
    from tracker.running.skin_strain import Asked, strain_followed

    if person is not None and body is None:
        raise ConfigError("--person needs --body: the result of a run")
    folder = output or followed / FOLDER
    check_free([*folder.glob("strain*"), *folder.glob("slides.csv")], overwrite)
    first, behind = _range(frames)
    asked = Asked(reference, every, first, behind, gauge_mm, view)
    result = None if body is None else load_result(body)
    whose = None if result is None else (result, person or next(iter(result.bodies)))
    with ProgressBar() as progress:
        found = strain_followed(followed, asked, whose, folder, progress)
    console.print(_strains(found))
    if found.slides:
        console.print(_slides(found))
    if found.told:
        console.print(found.told, style="yellow", highlight=False, soft_wrap=True)
    console.print(f"written: {folder}: {', '.join(one.name for one in found.files)}", highlight=False, soft_wrap=True)


def _range(frames: str | None) -> tuple[int, int | None]:
    match = re.fullmatch(r"(\d*):(\d*)", frames or ":")
    if match is None:
        raise ConfigError(f"--frames {frames}: expected A:B, for instance 0:100, 50: or :100")
    return int(match[1] or 0), int(match[2]) if match[2] else None


def _strains(found: Strained) -> Table:
    from tracker.running.skin_strain import told_strains

    title = f"strain since frame {found.reference}, points {found.spacing_mm:.1f} mm apart, gauges reach "
    title += f"{found.gauge_mm:.1f} mm; %, median (5 to 95 % of the gauges)"
    table = Table(title=title, title_justify="left")
    for column in ("frame", "gauges", "larger", "smaller", "shear deg", "sigma"):
        table.add_column(column, justify="right")
    for row in told_strains(found):
        table.add_row(*row)
    return table


def _slides(found: Strained) -> Table:
    from tracker.running.skin_strain import told_slides

    title = f"sliding over the bones, frame {found.reference} to {max(found.slides)}; mm"
    table = Table(title=title, title_justify="left")
    for column in ("segment", "points", "slides", "95 % less than", "off the bone", "sigma of the poses"):
        table.add_column(column, justify="left" if column == "segment" else "right")
    for row in told_slides(found):
        table.add_row(*row)
    return table
