"""`bodytrack result`: works on a finished run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from tracker.foundation.errors import ConfigError
from tracker.running.commands import Overwrite, ProgressBar, console, marked
from tracker.running.commands.evaluate import evaluate, recognize

if TYPE_CHECKING:
    from tracker.evidence.level_set import LevelSetEvidence
    from tracker.results.evaluation.marker_comparison import MarkerComparison

FOLDER = "segmentation"
"""Folder of the pictures, in the result."""


def segment(
    result: Annotated[Path, typer.Argument(help="Result folder of a run; its recording must still be there.")],
    every: Annotated[int, typer.Option(min=1, help="A picture every so many frames.")] = 10,
    frames: Annotated[str | None, typer.Option(help="Range A:B of frames; either end may be left out.")] = None,
    back: Annotated[int, typer.Option(min=0, help="Begin at the pose so many frames before.")] = 1,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="Setting of the evidence level_set: way=descent, shape=0.15; repeatable."),
    ] = None,
    width: Annotated[int, typer.Option(min=160, help="Of the pictures, px.")] = 1280,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default RESULT/segmentation.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Draws contours by level sets with and without the shape prior, beside the poses found."""
    from tracker.foundation.files import check_free
    from tracker.images.film import write_picture
    from tracker.results.result import load_result
    from tracker.running.viewing.segmentation import Chosen, picture_of, segmented

    chosen = Chosen(every, *_range(frames), back)
    by, folder = _evidence(set_ or []), output or result / FOLDER
    check_free(folder.glob("[0-9]*.png"), overwrite)
    n_seen = n_drawn = 0
    for one in segmented(load_result(result), by, chosen):
        n_seen += 1
        if not one.views:
            console.print(f"frame {one.frame}: every person is lost, or no view has an image", highlight=False)
            continue
        folder.mkdir(parents=True, exist_ok=True)
        n_drawn += 1
        write_picture(folder / f"{one.frame:06d}.png", picture_of(one, width))
        alone, held = one.overlaps()
        console.print(
            f"frame {one.frame}: overlap with the pose found {alone:.2f} without its shape, {held:.2f} with it",
            highlight=False,
        )
    if not n_seen:
        raise ConfigError(f"--frames {frames}: the result has no such frame")
    told = f"written: {folder}, {n_drawn} pictures" if n_drawn else "no picture: nobody was found in these frames"
    console.print(told, highlight=False, soft_wrap=True)


def _range(frames: str | None) -> tuple[int, int | None]:
    match = re.fullmatch(r"(\d*):(\d*)", frames or ":")
    if match is None:
        raise ConfigError(f"--frames {frames}: expected A:B, for instance 0:100, 50: or :100")
    return int(match[1] or 0), int(match[2]) if match[2] else None


def _evidence(changes: list[str]) -> LevelSetEvidence:
    from tracker.foundation.configuration.tables import build, override_table

    fields: dict[str, Any] = {}
    override_table(fields, changes)
    made: LevelSetEvidence = build("evidence", {"use": "level_set", **fields}, "--set", Path())
    return made


def align(
    result: Annotated[Path, typer.Argument(help="Result folder of a run; its recording must still be there.")],
    rig: Annotated[Path | None, typer.Option(help="Write the rig with its cameras turned as the persons show.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder of poses at one moment; default RESULT/in_step.")] = None,
    overwrite: Overwrite = False,
    always: Annotated[bool, typer.Option("--always", help="Write these poses even if no view is late.")] = False,
) -> None:
    """Compares the views of a result by the tracked persons: finds views that are late and cameras that are turned.

    If views are out of step, the command writes poses at the moment of the first view into a new result folder.
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
    """A row a view; delays that change have one before and one after."""
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


# `bodytrack result compare`: a result against a marker system.


def compare(
    result: Annotated[Path, typer.Argument(help="Result folder of a run, or of a smoothed one.")],
    markers: Annotated[Path, typer.Argument(help="Recording of the marker system: .trc or .c3d.")],
    marker_set: Annotated[Path, typer.Option("--set", help="TOML: which markers make which joint.")],
    person: Annotated[str | None, typer.Option(help="Person who wore the markers, if there are several.")] = None,
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
    """Tables of the angles and the joints, how the markers lie, and the warnings."""
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


# The command that writes a finished result for other programs.

# Written out, for the folders' imports take longer than `--help` should; a test compares.
FORMATS = ("bvh", "c3d", "glb", "isb_angles", "mot", "opensim", "osim", "trc", "wide_table")
"""Recordings that need only poses and times."""


def export(
    result: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    more: Annotated[list[str] | None, typer.Argument(help="Further formats.", show_default=False)] = None,
    to: Annotated[list[str] | None, typer.Option("--to", help=f"Formats: {','.join(FORMATS)}.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default RESULT/exports.")] = None,
    overwrite: Overwrite = False,
    y_up: Annotated[
        bool, typer.Option("--y-up", help="Turn TRC and C3D to y up; BVH, GLB, MOT and OSIM always are, tables never.")
    ] = False,
    model: Annotated[
        str | None, typer.Option(help="For opensim: rajagopal, laiuhlrich, pose2sim, or an .osim file of yours.")
    ] = None,
    mass_kg: Annotated[
        list[str] | None, typer.Option("--mass-kg", help="For opensim: the person's mass, or NAME=MASS; repeatable.")
    ] = None,
    in_result: Annotated[bool, typer.Option("--in-result", hidden=True)] = False,
) -> None:
    """Writes a finished result for other programs: `bodytrack result export RESULT --to trc,c3d`."""
    from tracker.foundation.errors import nearest
    from tracker.foundation.source_files import json_of
    from tracker.running.programs import export as exported

    words = ",".join((*(to or ()), *(more or ()))).split(",")
    formats = list(dict.fromkeys(filter(None, words)))
    if not formats:
        raise ConfigError(f"--to: expected one or more of {', '.join(FORMATS)}")
    for name in formats:
        if name not in FORMATS:
            raise ConfigError(f"--to {name}: no such format; {nearest(name, FORMATS)}")
    if ("opensim" in formats) != (model is not None) or (mass_kg and model is None):
        raise ConfigError("--model needs --to opensim, and only that: rajagopal, or an .osim file of yours")
    fields = {"opensim": {"model": model, **_masses(mass_kg)}}
    if y_up:
        fields |= {name: {"y_up": True} for name in ("trc", "c3d")}
    folder = output or (result if in_result else None)
    for file in exported(result, {name: fields.get(name, {}) for name in formats}, folder, overwrite):
        console.print(str(file), highlight=False, soft_wrap=True)
        if file.suffix == ".json":
            console.print(_fit(json_of(file, ConfigError)), highlight=False)


def _fit(outcome: dict[str, Any]) -> str:
    """How closely OpenSim's model follows the person."""
    flexions = outcome["opensim_less_ours_deg"].values()
    worst = f"; flexions differ by {max(one['rms'] for one in flexions):.1f} deg RMS after offsets" if flexions else ""
    return f"markers {outcome['marker_rms_mm']:.1f} mm RMS in {outcome['frames']} frames{worst}"


def _masses(told: list[str] | None) -> dict[str, Any]:
    """The masses, kg: one, or one a person."""
    found = {}
    for text in told or ():
        name, _, number = text.rpartition("=")
        try:
            found[name] = float(number)
        except ValueError:
            raise ConfigError(f"--mass-kg {text}: expected kilograms, as 72, or anna=72") from None
    if not found:
        return {}
    return {"mass_kg": found[""] if set(found) == {""} else found}


def smooth(
    result: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    use: Annotated[str, typer.Option(help="Smoothing: rts, butterworth, spline, one_euro.")] = "rts",
    set_: Annotated[list[str] | None, typer.Option("--set", help="A setting of it: cutoff_hz=8; repeatable.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default RESULT/smoothed.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Smooths a finished result and fills its short gaps, into a new result folder; the raw one stays."""
    from tracker.foundation.configuration.tables import build, override_table
    from tracker.results.result import load_result
    from tracker.running.programs import smooth_by

    fields: dict[str, Any] = {}
    override_table(fields, set_ or ())
    smoothing = build("smoothing", {"use": use, **fields}, "--use", Path())
    with ProgressBar() as progress:
        done = smooth_by(smoothing, load_result(result), output, overwrite, progress)
    for person in done.persons:
        filled, lost = person.statuses.count("filled"), person.statuses.count("lost")
        console.print(
            f"{person.name}: {len(person.statuses)} frames, {filled} filled, {lost} still lost", highlight=False
        )
    console.print(str(done.folder), highlight=False, soft_wrap=True)


result_app = typer.Typer(
    no_args_is_help=True,
    help="Works on finished runs: each command takes a RESULT folder and makes another one, or a report in it.",
)
for _command in (evaluate, smooth, align, export, compare, recognize, segment):
    result_app.command()(_command)
