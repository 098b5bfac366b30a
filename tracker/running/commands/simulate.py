"""`bodytrack simulate`: what your cameras will achieve, before you film."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from tracker.foundation.errors import InitializationError
from tracker.running.commands import ProgressBar, console, marked

if TYPE_CHECKING:
    from tracker.results.evaluation.comparison import PersonErrors
    from tracker.synthesis.simulation.filming import Plan
    from tracker.synthesis.simulation.prospect import Prospect, Views


def simulate(
    rig: Annotated[Path, typer.Option(help="Calibration, in any layout that `rig convert` reads.")],
    movement: Annotated[str, typer.Option(help="Movement in the model's file.")] = "walk",
    person: Annotated[
        float | None, typer.Option(help="Stature, metres: scales the model; default: its own.", min=0.04, max=5)
    ] = None,
    model: Annotated[str, typer.Option(help="Bundled body model, or a model file.")] = "gavrila22",
    seconds: Annotated[float, typer.Option(min=0.2, max=600, help="Length.")] = 3.0,
    fps: Annotated[float, typer.Option(min=1, max=1000, help="Frames per second.")] = 25.0,
    noise_grey: Annotated[float, typer.Option(min=0, help="Sensor noise, grey levels.")] = 3.0,
    blur_px: Annotated[float, typer.Option(min=0, help="Lens blur, px.")] = 0.6,
    exposure_ms: Annotated[float, typer.Option(min=0, help="Shutter time: movements meanwhile are blurred.")] = 0.0,
    edge_px: Annotated[float, typer.Option(min=0.05, help="Error of an edge, px, for the expected sigmas.")] = 1.0,
    place: Annotated[tuple[float, float] | None, typer.Option(help="Middle of the way, x and y, metres.")] = None,
    heading_deg: Annotated[float | None, typer.Option(help="Direction faced at the start, from x.")] = None,
    size: Annotated[str | None, typer.Option(help="Image size WxH, if the rig does not have it.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder to make; default results/simulated/MOVEMENT.")] = None,
    tracking: Annotated[bool, typer.Option("--track/--no-track", help="Track the recording, for real errors.")] = True,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the room and the noise.")] = 0,
) -> None:
    """Films a simulated body with your cameras: errors to expect, what each view adds, what stays hidden."""
    from tracker.foundation.files import check_empty
    from tracker.running.commands.rig import told_rig
    from tracker.synthesis.simulation.filming import film, plan
    from tracker.synthesis.simulation.sequence import Recipe

    recipe = Recipe(
        movement,
        model,
        seconds,
        fps,
        noise_grey=noise_grey,
        blur_px=blur_px,
        exposure_s=exposure_ms / 1000,
        seed=seed,
        stature_m=person,
    )
    planned = plan(recipe, told_rig(rig, size), place, heading_deg)
    folder = output or Path("results") / "simulated" / planned.recipe.movement
    check_empty(folder)
    expected = planned.prospect(edge_px)
    _tell_place(planned)
    with ProgressBar() as progress:
        config = film(planned, expected, folder, progress)
    errors = _tracked(config, folder) if tracking else None
    _print_errors(expected, errors)
    _print_views(expected)
    _print_visible(expected)
    _tell_enough(planned, expected)
    console.print(f"written to {folder}: volume.png, prospect.json, videos, run.toml", highlight=False, soft_wrap=True)
    console.print(f"to try it all: bodytrack run {config}", highlight=False, soft_wrap=True)


def _tell_place(planned: Plan) -> None:
    from tracker.synthesis.simulation.common_volume import sizes

    (x, y), n = planned.place, len(planned.rig)
    console.print(
        f"{planned.recipe.movement.replace('_', ' ')} around x {x:.2f} m, y {y:.2f} m, heading "
        f"{planned.recipe.heading_deg:.0f} degrees, where {planned.whole} of {n} cameras see the whole body",
        highlight=False,
    )
    areas = sizes({k: planned.floor.area_m2(k) for k in range(2, n + 1)}, "m2")
    console.print(f"floor area where cameras see the whole body: {areas}", highlight=False)
    if planned.whole < 2:
        nowhere = "no place where two cameras see the whole body: set them back or use wider lenses"
        elsewhere = "two cameras do not see the whole body at --place: choose another one, or leave it out"
        told = elsewhere if planned.floor.area_m2(2) > 0 else nowhere
        console.print(marked("look", told), highlight=False)


def _tracked(config: Path, folder: Path) -> PersonErrors | None:
    """Errors of tracking the recording from its first frame on; None if the person is not found in it."""
    from tracker.foundation.files import write_json
    from tracker.results.evaluation.comparison import evaluate
    from tracker.running.commands import done
    from tracker.running.jobs import load_job

    try:
        result = done(load_job("track", config), folder / "tracking")
    except InitializationError as error:
        console.print(
            marked("look", f"the person is not found in the recording: {error}"), highlight=False, soft_wrap=True
        )
        return None
    if result.interrupted:
        raise typer.Exit(130)
    evaluation = evaluate(result.folder, folder)
    write_json(result.folder / "evaluation.json", evaluation.as_dict())
    errors = evaluation.persons[0]
    console.print(
        f"tracked: {errors.n_missing} of {errors.n_frames} frames lost; joints {errors.mean_mm:.1f} mm mean, "
        f"angles {errors.angles_rms_deg:.2f} deg RMS",
        highlight=False,
    )
    return errors


def _print_errors(expected: Prospect, errors: PersonErrors | None) -> None:
    title = "expected standard deviations, and the errors of tracking the simulated recording with the exact body in it"
    table = Table(title=title if errors else "expected standard deviations", title_justify="left")
    for column in ("", "sigma", "worst frame", *(("mean distance, RMS angle",) if errors else ())):
        table.add_column(column, justify="left" if not column else "right")
    for name, (rms, worst) in expected.joints_mm.items():
        cells = [f"{errors.joints_mm[name][0]:.1f} mm" if name in errors.joints_mm else ""] if errors else []
        table.add_row(name.replace("_", " "), f"{rms:.1f} mm", f"{worst:.1f} mm", *cells)
    table.add_section()
    for name, (rms, worst) in expected.parameters.items():
        parameter, _, unit = name.rpartition("_")
        cells = [_error(errors, parameter, unit)] if errors else []
        table.add_row(parameter.replace("_", " "), f"{rms:.1f} {unit}", f"{worst:.1f} {unit}", *cells)
    console.print(table)


def _error(errors: PersonErrors, parameter: str, unit: str) -> str:
    if unit == "deg":
        return f"{errors.parameters.get(f'{parameter}_deg', float('nan')):.1f} deg"
    return f"{1000 * errors.parameters.get(f'{parameter}_m', float('nan')):.1f} mm"


def _print_views(expected: Prospect) -> None:
    def row(views: Views) -> tuple[str, str, str]:
        joint, angle = views.worst_joint.replace("_", " "), views.worst_angle.replace("_", " ")
        return f"{views.sigma_mm:.1f} mm", f"{joint} {views.worst_mm:.1f} mm", f"{angle} {views.worst_deg:.1f} deg"

    table = Table(
        "cameras", "joints, sigma", "worst joint", "worst angle", title="what views add", title_justify="left"
    )
    table.add_row("all", *row(expected.all_views), end_section=True)
    for name, views in expected.without.items():
        table.add_row(f"without {name}", *row(views), end_section=name == list(expected.without)[-1])
    for n, views in expected.fewest.items():
        if n < len(expected.all_views.names):
            table.add_row(f"best {n}: {', '.join(views.names)}", *row(views))
    console.print(table)


def _print_visible(expected: Prospect) -> None:
    names = expected.all_views.names
    table = Table(
        "segment", *names, "hidden", title="share of each segment's surface that is seen", title_justify="left"
    )
    for segment, shares in expected.visible.items():
        hidden = expected.hidden[segment]
        cells = [f"{100 * shares[name]:.0f} %" for name in names]
        colour = "red" if hidden > 0.5 else "yellow" if hidden > 0 else "dim"
        table.add_row(segment.replace("_", " "), *cells, Text(f"{100 * hidden:.0f} %", style=colour))
    console.print(table)
    console.print("hidden: share of the frames in which fewer than two views show a quarter of it", style="dim")


def _tell_enough(planned: Plan, expected: Prospect) -> None:
    if not any(share for shares in expected.visible.values() for share in shares.values()):
        return  # no camera sees anything of the body
    n, views = len(planned.rig), expected.fewest[expected.enough]
    if expected.enough < n:
        console.print(
            f"{expected.enough} of the {n} cameras would do ({', '.join(views.names)}): {views.sigma_mm:.1f} mm "
            f"instead of {expected.all_views.sigma_mm:.1f}; further ones help where limbs hide",
            highlight=False,
        )
    else:
        console.print(f"all {n} cameras are needed: without any of them errors grow by half or more", highlight=False)
