"""`bodytrack result align`: how late the views of a result are, how their cameras are turned, what to do about it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from tracker.running.commands.options import Overwrite
from tracker.running.commands.terminal import ProgressBar, console, marked


def align(
    result: Annotated[Path, typer.Argument(help="Result folder of a run; its recording must still be there.")],
    rig: Annotated[Path | None, typer.Option(help="Write the rig with its cameras turned as the persons show.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder of poses at one moment; default RESULT/in_step.")] = None,
    overwrite: Overwrite = False,
    always: Annotated[bool, typer.Option("--always", help="Write these poses also if no view is late.")] = False,
) -> None:
    """Compares the views of a result by the persons tracked: which are late, whose cameras are turned.

    Where views are out of step, poses at the moment of the first one are written into a result folder of their own.
    """
    from tracker.results.result import load_result
    from tracker.running.aligned_result import (
        alignment_of,
        check_new_file,
        described,
        folder_in_step,
        write_in_step,
        write_turned_rig,
    )

    loaded = load_result(result)
    folder_in_step(loaded, output, overwrite)
    if rig is not None:
        check_new_file(rig, overwrite)
    with ProgressBar() as progress:
        found = alignment_of(loaded, progress)
    console.print(_table(described(found), found.n_moments))
    for line in found.findings():
        console.print(marked("look", line), highlight=False, soft_wrap=True)
    if not found.findings():
        console.print("the views are in step, and their cameras agree with the persons", highlight=False)
    if rig is not None:
        console.print(f"rig: {write_turned_rig(loaded, found, rig, overwrite)}", highlight=False, soft_wrap=True)
    if found.late or always:
        with ProgressBar() as progress:
            folder = write_in_step(loaded, found, output, progress, overwrite)
        whose = found.rig.names[0] + ("" if found.change is None else ", had no view changed")
        console.print(f"poses at the moment of {whose}: {folder}", highlight=False, soft_wrap=True)


def _table(views: dict[str, dict[str, float]], n_moments: int) -> Table:
    """What is told of the views; of delays that change, those before and after."""
    changes = any("late_before_ms" in told for told in views.values())
    late = ["late before ms", "after ms"] if changes else ["late ms"]
    table = Table("view", *late, "turned deg", "turned px", title=f"views, by {n_moments} frames")
    for name, told in views.items():
        if changes:
            cells = [f"{told['late_before_ms']:+.1f}", f"{told['late_after_ms']:+.1f}"]
        else:
            cells = [f"{told['late_ms']:+.1f} ± {told['late_sigma_ms']:.1f}"]
        table.add_row(name, *cells, f"{told['turned_deg']:.2f}", f"{told['turned_px']:.1f}")
    return table
