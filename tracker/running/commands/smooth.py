"""The command that smooths a finished result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tracker.running.commands.options import Overwrite
from tracker.running.commands.terminal import ProgressBar, console


def smooth(
    result: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    use: Annotated[str, typer.Option(help="Smoothing: rts, butterworth, spline, one_euro.")] = "rts",
    set_: Annotated[list[str] | None, typer.Option("--set", help="A field of it: cutoff_hz=8; repeatable.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default RESULT/smoothed.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Smooths a finished result and fills its short gaps, into a result folder of its own; the raw one stays."""
    from tracker.foundation.configuration.tables import build, override_table
    from tracker.results.result import load_result
    from tracker.running.programs import smooth_by

    fields: dict[str, Any] = {}
    override_table(fields, set_ or ())
    smoothing = build("smoothing", {"use": use, **fields}, "--use", Path())
    with ProgressBar() as progress:
        done = smooth_by(smoothing, load_result(result), output, overwrite, progress)
    for person in done.persons:
        filled, lost = person.statuses.count("filled"), person.statuses.count("lost")
        console.print(
            f"{person.name}: {len(person.statuses)} frames, {filled} filled, {lost} still lost", highlight=False
        )
    console.print(str(done.folder), highlight=False, soft_wrap=True)
