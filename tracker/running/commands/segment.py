"""`bodytrack result segment`: contours by level sets along a result, as pictures."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tracker.foundation.errors import ConfigError
from tracker.running.commands.options import Overwrite
from tracker.running.commands.terminal import console

if TYPE_CHECKING:
    from tracker.evidence.level_set import LevelSetEvidence

FOLDER = "segmentation"
"""In the result, where the pictures are written."""


def segment(
    result: Annotated[Path, typer.Argument(help="Result folder of a run; its recording must still be there.")],
    every: Annotated[int, typer.Option(min=1, help="A picture every so many frames.")] = 10,
    frames: Annotated[str | None, typer.Option(help="Range A:B of frames, either end may be left out.")] = None,
    back: Annotated[int, typer.Option(min=0, help="Begin at the pose so many frames before.")] = 1,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Of evidence level_set: way=descent, shape=0.15; repeatable.")
    ] = None,
    width: Annotated[int, typer.Option(min=160, help="Of the pictures, px.")] = 1280,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default RESULT/segmentation.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Draws contours by level sets with and without the shape prior, and the poses found, over frames of a result."""
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
            console.print(f"frame {one.frame}: everybody is lost, or no view has an image", highlight=False)
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
