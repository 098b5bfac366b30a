"""The command line: the only place that prints and exits."""

from __future__ import annotations

import ast
import dataclasses
import os
import pkgutil
import signal
import sys
import threading
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer
from rich.console import Console
from typer.core import TyperGroup

from tracker.foundation.configuration.components import ask_before_plugins
from tracker.foundation.errors import ConfigError, TrackerError, os_fault
from tracker.running.commands import (
    Config,
    Frames,
    Output,
    Overrides,
    console,
    done,
    marked,
    print_any_sign,
    print_error,
    quiet_libraries,
    with_range,
)
from tracker.running.commands.acquire import acquire
from tracker.running.commands.configuration import init, show
from tracker.running.commands.detect import detect
from tracker.running.commands.result import result_app
from tracker.running.commands.rig import calibrate_app, rig_app
from tracker.running.commands.run import demo, run
from tracker.running.commands.simulate import simulate
from tracker.running.commands.surface import measure, strain
from tracker.running.commands.view import view

_ANEW = "--overwrite"
"""Options that the earlier spelling of a report's command implied."""

EARLIER: dict[str, tuple[str, ...]] = {
    "batch": ("run", "--batch"),
    "evaluate": ("result", "evaluate", _ANEW),
    "smooth": ("result", "smooth"),
    "align": ("result", "align"),
    "export": ("result", "export", _ANEW, "--in-result"),
    "compare": ("result", "compare", _ANEW),
    "recognize": ("result", "recognize", _ANEW),
    "segment": ("result", "segment", _ANEW),
}
"""Earlier name -> the words that do the same now."""


class Commands(TyperGroup):
    """The commands, with their earlier names."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Finds the command that the words name."""
        if (now := EARLIER.get(args[0])) is not None:
            if not ctx.resilient_parsing:  # as the shell completes
                _tell(args[0], " ".join(word for word in now if word not in (_ANEW, "--in-result")))
            args = [*now, *args[1:]]
        return super().resolve_command(ctx, args)


def _tell(before: str, now: str) -> None:
    told = f"`bodytrack {before}` is called `bodytrack {now}` now"
    Console(stderr=True).print(marked("look", told), highlight=False, soft_wrap=True)


_JOBS = Path(__file__).parent / "jobs"
_WITH_A_COMMAND = {"track": "run", "calibrate": "calibrate", "acquire": "acquire", "surface": "surface", "demo": "demo"}
"""Jobs whose command has options or a report of its own -> the name of that command."""

_PART_OF_ANOTHER = {"acquire_from_pictures", "acquire_from_points", "acquire_from_robot", "acquire_from_scan"}
"""Jobs that the command of another job chooses."""


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


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Model-based, marker-less motion capture from calibrated views.",
)
for _offered in (demo, init, detect, run, view, show, acquire, simulate, strain):
    app.command()(_offered)
app.command("surface")(measure)
app.add_typer(calibrate_app, name="calibrate")
app.add_typer(rig_app, name="rig")
app.add_typer(result_app, name="result")
add_jobs(app)


_DEBUG, _NO_PLUGINS = "--debug", "--no-plugins"


def main() -> None:
    """Entry point. Every error is one line; the exit code is 2 for what a user can cause, 1 for a fault of ours."""
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
    """Ends the process if threads are still at work: Python would wait for them, and nobody needs their results."""
    if threading.active_count() > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _split(arguments: list[str]) -> tuple[set[str], list[str]]:
    """Splits off the options that may stand anywhere."""
    found = {_DEBUG, _NO_PLUGINS} & set(arguments)
    return found, [argument for argument in arguments if argument not in found]


def _interrupt(number: int, frame: FrameType | None) -> None:
    """SIGTERM does the same as Ctrl-C: the job puts away what it began."""
    raise KeyboardInterrupt


def _told_usage(error: Exception) -> str | None:
    """Message of a wrong command line: empty if the help was shown; None for other errors."""
    told, context = getattr(error, "format_message", None), getattr(error, "ctx", None)
    if told is None:
        return None
    message = str(told()).strip().rstrip(".")
    return f"{message}: see `{context.command_path if context else 'bodytrack'} --help`" if message else ""


def _told(error: Exception) -> tuple[str, int]:
    """Message of an error, and the exit code."""
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
    """Warns of code from outside bodytrack, and lets Python find it in the current folder."""
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
