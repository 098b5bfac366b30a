"""What the commands that do a job have in common."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer

from tracker.foundation.errors import ConfigError
from tracker.running.commands.terminal import ProgressBar

Config = Annotated[Path, typer.Argument(help="Configuration, TOML.")]
Output = Annotated[Path | None, typer.Option(help="Result folder; default results/NAME/TIME.")]
_OVERRIDE = "Override: section.key=value, paths relative to the configuration's folder; repeatable."
Overrides = Annotated[list[str] | None, typer.Option("--set", help=_OVERRIDE)]
Frames = Annotated[str | None, typer.Option(help="Range A:B of frames, either end may be left out.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is there already.")]
"""Of the commands that work on results: they never replace anything unasked."""


def with_range(overrides: list[str] | None, frames: str | None) -> list[str]:
    """The overrides, and those that choose a range of frames.

    Raises:
        ConfigError: the text is no such range.
    """
    chosen = list(overrides or [])
    if frames is not None:
        match = re.fullmatch(r"(\d*):(\d*)", frames)
        if match is None:
            raise ConfigError(f"--frames {frames}: expected A:B, for instance 0:100, 50: or :100")
        ends = zip(("start", "stop"), match.groups(), strict=True)
        chosen += [f"reading.{key}={int(end)}" for key, end in ends if end]
    return chosen


def done(job: Any, output: Path | None = None, resume: bool = False) -> Any:
    """Does a job while a bar shows how far it is."""
    # what computes takes long to import, which `bodytrack --help` need not wait for
    from tracker.running.jobs import execute

    with ProgressBar() as progress:
        return execute(job, output, resume, progress)
