"""Writes a simulated recording with exact truth: videos, plates, rig, model, poses, joints and a configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tracker.foundation.errors import TrackerError
from tracker.running.commands import ProgressBar, console, print_error
from tracker.synthesis.simulation.sequence import Recipe, write_sequence


def main(
    movement: Annotated[str, typer.Argument(help="Movement in the model's file; default: its first one.")] = "",
    output: Annotated[Path, typer.Option(help="Folder to make.")] = Path("results/sequence"),
    seconds: Annotated[float, typer.Option(min=0.04, help="Length.")] = 3.0,
    fps: Annotated[float, typer.Option(min=1, help="Frames per second.")] = 25.0,
    size: Annotated[tuple[int, int], typer.Option(help="Image width and height, px, even numbers.")] = (720, 576),
    heading_deg: Annotated[float, typer.Option(help="Direction faced at the start, degrees.")] = -40.0,
    persons: Annotated[int, typer.Option(min=1, max=2, help="Number of persons.")] = 1,
    noise_grey: Annotated[float, typer.Option(min=0, help="Sensor noise, grey levels.")] = 3.0,
    exposure_ms: Annotated[float, typer.Option(min=0, help="Shutter time: movements meanwhile are blurred.")] = 0.0,
    wardrobe: Annotated[int, typer.Option(min=0, max=2, help="Clothes; 2: all of one dark colour.")] = 0,
    model: Annotated[str, typer.Option(help="Bundled body model, or a model file.")] = "gavrila22",
    seed: Annotated[int, typer.Option(min=0, help="Chooses the room and the noise.")] = 0,
) -> None:
    """Simulates a clothed person, or an animal, in a cluttered room, seen by four cameras."""
    recipe = Recipe(
        movement,
        model,
        seconds,
        fps,
        size,
        heading_deg,
        persons,
        noise_grey,
        exposure_s=exposure_ms / 1000,
        wardrobe=wardrobe,
        seed=seed,
    )
    try:
        with ProgressBar() as progress:
            config = write_sequence(recipe, output, progress)
    except (TrackerError, OSError) as error:
        print_error(error)
        raise typer.Exit(2) from None
    told = f"written to {output}; track it with: bodytrack run {config}"
    console.print(told, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    typer.run(main)
