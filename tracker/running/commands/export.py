"""The command that writes a finished result for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tracker.foundation.errors import ConfigError
from tracker.running.commands.options import Overwrite
from tracker.running.commands.terminal import console

# Written out, for the folders' imports take longer than `--help` should; a test compares.
FORMATS = ("bvh", "c3d", "glb", "isb_angles", "mot", "opensim", "osim", "trc", "wide_table")
"""Recordings that need poses and times only."""


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
        str | None, typer.Option(help="Of opensim: rajagopal, laiuhlrich, pose2sim, or an .osim file of yours.")
    ] = None,
    mass_kg: Annotated[
        list[str] | None, typer.Option("--mass-kg", help="Of opensim: the person's, or NAME=MASS; repeatable.")
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
        raise ConfigError(
            "--model: expected with --to opensim, and with it alone: rajagopal, or an .osim file of yours"
        )
    fields = {"opensim": {"model": model, **_masses(mass_kg)}}
    if y_up:
        fields |= {name: {"y_up": True} for name in ("trc", "c3d")}
    folder = output or (result if in_result else None)
    for file in exported(result, {name: fields.get(name, {}) for name in formats}, folder, overwrite):
        console.print(str(file), highlight=False, soft_wrap=True)
        if file.suffix == ".json":
            console.print(_fit(json_of(file, ConfigError)), highlight=False)


def _fit(outcome: dict[str, Any]) -> str:
    """How well OpenSim's model moves as the person did."""
    flexions = outcome["opensim_less_ours_deg"].values()
    worst = f"; flexions differ by {max(one['rms'] for one in flexions):.1f} deg RMS after offsets" if flexions else ""
    return f"markers {outcome['marker_rms_mm']:.1f} mm RMS in {outcome['frames']} frames{worst}"


def _masses(told: list[str] | None) -> dict[str, Any]:
    """The field that masses make, kg: one, or one a person."""
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
