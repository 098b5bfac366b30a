"""The command line: the only place that prints and exits."""

from __future__ import annotations

import sys
from importlib.metadata import version
from typing import Annotated

import typer
from rich.console import Console

from tracker.commands.acquire import acquire
from tracker.commands.calibrate import calibrate_app
from tracker.commands.evaluate import evaluate
from tracker.commands.export import export
from tracker.commands.job import add_jobs
from tracker.commands.rig import rig_app
from tracker.commands.run import demo, run
from tracker.commands.show import show
from tracker.commands.surface import measure
from tracker.commands.terminal import console
from tracker.commands.warmup import warmup
from tracker.errors import TrackerError

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Model-based, marker-less motion capture from calibrated views.",
)
for _command in (demo, run, show, evaluate, export, acquire, warmup):
    app.command()(_command)
app.command("surface")(measure)
app.add_typer(calibrate_app, name="calibrate")
app.add_typer(rig_app, name="rig")
add_jobs(app)


def main() -> None:
    """Entry point: every error a user can cause is one line and exit code 2."""
    try:
        app()
    except TrackerError as error:
        if "--debug" in sys.argv:
            raise
        text = str(error).replace("[", r"\[")
        Console(stderr=True).print(f"[bold red]error:[/] {text}", soft_wrap=True, highlight=False)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted")
        raise SystemExit(130) from None


def _print_version(wanted: bool) -> None:
    if wanted:
        console.print(f"bodytrack {version('bodytrack')}", highlight=False)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Model-based, marker-less motion capture from calibrated views."""
