"""`bodytrack run` and `bodytrack demo`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tracker.commands.evaluate import print_evaluation
from tracker.commands.options import Config, Frames, Output, Overrides, done, with_range
from tracker.commands.terminal import console

if TYPE_CHECKING:
    from tracker.jobs.track import TrackOutcome


def run(
    config: Config,
    output: Output = None,
    set_: Overrides = None,
    frames: Frames = None,
    resume: Annotated[bool, typer.Option(help="Continue an interrupted run in --output, or the latest one.")] = False,
) -> None:
    """Tracks a sequence."""
    from tracker.jobs import load_job

    outcome = done(load_job("track", config, with_range(set_, frames)), output, resume)
    _print_tracked(outcome)
    if outcome.interrupted:
        raise typer.Exit(130)


def demo(
    output: Annotated[Path | None, typer.Option(help="Result folder; default results/demo/TIME.")] = None,
    movement: Annotated[str, typer.Option(help="Movement simulated.")] = "two_elbow_rotation",
    frames: Annotated[int, typer.Option(min=5, help="Number of frames.")] = 75,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the room and the noise.")] = 0,
) -> None:
    """Simulates a clothed person in a cluttered room, tracks it from bootstrapping, and compares with the truth."""
    from tracker.jobs.demo import DemoJob

    outcome = done(DemoJob(movement=movement, frames=frames, seed=seed), output)
    _print_tracked(outcome.result)
    if outcome.evaluation is not None:
        print_evaluation(outcome.evaluation)
    if outcome.result.interrupted:
        raise typer.Exit(130)


def _print_tracked(outcome: TrackOutcome) -> None:
    rate = outcome.n_frames / outcome.seconds if outcome.seconds else 0.0
    state = "interrupted after" if outcome.interrupted else "tracked"
    console.print(f"{state} {outcome.n_frames} frames, {rate:.1f} frames/s all included", highlight=False)
    files = ", ".join(path.name for path in outcome.files) or "no recordings chosen"
    console.print(f"results in {outcome.folder}: {files}", highlight=False)
    console.print(outcome.doubts.sentence(), style="" if outcome.doubts.none else "yellow", highlight=False)
