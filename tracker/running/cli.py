"""The command line: the only place that prints and exits."""

from __future__ import annotations

import os
import signal
import sys
import threading
from importlib.metadata import version
from types import FrameType
from typing import Annotated

import typer
from rich.console import Console

from tracker.foundation.configuration.components import ask_before_plugins
from tracker.foundation.errors import ConfigError, TrackerError, os_fault
from tracker.running.commands.acquire import acquire
from tracker.running.commands.calibrate import calibrate_app
from tracker.running.commands.detect import detect
from tracker.running.commands.earlier_names import Commands
from tracker.running.commands.init import init
from tracker.running.commands.job import add_jobs
from tracker.running.commands.result import result_app
from tracker.running.commands.rig import rig_app
from tracker.running.commands.run import demo, run
from tracker.running.commands.show import show
from tracker.running.commands.simulate import simulate
from tracker.running.commands.strain import strain
from tracker.running.commands.surface import measure
from tracker.running.commands.terminal import console, print_any_sign, print_error, quiet_libraries
from tracker.running.commands.view import view

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Model-based, marker-less motion capture from calibrated views.",
)
for _command in (demo, init, detect, run, view, show, acquire, simulate, strain):
    app.command()(_command)
app.command("surface")(measure)
app.add_typer(calibrate_app, name="calibrate")
app.add_typer(rig_app, name="rig")
app.add_typer(result_app, name="result")
add_jobs(app)


_DEBUG, _NO_PLUGINS = "--debug", "--no-plugins"


def main() -> None:
    """Entry point: every error is one line; exit code 2 for what a user can cause, 1 for what is our fault."""
    options, sys.argv[1:] = _split(sys.argv[1:])
    print_any_sign()
    if _DEBUG not in options:
        quiet_libraries()
    signal.signal(signal.SIGTERM, _interrupt)
    ask_before_plugins(_refuse_plugin if _NO_PLUGINS in options else _tell_plugin)
    try:
        code = app(standalone_mode=False)
    except Exception as error:
        if usage := _told_usage(error):
            print_error(usage)
        if isinstance(usage, str):
            raise SystemExit(2) from None
        if _DEBUG in options:
            raise
        text, code = _told(error)
        print_error(text)
        raise SystemExit(code) from None
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted")
        _leave_threads(130)
        raise SystemExit(130) from None
    raise SystemExit(code if isinstance(code, int) else 0)


def _leave_threads(code: int) -> None:
    """Ends the process if threads are at work still: Python would wait for them, and nobody for what they make."""
    if threading.active_count() > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _split(arguments: list[str]) -> tuple[set[str], list[str]]:
    """Options that may stand anywhere, and the other arguments."""
    found = {_DEBUG, _NO_PLUGINS} & set(arguments)
    return found, [argument for argument in arguments if argument not in found]


def _interrupt(number: int, frame: FrameType | None) -> None:
    """SIGTERM is taken for Ctrl-C: what was begun is put away."""
    raise KeyboardInterrupt


def _told_usage(error: Exception) -> str | None:
    """What is told of a command line that cannot be: nothing where the help was shown; None for other errors."""
    told, context = getattr(error, "format_message", None), getattr(error, "ctx", None)
    if told is None:
        return None
    message = str(told()).strip().rstrip(".")
    return f"{message}: see `{context.command_path if context else 'bodytrack'} --help`" if message else ""


def _told(error: Exception) -> tuple[str, int]:
    """What is told of an error, and the exit code."""
    if isinstance(error, TrackerError):
        return str(error), 2
    if isinstance(error, OSError) and error.errno is not None:
        return os_fault(error), 2
    if isinstance(error, UnicodeEncodeError):
        around = ascii(error.object[max(error.start - 40, 0) : error.end + 20])
        sign = ascii(error.object[error.start])
        return f"{around}: {error.encoding} cannot write {sign}: use another name, or set LC_ALL=C.UTF-8", 2
    kind = type(error).__name__
    place = f"{kind}: {error}".replace("\n", " ")
    return f"{place[:300]}: this is a fault of bodytrack; please report it with what `bodytrack --debug ...` shows", 1


def _tell_plugin(use: str) -> None:
    """Tells of it, and has Python find it in the folder begun from, which a script's own path does not hold."""
    if (here := os.getcwd()) not in sys.path:  # noqa: PTH109 - as Python writes it there
        sys.path.append(here)
    console.print(f"runs code from outside bodytrack: {use}", style="yellow", highlight=False)


def _refuse_plugin(use: str) -> None:
    raise ConfigError(f'use = "{use}": code from outside bodytrack, which --no-plugins forbids')


def _print_version(wanted: bool) -> None:
    if wanted:
        console.print(f"bodytrack {version('bodytrack')}", highlight=False)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[bool, typer.Option(_DEBUG, help="Show the traceback of an error.")] = False,
    no_plugins: Annotated[
        bool, typer.Option(_NO_PLUGINS, help='Refuse components of other packages, use = "module:Class".')
    ] = False,
) -> None:
    """Model-based, marker-less motion capture from calibrated views."""
