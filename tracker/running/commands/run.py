"""`bodytrack run` and `bodytrack demo`."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from tracker.foundation.errors import ConfigError
from tracker.foundation.progress import in_words
from tracker.running.commands import Frames, Overrides, ProgressBar, console, done, with_range
from tracker.running.commands.evaluate import print_evaluation

if TYPE_CHECKING:
    from tracker.running.batching import Summary
    from tracker.running.jobs.track import TrackJob, TrackOutcome
    from tracker.tracking.doubts import Doubts


_FOLDER = Path("results/batch")
"""Folder of a batch without --output."""


@dataclass(frozen=True)
class Side:
    """Number of recordings tracked side by side, and the machines."""

    jobs: int | None = None
    """At a time; None: as many as cores."""

    scheduler: str | None = None
    """Address of a Dask scheduler; None: on this machine."""


def track_many(
    configs: Sequence[Path], overrides: Sequence[str], output: Path | None, resume: bool, beside: Side
) -> None:
    """Tracks many recordings side by side; a broken one fails alone."""
    from tracker.foundation.configuration.components import find
    from tracker.running.batching import plan, run

    planned = plan(configs, overrides, output or _FOLDER, resume)
    fields = {name: value for name, value in dataclasses.asdict(beside).items() if value is not None}
    batching = find("batching", "processes" if beside.scheduler is None else "dask")(**fields)
    with ProgressBar() as progress:
        summaries = run(planned, batching, progress)
    _print(summaries)
    console.print(f"results in {planned.folder}, table in batch.csv", highlight=False, soft_wrap=True)
    states = {summary.state for summary in summaries}
    if states & {"interrupted", "waiting"}:
        raise typer.Exit(130)
    if "failed" in states or any(one.n_frames and one.n_lost == one.n_frames for one in summaries):
        raise typer.Exit(2)


def _print(summaries: tuple[Summary, ...]) -> None:
    """Prints a row a recording, then the fault of each that failed."""
    table = Table("recording", "state")
    for title in ("frames", "lost", "doubtful", "ambiguous", "frames/s"):
        table.add_column(title, justify="right")
    for one in summaries:
        counts = one.n_frames, one.n_lost, one.n_doubtful, one.n_ambiguous
        rate = f"{one.n_frames / one.seconds:.1f}" if one.seconds and one.n_frames else ""
        style = {"done": "", "failed": "red"}.get(one.state, "yellow")
        table.add_row(one.name, one.state, *(map(str, counts) if one.n_frames else [""] * 4), rate, style=style)
    console.print(table)
    for one in summaries:
        if one.fault:
            console.print(f"{one.name}: {one.fault}", style="red", highlight=False, soft_wrap=True)


def run(
    configs: Annotated[list[Path], typer.Argument(metavar="CONFIG", help="TOML; several make a batch.")],
    output: Annotated[
        Path | None,
        typer.Option(help="Result folder; default results/NAME/TIME. Of a batch: OUTPUT/NAME, results/batch."),
    ] = None,
    set_: Overrides = None,
    frames: Frames = None,
    resume: Annotated[bool, typer.Option(help="Continue an interrupted run in --output, or the latest one.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check all inputs, track a few frames, estimate the time.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Also print the time of each stage of tracking.")] = False,
    jobs: Annotated[int | None, typer.Option(min=1, help="Recordings at a time; default: as many as cores.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler, tcp://HOST:8786.")] = None,
    batch: Annotated[
        bool, typer.Option("--batch", help="Run as a batch, even one recording; --jobs and --scheduler do the same.")
    ] = False,
) -> None:
    """Tracks a recording, or many side by side: a broken one fails alone."""
    overrides = with_range(set_, frames)
    if batch or jobs or scheduler or len(configs) > 1:
        if dry_run:
            raise ConfigError("--dry-run takes one configuration at a time, without --batch, --jobs and --scheduler")
        if verbose:
            raise ConfigError("--verbose takes one configuration at a time, without --batch, --jobs and --scheduler")
        track_many(configs, overrides, output, resume, Side(jobs, scheduler))
        return
    _track(configs[0], overrides, output, (resume, dry_run, verbose))


def _track(config: Path, overrides: list[str], output: Path | None, asked: tuple[bool, bool, bool]) -> None:
    """Tracks one recording; `asked`: resume a run, only estimate the time, print the stages' times."""
    from tracker.running.jobs import load_job

    resume, dry_run, verbose = asked
    job = load_job("track", config, overrides)
    if dry_run:
        if resume:
            raise ConfigError("--dry-run --resume: expected one of them; --resume checks all before it goes on")
        _print_forecast(job)
        return
    outcome = done(job, output, resume)
    if verbose:
        _print_stages(outcome)
    _print_tracked(outcome)
    _end_with(outcome)


def demo(
    output: Annotated[Path | None, typer.Option(help="Result folder; default results/demo/TIME.")] = None,
    movement: Annotated[str, typer.Option(help="Movement simulated.")] = "two_elbow_rotation",
    frames: Annotated[int, typer.Option(min=5, help="Number of frames.")] = 75,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the room and the noise.")] = 0,
) -> None:
    """Simulates a clothed person in a cluttered room, tracks it from bootstrapping, and compares with the truth."""
    from tracker.running.jobs.demo import DemoJob

    outcome = done(DemoJob(movement=movement, frames=frames, seed=seed), output)
    _print_tracked(outcome.result)
    if outcome.evaluation is not None:
        print_evaluation(outcome.evaluation)
    _end_with(outcome.result)


def _end_with(outcome: TrackOutcome) -> None:
    """Exits with the code of a run that was interrupted, or that found no person in any frame."""
    if outcome.interrupted:
        raise typer.Exit(130)
    if outcome.doubts.nobody:
        raise typer.Exit(2)


def _print_forecast(job: TrackJob) -> None:
    from tracker.running.programs import forecast

    with ProgressBar() as progress:
        told = forecast(job, progress=progress)
    if told.doubts.nobody:
        _print_doubts(told.doubts)
        console.print("no person was found, so the time of all frames is unknown; nothing was written")
        raise typer.Exit(2)
    console.print(
        f"{told.n_views} views, {told.n_frames} frames; of the first ones: start {told.start_s:.1f} s, then "
        f"{1000 * told.frame_s:.0f} ms a frame",
        highlight=False,
    )
    _print_doubts(told.doubts)
    about = in_words(told.seconds)
    console.print(f"all of them take about {about} on this machine; nothing was written", highlight=False)


def _print_tracked(outcome: TrackOutcome) -> None:
    rate = outcome.n_frames / outcome.seconds if outcome.seconds else 0.0
    state = "interrupted after" if outcome.interrupted else "tracked"
    took = in_words(outcome.seconds)
    console.print(f"{state} {outcome.n_frames} frames in {took}, {rate:.1f} frames/s all included", highlight=False)
    files = ", ".join(path.name for path in outcome.files) or "no recordings chosen"
    console.print(f"results in {outcome.folder}: {files}", highlight=False, soft_wrap=True)
    if outcome.keypoints:
        console.print(outcome.keypoints, highlight=False, soft_wrap=True)
    for remark in outcome.remarks:
        console.print(remark, highlight=False, soft_wrap=True)
    _print_doubts(outcome.doubts)


def _print_stages(outcome: TrackOutcome) -> None:
    by_time = sorted(outcome.stages_s.items(), key=lambda one: -one[1])
    told = ", ".join(f"{stage} {1000 * seconds / outcome.n_frames:.0f}" for stage, seconds in by_time)
    console.print(f"stages of tracking, ms a frame: {told}", highlight=False, soft_wrap=True)


def _print_doubts(doubts: Doubts) -> None:
    if advice := doubts.advice():
        console.print(advice, style="yellow", highlight=False, soft_wrap=True)
    console.print(doubts.sentence(), style="" if doubts.none else "yellow", highlight=False, soft_wrap=True)
    if why := doubts.why():
        console.print(why, style="yellow", highlight=False, soft_wrap=True)
