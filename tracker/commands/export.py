"""The command that writes a finished result for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tracker.commands.terminal import console

# Written out, for the folders' imports take longer than `--help` should; a test compares.
FORMATS = ("bvh", "c3d", "glb", "isb_angles", "mot", "osim", "trc", "wide_table")
"""Recordings that need poses and times only."""


def export(
    result: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    more: Annotated[list[str] | None, typer.Argument(help="Further formats.", show_default=False)] = None,
    to: Annotated[list[str] | None, typer.Option("--to", help=f"Formats: {' '.join(FORMATS)}.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default: the result folder.")] = None,
    y_up: Annotated[
        bool, typer.Option("--y-up", help="Turn TRC and C3D to y up; BVH, GLB, MOT and OSIM always are, tables never.")
    ] = False,
) -> None:
    """Writes a finished result for other programs: `bodytrack export RESULT --to trc c3d`."""
    from tracker.components import find
    from tracker.errors import ConfigError, nearest
    from tracker.export import export as export_result

    formats = [*(to or ()), *(more or ())]
    if not formats:
        raise ConfigError(f"--to: expected one or more of {', '.join(FORMATS)}")
    for name in formats:
        if name not in FORMATS:
            raise ConfigError(f"--to {name}: no such format; {nearest(name, FORMATS)}")
    kinds = [find("recording", name) for name in dict.fromkeys(formats)]
    recordings = [kind(y_up=True) if y_up and "y_up" in kind.__dataclass_fields__ else kind() for kind in kinds]
    for file in export_result(result, recordings, output):
        console.print(str(file), highlight=False, soft_wrap=True)
