"""`bodytrack result`: what is made of a finished run."""

from __future__ import annotations

import typer

from tracker.running.commands.align import align
from tracker.running.commands.compare import compare
from tracker.running.commands.evaluate import evaluate
from tracker.running.commands.export import export
from tracker.running.commands.recognize import recognize
from tracker.running.commands.segment import segment
from tracker.running.commands.smooth import smooth

result_app = typer.Typer(
    no_args_is_help=True,
    help="Works on finished runs: each command takes a RESULT folder and makes another one, or a report in it.",
)
for _command in (evaluate, smooth, align, export, compare, recognize, segment):
    result_app.command()(_command)
