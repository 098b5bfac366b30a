"""The command line: the only place that prints and exits."""

from __future__ import annotations

import dataclasses
import json
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from tracker.commands.acquire import acquire
from tracker.commands.calibrate import calibrate_app
from tracker.commands.frames import frame_range
from tracker.commands.rig import rig_app
from tracker.commands.surface import measure
from tracker.commands.warmup import prepare_kernels, warmup
from tracker.components import available, find
from tracker.config import component_stage
from tracker.demo import run_demo
from tracker.errors import ConfigError, TrackerError, nearest
from tracker.evaluation.comparison import Evaluation, PersonErrors, error_figure, evaluate
from tracker.progress import RunProgress
from tracker.run import RunResult, execute, load_run, with_frames
from tracker.simulation.sequence import Recipe

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Model-based, marker-less motion capture from calibrated views.",
)
app.add_typer(calibrate_app, name="calibrate")
app.add_typer(rig_app, name="rig")
console = Console()
STAGES = (
    "reading",
    "calibration",
    "synthesis",
    "evidence",
    "analysis",
    "similarity",
    "prediction",
    "estimation",
    "initialization",
    "recording",
)


def main() -> None:
    """Entry point: every error a user can cause is one line and exit code 2."""
    try:
        app()
    except TrackerError as error:
        if "--debug" in sys.argv:
            raise
        Console(stderr=True).print(f"[bold red]error:[/] {_escaped(str(error))}", soft_wrap=True, highlight=False)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted")
        raise SystemExit(130) from None


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")


def _print_version(wanted: bool) -> None:
    if wanted:
        console.print(f"bodytrack {version('bodytrack')}", highlight=False)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Model-based, marker-less motion capture from calibrated views."""


@app.command()
def demo(
    output: Annotated[Path | None, typer.Option(help="Result folder; default results/demo/TIME.")] = None,
    movement: Annotated[str, typer.Option(help="Movement simulated.")] = "two_elbow_rotation",
    frames: Annotated[int, typer.Option(min=5, help="Number of frames.")] = 75,
    seed: Annotated[int, typer.Option(help="Chooses the room and the noise.")] = 0,
) -> None:
    """Simulates a clothed person in a cluttered room, tracks it from bootstrapping, and compares with the truth."""
    prepare_kernels()
    recipe = Recipe(movement, seconds=frames / Recipe.fps, seed=seed)
    with RunProgress(console) as progress:
        outcome = run_demo(recipe, output, progress)
    _print_result(outcome.result)
    if outcome.evaluation is not None:
        _print_evaluation(outcome.evaluation)


@app.command()
def run(
    config: Annotated[Path, typer.Argument(help="Configuration, TOML.")],
    output: Annotated[Path | None, typer.Option(help="Result folder; default results/NAME/TIME.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Override: section.key=value; repeatable.")] = None,
    frames: Annotated[str | None, typer.Option(help="Range A:B of frames, either end may be left out.")] = None,
    resume: Annotated[bool, typer.Option(help="Continue an interrupted run in --output, or the latest one.")] = False,
) -> None:
    """Tracks a sequence."""
    described = load_run(config, set_ or [])
    if frames is not None:
        described = with_frames(described, *frame_range(frames))
    prepare_kernels()
    with RunProgress(console) as progress:
        result = execute(described, output, resume, progress)
    _print_result(result)
    if result.interrupted:
        raise typer.Exit(130)


@app.command()
def show(stage: Annotated[str | None, typer.Argument(help="A stage; none lists all.")] = None) -> None:
    """Lists the components of the stages, or the fields of one stage's components."""
    if stage is None:
        table = Table("stage", "component", "what it is", title="components")
        for name in STAGES:
            for use in available(name):
                table.add_row(name, use, (find(name, use).__doc__ or "").split("\n")[0])
        console.print(table)
        return
    if stage not in STAGES:
        raise ConfigError(f'no stage "{stage}"; {nearest(stage, STAGES)}')
    for use in available(stage):
        console.print(_component_table(stage, use))


def _component_table(stage: str, use: str) -> Table:
    cls: Any = find(stage, use)
    table = Table(
        "field", "default", "meaning", title=f'[{stage}] use = "{use}"'.replace("[", r"\["), title_justify="left"
    )
    described = cls.__pydantic_fields__
    for field in dataclasses.fields(cls):
        info = described[field.name]
        default = "required" if info.is_required() else _shown_default(info.get_default(call_default_factory=True))
        table.add_row(field.name, default, (info.description or "").replace("\n", " "))
    return table


def _shown_default(value: Any) -> str:
    stage = component_stage(type(value))
    if stage is not None:
        return f'{{ use = "{type(value).__module__.rpartition(".")[2]}", ... }}'
    return str(value)


@app.command("evaluate")
def evaluate_command(
    result: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    truth: Annotated[Path, typer.Option(help="Table of true joints, or the folder it is in.")],
) -> None:
    """Compares a result with a truth: joint distances, angles, silhouettes; writes evaluation.json and .png."""
    evaluation = evaluate(result, truth)
    (result / "evaluation.json").write_text(json.dumps(evaluation.as_dict(), indent=1) + "\n", encoding="utf-8")
    error_figure(evaluation).savefig(result / "evaluation.png", dpi=110)
    _print_evaluation(evaluation)


app.command()(acquire)
app.command("surface")(measure)
app.command("warmup")(warmup)


def _print_result(result: RunResult) -> None:
    rate = result.n_frames / result.seconds if result.seconds else 0.0
    state = "interrupted after" if result.interrupted else "tracked"
    console.print(
        f"{state} {result.n_frames} frames, {result.n_lost} lost, {rate:.1f} frames/s all included", highlight=False
    )
    files = ", ".join(path.name for path in result.files) or "no recordings chosen"
    console.print(f"results in {result.folder}: {files}", highlight=False)


def _print_evaluation(evaluation: Evaluation) -> None:
    table = Table(title="errors against the truth", title_justify="left")
    table.add_column("")
    for person in evaluation.persons:
        table.add_column(person.person, justify="right")
    rows: list[tuple[str, list[str]]] = [
        ("frames compared", [str(p.n_frames - p.n_missing) for p in evaluation.persons]),
        ("frames lost", [str(p.n_missing) for p in evaluation.persons]),
        ("joint distance, mean", [f"{p.mean_mm:.1f} mm" for p in evaluation.persons]),
        ("joint distance, median", [f"{p.median_mm:.1f} mm" for p in evaluation.persons]),
        ("joint distance, 95 %", [f"{p.p95_mm:.1f} mm" for p in evaluation.persons]),
        ("mean, joint offsets removed", [f"{p.mean_offset_removed_mm:.1f} mm" for p in evaluation.persons]),
    ]
    if any(person.parameters for person in evaluation.persons):
        rows.append(("joint angles, RMS", [f"{p.angles_rms_deg:.2f} deg" for p in evaluation.persons]))
    for hinge in evaluation.persons[0].hinges_deg:
        rows.append(
            (f"{hinge.replace('_', ' ')}, RMS (offset removed)", [_hinge(p, hinge) for p in evaluation.persons])
        )
    for joint, _ in sorted(evaluation.persons[0].joints_mm.items()):
        rows.append((f"{joint.replace('_', ' ')} (offset removed)", [_joint(p, joint) for p in evaluation.persons]))
    for name, values in rows:
        table.add_row(name, *values)
    console.print(table)
    if evaluation.silhouette_iou:
        views = ", ".join(f"{view} {value:.3f}" for view, value in evaluation.silhouette_iou.items())
        mean = sum(evaluation.silhouette_iou.values()) / len(evaluation.silhouette_iou)
        console.print(f"silhouette IoU {mean:.3f} ({views})", highlight=False)


def _hinge(person: PersonErrors, hinge: str) -> str:
    raw, removed = person.hinges_deg.get(hinge, (float("nan"),) * 2)
    return f"{raw:.2f} deg ({removed:.2f})"


def _joint(person: PersonErrors, joint: str) -> str:
    raw, removed = person.joints_mm.get(joint, (float("nan"),) * 2)
    return f"{raw:.1f} mm ({removed:.1f})"
