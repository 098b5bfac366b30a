"""`bodytrack warmup`: kernels compiled ahead."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from tracker.commands.terminal import ProgressBar, console

if TYPE_CHECKING:
    from tracker.kernels.ahead import Group

_USUAL: tuple[Group, ...] = "tracking", "calibration"
"""What `run` and `calibrate` need."""


def warmup(
    everything: Annotated[bool, typer.Option("--all", help="Also those of surfaces and recognition.")] = False,
    clean: Annotated[bool, typer.Option("--clean", help="Delete what other versions of the kernels left.")] = False,
) -> None:
    """Compiles the kernels of tracking and calibration ahead; they are kept on disk."""
    from tracker.kernels.ahead import GROUPS, all_cached, forget_outdated, warm_up
    from tracker.kernels.compilation import code_folder

    if clean:
        console.print(f"{forget_outdated() / 1e6:.1f} MB of outdated kernels deleted", highlight=False)
    for group in GROUPS if everything else _USUAL:
        if all_cached(group):
            console.print(f"the kernels for {group} are compiled already")
        else:
            with ProgressBar() as progress:
                warm_up(progress, group)
    if (folder := code_folder()) is not None:
        console.print(f"kept in {folder}", highlight=False, soft_wrap=True)
