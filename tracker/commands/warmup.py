"""`bodytrack warmup`: kernels compiled ahead."""

from __future__ import annotations

from typing import Annotated

import typer

from tracker.commands.terminal import ProgressBar, console


def warmup(
    everything: Annotated[bool, typer.Option("--all", help="Also those of the surface measurement.")] = False,
) -> None:
    """Compiles the kernels of the tracking ahead; they are kept on disk."""
    from tracker.kernels.cache import GROUPS, all_cached, warm_up

    for group in GROUPS if everything else GROUPS[:1]:
        if all_cached(group):
            console.print(f"the kernels for {group} are compiled already")
        else:
            with ProgressBar() as progress:
                warm_up(progress, group)
