"""The command that smooths a finished result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tracker.commands.options import Overwrite
from tracker.commands.terminal import ProgressBar, console


def smooth(
    result: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    use: Annotated[str, typer.Option(help="Smoothing: rts, butterworth, spline, one_euro.")] = "rts",
    set_: Annotated[list[str] | None, typer.Option("--set", help="A field of it: cutoff_hz=8; repeatable.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default RESULT/smoothed.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Smooths a finished result and fills its short gaps, into a result folder of its own; the raw one stays."""
    from tracker.config import build
    from tracker.config_files import override_table
    from tracker.recording.overlay import Overlay
    from tracker.recording.report import Report
    from tracker.result import load_result
    from tracker.smoothed import Pictures, write_smoothed
    from tracker.viewing.images import images_of

    fields: dict[str, Any] = {}
    override_table(fields, set_ or ())
    smoothing = build("smoothing", {"use": use, **fields}, "--use", Path())
    raw = load_result(result)
    with ProgressBar() as progress:
        pictures = Pictures((Report(), Overlay()), lambda: images_of(raw), progress)
        folder = write_smoothed(raw, smoothing, output, overwrite, pictures)
    done = load_result(folder)
    for person in done.persons:
        filled, lost = person.statuses.count("filled"), person.statuses.count("lost")
        console.print(
            f"{person.name}: {len(person.statuses)} frames, {filled} filled, {lost} still lost", highlight=False
        )
    console.print(str(folder), highlight=False, soft_wrap=True)
