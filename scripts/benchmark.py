"""Speed, accuracy and robustness of the installed package, each beside a reference measured in the same run."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pathlib import Path
from typing import Annotated

import typer
from benchmarks import ablate as rule_ledger
from benchmarks import acquisition as acquired_models
from benchmarks import calibration as bar_calibration
from benchmarks import follow as followed_points
from benchmarks import in_step as made_delays
from benchmarks import lsm as patch_matching
from benchmarks import meaningless as meaningless_changes
from benchmarks import opensim_models as moved_models
from benchmarks import poses as pose_rates
from benchmarks import recognition as known_movements
from benchmarks import recordings as tracked_recordings
from benchmarks import refinements as compiled_refinements
from benchmarks import robots as described_robots
from benchmarks import robustness as survival
from benchmarks import scores_picture
from benchmarks import segmentation as level_sets
from benchmarks import sigma as uncertainty
from benchmarks import sizes as measured_sizes
from benchmarks import skins as skinned_meshes
from benchmarks import starts as found_starts
from benchmarks import surfaces as measured_surfaces
from benchmarks import tracking as cycle_times
from benchmarks import twists as limb_twists
from benchmarks import ways as pose_ways
from benchmarks import whole_runs as booked_runs
from benchmarks.scores import read_scores
from benchmarks.start_scores import print_starts
from rich.console import Console

from tracker.foundation.errors import TrackerError
from tracker.running.commands import print_error

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)
# A table cut at the 80 columns of a pipe cannot be read.
console = Console() if Console().is_terminal else Console(width=230)
ROOT = Path(__file__).parents[1]
Quick = Annotated[bool, typer.Option("--quick", help="Small images and few frames: only to see that it runs.")]


@app.command()
def poses(n_poses: Annotated[int, typer.Option(min=32, help="Poses in a batch.")] = 256, quick: Quick = False) -> None:
    """Poses synthesized into four views and compared in both chamfer directions, per second."""
    pose_rates.compare(console, n_poses, quick)


@app.command()
def skins(n_poses: Annotated[int, typer.Option(min=8, help="Poses in a batch.")] = 100, quick: Quick = False) -> None:
    """Contours of a skinned mesh, beside rasterizing the same mesh and beside those of superquadrics."""
    skinned_meshes.compare(console, n_poses, quick)


@app.command()
def tracking(
    n_frames: Annotated[int, typer.Option(min=3, help="Frames tracked at 25 a second.")] = 75, quick: Quick = False
) -> None:
    """Milliseconds a frame by stage, from video files on, beside the floor of decoding and edge detection."""
    cycle_times.compare(console, n_frames, quick)


@app.command()
def refinements(
    n_frames: Annotated[int, typer.Option(min=3, help="Frames tracked at 25 a second.")] = 20, quick: Quick = False
) -> None:
    """Milliseconds of a refinement in one compiled call, beside the same asked of the evidence step by step."""
    compiled_refinements.compare(console, n_frames, quick)


@app.command("whole_runs")
def whole_runs(
    only: Annotated[str, typer.Option(help="The recording in BODYTRACK_DATA.")] = "N-WalkCircle",
    python_path: Annotated[Path, typer.Option(help="Checkout whose package is run.")] = ROOT,
    quick: Quick = False,
) -> None:
    """CPU seconds of whole runs with defaults, by stage, beside decoding and one edge detection of the same images."""
    data = os.environ.get("BODYTRACK_DATA")
    booked_runs.compare(console, None if data is None else Path(data), only, python_path, quick)


@app.command()
def starts(quick: Quick = False) -> None:
    """Seconds that a start takes where part of the background is known, in threads and in a loop."""
    found_starts.compare(console, quick)


@app.command()
def robustness(
    only: Annotated[str, typer.Option(help="Only conditions or movements whose name holds this.")] = "",
    quick: Quick = False,
    trace: Annotated[bool, typer.Option("--trace", help="Print the frames that are lost or have a limb off.")] = False,
) -> None:
    """What the tracking survives: low frame rates, clutter, missing views, wrong bodies, wrong starts."""
    survival.compare(console, only, quick, trace)


@app.command()
def robots(
    files: Annotated[list[Path], typer.Argument(help="Descriptions: URDF or MJCF.")],
    free: Annotated[str, typer.Option(help="Names, without suffix, of those whose base moves about.")] = "",
    quick: Quick = False,
) -> None:
    """Robots of public descriptions, simulated and tracked: our way beside the way of M3T, at two frame rates."""
    try:
        described_robots.compare(console, files, tuple(free.split(",")), quick)
    except TrackerError as error:
        print_error(error)
        raise typer.Exit(2) from None


@app.command()
def recordings(
    only: Annotated[str, typer.Option(help="Only recordings whose name holds this.")] = "",
    models: Annotated[str, typer.Option(help="General models, commas between.")] = "human,gavrila22",
    acquired: Annotated[bool, typer.Option("--acquired", help="Models acquired from each recording itself.")] = False,
    without_plates: Annotated[bool, typer.Option("--without-plates", help="No plates of the empty room.")] = False,
    keypoints: Annotated[
        bool, typer.Option("--keypoints", help="Start from 2-D detections, and use them beside the default evidence.")
    ] = False,
    starts: Annotated[int, typer.Option(min=1, max=8, help="Starts, a tenth of the recording apart.")] = 3,
    set_: Annotated[list[str] | None, typer.Option("--set", help="As of bodytrack run; repeatable.")] = None,
    python_path: Annotated[Path, typer.Option(help="Checkout whose package is run.")] = ROOT,
    output: Annotated[Path, typer.Option(help="Keeps all runs and scores.csv.")] = Path("results/recordings"),
    quick: Quick = False,
) -> None:
    """Tracking errors and flags on the recordings in BODYTRACK_DATA that have a truth: median and worst start."""
    settings = tuple(set_ or ())
    plan = tracked_recordings.Plan(
        only, tuple(models.split(",")), acquired, not without_plates, starts, settings, quick, keypoints
    )
    tracked_recordings.compare(console, plan, python_path, output)


@app.command()
def meaningless(
    only: Annotated[str, typer.Option(help="Only recordings whose name holds this.")] = "",
    without_plates: Annotated[bool, typer.Option("--without-plates", help="No plates of the empty room.")] = False,
    python_path: Annotated[Path, typer.Option(help="Checkout whose package is run.")] = ROOT,
    output: Annotated[Path, typer.Option(help="Keeps all runs and scores.csv.")] = Path("results/meaningless"),
    quick: Quick = False,
) -> None:
    """What changes that mean nothing change: starts, orders of views and persons, JPEG, a mirror."""
    meaningless_changes.compare(console, only, not without_plates, python_path, output, quick)


@app.command("opensim")
def opensim_models(
    results: Annotated[list[Path], typer.Argument(help="Result folders of runs.")],
    model: Annotated[list[str], typer.Option(help="As of `bodytrack result export --to opensim`; repeatable.")],
) -> None:
    """OpenSim's models moved as the persons of finished runs: distances of markers, flexions less ours."""
    try:
        moved_models.compare(console, results, model)
    except TrackerError as error:
        print_error(error)
        raise typer.Exit(2) from None


@app.command(epilog=rule_ledger.rules_as_text())
def ablate(
    rules: Annotated[str, typer.Option(help="Rules or groups, commas between; + for together.")] = "",
    only: Annotated[str, typer.Option(help="Only conditions or recordings whose name holds this.")] = "",
    starts: Annotated[int, typer.Option(min=1, max=8, help="Runs of each condition, three frames apart.")] = 3,
    python_path: Annotated[Path, typer.Option(help="Checkout whose package is run.")] = ROOT,
    output: Annotated[Path, typer.Option(help="Keeps all runs and scores.csv.")] = Path("results/rules"),
) -> None:
    """What each rule that steers tracking is worth: runs without it beside runs with all; goes on where it was."""
    try:
        rule_ledger.compare(console, rules, only, starts, python_path, output)
    except TrackerError as error:
        print_error(error)
        raise typer.Exit(2) from None


@app.command()
def scores(
    outputs: Annotated[list[Path], typer.Argument(help="Folders that `recordings` wrote to.")],
    picture: Annotated[Path, typer.Option(help="PNG to write.")] = Path("scores.png"),
) -> None:
    """Several runs of `recordings` as one picture, persons by bodies and evidence; how often their starts are right."""
    try:
        rows = [row for folder in outputs for row in read_scores(folder / "scores.csv")]
        scores_picture.draw(rows, picture)
        print_starts(console, rows)
    except (TrackerError, OSError) as error:
        print_error(error)
        raise typer.Exit(2) from None
    console.print(f"{picture}: {len(rows)} runs", highlight=False, soft_wrap=True)


@app.command()
def sizes(quick: Quick = False) -> None:
    """What 8 and 16 views, five persons, 4K and 2000 frames cost: processor time a frame and memory."""
    measured_sizes.compare(console, quick)


@app.command("in-step")
def in_step(only: Annotated[str, typer.Option(help="Part of a recording's name.")] = "") -> None:
    """Delays of views that are made: what is found of them before the first frame."""
    made_delays.compare(console, only)


@app.command()
def sigma(quick: Quick = False) -> None:
    """Whether the covariance is honest: real errors over predicted standard deviations."""
    uncertainty.compare(console, quick)


@app.command()
def segmentation(
    output: Annotated[Path | None, typer.Option(help="Folder for a picture of the contours.")] = None,
    quick: Quick = False,
) -> None:
    """Contours by level sets: milliseconds a view beside OpenCV's GrabCut, and the overlap with the exact mask."""
    level_sets.compare(console, quick, output)


@app.command()
def ways(
    n_frames: Annotated[int, typer.Option(min=3, help="Frames of each recording.")] = 30,
    only: Annotated[str, typer.Option(help="Only recordings and ways whose names hold this.")] = "",
    python_path: Annotated[Path, typer.Option(help="Checkout whose package is run.")] = ROOT,
    output: Annotated[Path, typer.Option(help="Keeps all runs.")] = Path("results/ways"),
) -> None:
    """Level sets and twists, the way of Rosenhahn et al., beside lines and edges on recordings without plates."""
    pose_ways.compare(console, n_frames, only, python_path, output)


@app.command()
def twists(
    n_frames: Annotated[int, typer.Option(min=3, help="Frames from each start on.")] = 40,
    only: Annotated[str, typer.Option(help="Only recordings whose name holds this.")] = "",
    starts: Annotated[int, typer.Option(min=1, max=8, help="Starts, a tenth of the recording apart.")] = 1,
    weights: Annotated[str, typer.Option(help="What points count in the refinement, commas between.")] = "1",
    python_path: Annotated[Path, typer.Option(help="Checkout whose package is run.")] = ROOT,
    output: Annotated[Path, typer.Option(help="Keeps all runs.")] = Path("results/twists"),
) -> None:
    """Turns of head and upper arms about their long axes on the room recordings, with and without followed points."""
    plan = limb_twists.Plan(n_frames, only, starts, tuple(map(float, weights.split(","))))
    limb_twists.compare(console, plan, python_path, output)


@app.command()
def lsm(quick: Quick = False) -> None:
    """Least squares matching: points a second, errors, bias and honesty of sigma, beside OpenCV's ECC."""
    patch_matching.compare(console, quick)


@app.command()
def surface(
    only: Annotated[str, typer.Option(help="Only recordings whose name holds this.")] = "", quick: Quick = False
) -> None:
    """Surfaces measured from real images, against a known cylinder, one another, and true disparities."""
    measured_surfaces.compare(console, only, quick)


@app.command()
def follow(
    only: Annotated[str, typer.Option(help="Only tables whose name holds this.")] = "", quick: Quick = False
) -> None:
    """Points followed on a moving back: errors, losses, occlusion, interlaced images, one view, speed, strain."""
    followed_points.compare(console, only, quick)


@app.command()
def recognition(
    tracked: Annotated[bool, typer.Option("--tracked", help="Also tracks the rooms' videos: minutes.")] = False,
    quick: Quick = False,
) -> None:
    """Movements of other persons and performances than the library's: confusions, false alarms, ends."""
    known_movements.compare(console, tracked, quick)


@app.command()
def acquisition(
    poses: Annotated[str, typer.Option(help="Postures, commas between: tpose, apose, hang.")] = "tpose",
    model: Annotated[str, typer.Option(help="General model.")] = "gavrila22",
    quick: Quick = False,
) -> None:
    """Models from the rendered silhouettes in BODYTRACK_DATA: overlap, and lengths against the truth."""
    acquired_models.compare(console, poses, model, quick)


@app.command()
def calibration(quick: Quick = False) -> None:
    """Calibration from scratch with a reference bar: convergence, precision beside the true calibration's, time."""
    bar_calibration.compare(console, quick)


if __name__ == "__main__":
    app()
