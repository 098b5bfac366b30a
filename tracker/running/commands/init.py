"""`bodytrack init`: a first configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tracker.running.commands.terminal import console


def init(
    videos: Annotated[Path, typer.Argument(help="Folder of the videos or images, one a view.")],
    output: Annotated[Path, typer.Option(help="Configuration to write.")] = Path("run.toml"),
    rig: Annotated[Path | None, typer.Option(help="Calibration; default: looked for near the videos.")] = None,
) -> None:
    """Writes a commented run.toml for a folder of videos or images: views, cameras and plates that lie there."""
    from tracker.foundation.configuration.schema import schema_of_job
    from tracker.foundation.files import write_json, write_whole
    from tracker.running.drafts.configuration import draft

    schema = check_new_configuration(output)
    found = draft(videos, output, rig)
    write_json(schema, schema_of_job("track"))
    write_whole(output, found.text)
    for one in found.footage:
        frames = f", {one.n_frames} frames" if one.n_frames else ""
        rate = f", {one.fps:.4g} frames/s" if one.fps else ""
        console.print(f"{one.view}: {one.size[0]}x{one.size[1]} px{rate}{frames}", highlight=False)
    console.print(
        f"calibration: {found.rig or 'none'}; plates: {found.plates or 'none'}; keypoints: {found.keypoints or 'none'}",
        highlight=False,
        soft_wrap=True,
    )
    if found.world:
        console.print(found.world, highlight=False, soft_wrap=True)
    for remark in found.remarks:
        console.print(remark, style="yellow", highlight=False, soft_wrap=True)
    console.print(
        f"{output} written: set stature_m, the person's height with shoes, then `bodytrack run {output} --dry-run`",
        highlight=False,
        soft_wrap=True,
    )


def check_new_configuration(output: Path) -> Path:
    """Where the schema of a new configuration is written.

    Args:
        output: the configuration.

    Raises:
        ConfigError: it is there already, its folder is not, or the schema would replace something else.
    """
    from tracker.foundation.configuration.schema import SCHEMA, is_schema
    from tracker.foundation.errors import ConfigError

    if output.exists():
        raise ConfigError(f"{output} is there already: choose another --output")
    if not output.resolve().parent.is_dir():
        raise ConfigError(f"{output}: no such folder; make it, or choose another --output")
    schema = output.with_name(SCHEMA)
    if schema.exists() and not is_schema(schema):
        raise ConfigError(f"{schema} is something else than a schema of bodytrack: choose another folder for --output")
    return schema
