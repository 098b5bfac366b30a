"""`bodytrack detect`: 2-D keypoints of a recording, by another program's detector."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from tracker.running.commands import Frames, Overrides, ProgressBar, console, with_range


def detect(
    config: Annotated[Path, typer.Argument(help="Configuration of a run, TOML, which names the recording.")],
    with_: Annotated[str, typer.Option("--with", help="Detector: mediapipe, rtmlib, or my_lab:Class.")] = "mediapipe",
    output: Annotated[
        str | None,
        typer.Option(help="Folders to write, with {view}; default: `keypoints` of the configuration."),
    ] = None,
    overlay: Annotated[bool, typer.Option("--overlay", help="Also a film of all images, detected.mp4.")] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Find all anew; otherwise images that have files are left out.")
    ] = False,
    frames: Frames = None,
    set_: Overrides = None,
) -> None:
    """Finds 2-D keypoints in all views. `run` uses them if `keypoints` names their folders."""
    from tracker.running.detections import detect, told, wanted

    asked = wanted(config, with_, output, with_range(set_, frames))
    with ProgressBar() as progress:
        found = detect(asked.reading, asked.detection, asked.pattern, overlay, overwrite, progress)
    for line in told(found):
        console.print(line, highlight=False, soft_wrap=True)
    console.print(
        f"keypoints in {found.pattern}; look at {', '.join(map(str, found.files))}", highlight=False, soft_wrap=True
    )
    if not asked.named:
        pattern = Path(os.path.relpath(found.pattern, config.resolve().parent)).as_posix()
        line = f'keypoints = {{ path = "{pattern}" }}'
        console.print(f"to use them, write {line} above the first section of {config}", highlight=False, soft_wrap=True)
