"""Makes a person's body model from a front and a side silhouette; `bodytrack acquire` does more, from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tracker.foundation.configuration.tables import read_config
from tracker.foundation.errors import TrackerError
from tracker.running.commands import ProgressBar, console, print_error
from tracker.running.commands.acquire import print_acquisition
from tracker.running.jobs.acquire import acquire_to, acquisition_from


def main(
    front: Annotated[Path, typer.Argument(help="Mask of the person from the front.")],
    side: Annotated[Path, typer.Argument(help="Mask from the side, in the same posture.")],
    stature_m: Annotated[float | None, typer.Option(help="Height of the person, metres.")] = None,
    px_per_m: Annotated[float | None, typer.Option(help="Scale of orthographic pictures.")] = None,
    rig: Annotated[Path | None, typer.Option(help="Calibration with cameras called front and side.")] = None,
    clicks: Annotated[Path | None, typer.Option(help="TOML: [front] and [side], joint = [x, y] in px.")] = None,
    model: Annotated[str, typer.Option(help="General model.")] = "gavrila22",
    output: Annotated[Path, typer.Option(help="Model to write.")] = Path("models/person.toml"),
) -> None:
    """Acquires a model; the picture and the figures are written beside it."""
    try:
        clicked = read_config(clicks) if clicks else {}
        given = {"px_per_m": px_per_m, "rig": None if rig is None else str(rig.resolve())}
        pair = {
            view: _picture(given | {"view": view if rig else None}, mask, clicked.get(view, {}))
            for view, mask in (("front", front), ("side", side))
        }
        table = {"name": output.stem, "model": model, "stature_m": stature_m, "pairs": [pair]}
        table = {key: value for key, value in table.items() if value is not None}
        with ProgressBar() as progress:
            result = acquire_to(acquisition_from(table, "command line", Path.cwd(), output.stem), output, progress)
    except (TrackerError, OSError) as error:
        print_error(error)
        raise typer.Exit(2) from None
    print_acquisition(console, result)


def _picture(given: dict[str, Any], mask: Path, clicks: dict[str, Any]) -> dict[str, Any]:
    """A picture as an acquisition file has it."""
    entries = {**given, "mask": str(mask.resolve()), "clicks": clicks}
    return {key: value for key, value in entries.items() if value is not None}


if __name__ == "__main__":
    typer.run(main)
