"""`bodytrack result compare`: a result against a marker system."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from tracker.running.commands.options import Overwrite
from tracker.running.commands.terminal import console

if TYPE_CHECKING:
    from tracker.results.evaluation.marker_comparison import MarkerComparison


def compare(
    result: Annotated[Path, typer.Argument(help="Result folder of a run, or of a smoothed one.")],
    markers: Annotated[Path, typer.Argument(help="Recording of the marker system: .trc or .c3d.")],
    marker_set: Annotated[Path, typer.Option("--set", help="TOML: which markers make which joint.")],
    person: Annotated[str | None, typer.Option(help="Who wore the markers, where there are several.")] = None,
    offset: Annotated[
        float | None, typer.Option(help="Marker time minus video time, s, to 0.1 s; default: found by angles.")
    ] = None,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default: the result folder.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Compares a result with markers: time and world are aligned; writes comparison.html, .csv, .json and .png."""
    from tracker.foundation.files import check_free
    from tracker.results.evaluation.marker_comparison import compare as compared
    from tracker.results.evaluation.marker_comparison import comparison_files, write_comparison

    folder = output or result
    check_free(comparison_files(folder), overwrite)
    made = compared(result, markers, marker_set, person, offset)
    folder.mkdir(parents=True, exist_ok=True)
    files = write_comparison(made, folder, (str(result), str(markers), str(marker_set)))
    print_comparison(made)
    console.print(str(files[0]), highlight=False, soft_wrap=True)


def print_comparison(made: MarkerComparison) -> None:
    """Tables of the angles and the joints, how the markers lie, and what is to be looked at."""
    angles = Table(title=f"{made.track.person} against markers", title_justify="left")
    for k, head in enumerate(("angle", "RMS", "offset", "RMS, offset removed", "frames")):
        angles.add_column(head, justify="right" if k else "left")
    for angle in made.angles:
        values = f"{angle.rms_deg:.2f} deg", f"{angle.offset_deg:+.2f} deg", f"{angle.rms_offset_removed_deg:.2f} deg"
        angles.add_row(angle.name.replace("_", " "), *values, str(angle.n_frames))
    joints = Table()
    for k, head in enumerate(("joint", "mean", "offset removed", "95 %", "beside its markers")):
        joints.add_column(head, justify="right" if k else "left")
    for joint in made.joints:
        lengths = joint.mean_mm, joint.mean_offset_removed_mm, joint.p95_mm, joint.beside_mm
        joints.add_row(joint.name.replace("_", " "), *(f"{length:.1f} mm" for length in lengths))
    console.print(angles)
    console.print(joints)
    told, placed = made.alignment, made.alignment.placement
    console.print(
        f"marker time = video time {placed.offset_s:+.4f} s (+- {1000 * told.offset_sigma_s:.1f} ms, "
        f"{told.rotation_sigma_deg:.2f} deg, {told.position_sigma_mm:.1f} mm); "
        f"{100 * placed.deciding:.0f} % of the joints decided",
        highlight=False,
        soft_wrap=True,
    )
    for finding in made.findings:
        console.print(f"note: {finding}", style="yellow", highlight=False, soft_wrap=True)
