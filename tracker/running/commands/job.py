"""A command for every job that has none of its own: the file in `tracker/running/jobs/` is all that it needs."""

from __future__ import annotations

import ast
import dataclasses
import pkgutil
from collections.abc import Callable
from pathlib import Path

import typer

from tracker.running.commands.options import Config, Frames, Output, Overrides, done, with_range
from tracker.running.commands.terminal import console, marked

_JOBS = Path(__file__).parents[1] / "jobs"
_WITH_A_COMMAND = {"track": "run", "calibrate": "calibrate", "acquire": "acquire", "surface": "surface", "demo": "demo"}
"""Jobs whose command has options or a report of its own, and what it is called."""

_PART_OF_ANOTHER = {"acquire_from_pictures", "acquire_from_points", "acquire_from_robot", "acquire_from_scan"}
"""Jobs that another one's command chooses."""


def add_jobs(app: typer.Typer) -> None:
    """Adds `bodytrack NAME config.toml` for each job without a command of its own."""
    names = [module.name for module in pkgutil.iter_modules([str(_JOBS)]) if not module.name.startswith("_")]
    for name in sorted({*names} - {*_WITH_A_COMMAND} - _PART_OF_ANOTHER):
        # the source is read, not imported: what computes takes long to load
        source = (_JOBS / f"{name}.py").read_text(encoding="utf-8")
        app.command(name.replace("_", "-"), help=ast.get_docstring(ast.parse(source)))(_command(name))


def _command(use: str) -> Callable[..., None]:
    def command(
        config: Config,
        output: Output = None,
        set_: Overrides = None,
        frames: Frames = None,
        resume: bool = typer.Option(False, help="Continue an interrupted one in --output, or the latest one."),
    ) -> None:
        from tracker.running.jobs import load_job

        outcome = done(load_job(use, config, with_range(set_, frames)), output, resume)
        for field in dataclasses.fields(outcome):
            value = getattr(outcome, field.name)
            if isinstance(value, (str, int, float, Path)):
                shown = f"{value:.4g}" if isinstance(value, float) else value
                console.print(
                    f"{field.name.removeprefix('n_').replace('_', ' ')}: {shown}", highlight=False, soft_wrap=True
                )
        for warning in getattr(outcome, "warnings", ()):
            console.print(marked("warning", warning), soft_wrap=True, highlight=False)
        if getattr(outcome, "interrupted", False):
            raise typer.Exit(130)

    return command
