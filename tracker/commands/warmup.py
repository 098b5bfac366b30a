"""`bodytrack warmup`: kernels compiled ahead, and visibly where a command needs them."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from tracker.kernels.cache import GROUPS, Group, all_cached, warm_up

console = Console()


def warmup(
    everything: Annotated[bool, typer.Option("--all", help="Also those of the surface measurement.")] = False,
) -> None:
    """Compiles the kernels of the tracking ahead; they are kept on disk."""
    for group in GROUPS if everything else GROUPS[:1]:
        if all_cached(group):
            console.print(f"the kernels for {group} are compiled already")
        prepare_kernels(group)


def prepare_kernels(group: Group = "tracking") -> None:
    """Compiles the kernels of a group where that has not been done yet, visibly."""
    if all_cached(group):
        return
    with Progress(
        SpinnerColumn(), TextColumn("compiling kernels once: {task.description}"), TimeElapsedColumn()
    ) as bar:
        task = bar.add_task("")
        warm_up(lambda name: bar.update(task, description=name), group)
