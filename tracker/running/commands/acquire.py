"""`bodytrack acquire`, and the tables of lengths and residuals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from tracker.foundation.errors import ConfigError
from tracker.running.commands import Overrides, ProgressBar, console, done, with_range

if TYPE_CHECKING:
    from tracker.running.jobs.acquire import AcquireOutcome


_ROBOTS = (".urdf", ".xml", ".mjcf")
"""Endings of descriptions of robots, which are not configurations."""


def acquire(
    config: Annotated[
        Path,
        typer.Argument(
            help="Pairs of front and side silhouettes, a scan, surface points, or a run's configuration; or a robot: "
            "URDF, or MJCF."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option(help="Model to write, or a result folder; default models/NAME.toml.")
    ] = None,
    set_: Overrides = None,
    frames: Annotated[str | None, typer.Option(help="Range A:B of a run's frames to use.")] = None,
) -> None:
    """Makes a body model: of a person from silhouettes, a scan, points or a run's views; of a robot from its URDF."""
    from tracker.foundation.configuration.tables import override_table
    from tracker.running.jobs import read_own
    from tracker.running.jobs.acquire import acquire_to, acquisition_from

    if output is not None and output.suffix not in ("", ".toml"):
        raise ConfigError(f"--output {output}: expected a .toml file, or a folder for all results")
    if config.suffix.lower() in _ROBOTS:
        table: dict[str, Any] = {"robot": {"file": config.name}}
        override_table(table, set_ or ())
    else:
        table = read_own("acquire", config, set_ or ())
    if frames is not None and "reading" not in table:
        raise ConfigError(f"--frames {frames}: needs the configuration of a run; {config} has no [reading]")
    override_table(table, with_range(None, frames))
    job = acquisition_from(table, config.name, config.parent, config.stem)
    if output is not None and not output.suffix:
        print_acquisition(console, done(job, output))
        return
    with ProgressBar() as progress:
        outcome = acquire_to(job, output or Path("models") / f"{job.model_name}.toml", progress)
    print_acquisition(console, outcome)


def print_acquisition(console: Console, result: AcquireOutcome) -> None:
    """Tables of the bones, the parts and the silhouettes."""
    console.print(_bones(result))
    console.print(_parts(result))
    for view, share in result.overlaps.items():
        before = f", before {result.before[view]:.3f}" if view in result.before else ""
        console.print(f"silhouette IoU {view}: {share:.3f}{before}", highlight=False)
    for turn in result.turns_deg:
        console.print(f"turn between front and side: {turn:.0f} degrees, measured", highlight=False)
    for k, share in enumerate(result.explained, start=1):
        console.print(f"points of moment {k} on the model: {share:.0%}", highlight=False)
    of = "points" if result.explained else "contours"
    console.print(
        f"{of} {result.contour_rms_mm:.1f} mm RMS; stature {result.stature_m:.3f} m; shaded by {result.shaded_by}",
        highlight=False,
    )
    console.print(f"model {result.model}, picture {result.picture}", highlight=False, soft_wrap=True)


def _bones(result: AcquireOutcome) -> Table:
    table = Table(title="lengths, mm", title_justify="left")
    for column in ("from - to", "acquired", "sigma", "before"):
        table.add_column(column, justify="left" if column == "from - to" else "right")
    for bone in result.bones:
        values = (f"{bone.length_mm:.0f}", f"{bone.sigma_mm:.0f}", f"{bone.before_mm:.0f}")
        table.add_row(bone.bone.replace("_", " ").replace("-", " - "), *values)
    return table


def _parts(result: AcquireOutcome) -> Table:
    table = Table(title="parts, mm", title_justify="left")
    for column in ("part", "residual RMS", "bias", "depth", "width", "length"):
        table.add_column(column, justify="left" if column == "part" else "right")
    for part in result.parts:
        seen = part.contour_m > 0
        sizes = [f"{size:.0f} ± {sigma:.0f}" for size, sigma in zip(part.size_mm, part.sigma_mm, strict=True)]
        residual = (f"{part.rms_mm:.1f}", f"{part.bias_mm:+.1f}") if seen else ("never seen", "")
        table.add_row(part.part.replace("_", " "), *residual, *sizes)
    return table
