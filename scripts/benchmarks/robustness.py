"""What the tracking survives: fast movement, clutter, missing views, wrong bodies, wrong starts."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.conditions import Condition, conditions
from benchmarks.trial import LIMB_MM, Outcome, default_cycle, error_cells, longest, tracked
from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Mask
from tracker.synthesis.simulation.sequence import Recipe, Simulation, simulate

MOVEMENTS = ("two_elbow_rotation", "walking_on_the_spot", "arm_swing")
# Degrees in every joint: twice what a bootstrapping leaves, and twice that again.
START_ERRORS = (5, 10, 15, 20)
_COLUMNS = (
    *("frames", "lost", "longest loss", "until recovered", "limb off", "joints mean mm", "joints 95 % mm"),
    *("hinge RMS deg", "verdict"),
)
_START_COLUMNS = ("n", "< 20 mm in 10 frames", "flagged lost", "silently wrong", "joints mean mm", "hinge RMS deg")
# Tracked poses are good to 5 mm; 10 frames are 0.4 s.
_CONVERGED_MM, _START_FRAMES = 20.0, 10


def compare(console: Console, only: str, quick: bool, trace: bool) -> None:
    """Prints the table of conditions, then that of start errors.

    Args:
        console: where to.
        only: part of the condition's or movement's name; empty for all.
        quick: small images and few frames, to see that it runs.
        trace: also print every frame that is lost or has a limb off.
    """
    size, seconds = ((320, 240), 0.4) if quick else ((640, 480), 4.0)
    movements = MOVEMENTS[:1] if quick else MOVEMENTS
    table = _table("condition", f"{size[0]}x{size[1]}, four views, true start pose", _COLUMNS)
    for condition in conditions(movements):
        if only.lower() in f"{condition.name} {condition.movement}".lower():
            with console.status(f"{condition.name}, {condition.movement}"):
                outcome = _run(condition, size, seconds)
            table.add_row(condition.name, condition.movement, *_row(outcome))
            if trace:
                for line in _trace(outcome):
                    console.print(f"{condition.name}, {condition.movement}: {line}", highlight=False, soft_wrap=True)
    if table.rows:
        console.print(table)
        console.print(_LEGEND, style="dim", soft_wrap=True)
    _compare_starts(console, size, movements[:2], only, 2 if quick else 8)


_LEGEND = (
    "joints and hinges over the frames not flagged lost; until recovered: longest run of frames lost or more than "
    f"100 mm off on average; limb off: frames not lost with a joint more than {LIMB_MM:.0f} mm off"
)


def _table(first: str, title: str, columns: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column(first, no_wrap=True)
    table.add_column("movement", no_wrap=True)
    for column in columns:
        table.add_column(column, justify="left" if column == "verdict" else "right", no_wrap=column == "verdict")
    return table


@lru_cache(maxsize=4)
def _simulated(recipe: Recipe) -> Simulation:
    return simulate(recipe)


def _run(condition: Condition, size: tuple[int, int], seconds: float) -> Outcome:
    simulation = condition.recorded(_simulated(condition.recipe(size, seconds)))
    truth = simulation.poses[0]
    cycle = default_cycle(truth[0], condition.known_plates(simulation))
    return tracked(condition.frames(simulation), condition.scene(simulation), truth, cycle)


def _row(outcome: Outcome) -> list[str]:
    lost = outcome.lost
    off = limb_off(outcome)
    bad = lost | outcome.wrong
    counts = len(lost), int(lost.sum()), longest(lost)
    until = "never" if bad[-1] else str(longest(bad))
    return [
        *map(str, counts),
        until,
        str(int(off.sum())),
        *outcome.error_cells(),
        verdict(outcome),
    ]


def limb_off(outcome: Outcome) -> Mask:
    """(T,) frames not flagged lost in which a joint is far off, whatever the mean."""
    off: Mask = (outcome.joints_mm.max(axis=1) > LIMB_MM) & ~outcome.lost
    return off


def verdict(outcome: Outcome, patience: int = 10) -> str:
    """Whether the tracking held, recovered or failed without saying so, and a limb that was off all the same."""
    lost, wrong = outcome.lost, outcome.wrong
    n_off = int((limb_off(outcome) & ~wrong).sum())
    if not (lost | wrong).any():
        return f"[yellow]tracked, a limb off in {n_off} frames[/]" if n_off else "tracked"
    off = f", a limb off in {n_off} others" if n_off else ""
    unflagged = longest(wrong & ~lost)
    if unflagged > patience or (wrong & ~lost)[-1]:
        return f"[red]FAILED: unflagged for {unflagged} frames{off}[/]"
    if lost[-1]:
        return f"[yellow]lost at the end, flagged for {longest(lost)} frames{off}[/]"
    recovered = f"recovered in {longest(lost | wrong)} frames{off}"
    return f"[yellow]{recovered}[/]" if off else recovered


def _trace(outcome: Outcome) -> Iterator[str]:
    """A line for every frame that is lost or has a limb off: what the evidence said, and which joints are off."""
    for t, (estimate, errors) in enumerate(zip(outcome.estimates, outcome.joints_mm, strict=True)):
        if estimate.lost or errors.max() > LIMB_MM:
            worst = np.argsort(errors)[::-1][:3]
            names = ", ".join(f"{outcome.body.landmark_names[k]} {errors[k]:.0f}" for k in worst)
            yield (
                f"frame {t} {estimate.status}: explained {estimate.account.explained:.2f}, "
                f"{estimate.distance_px:.1f} px, {estimate.evaluations} evaluations; mean {errors.mean():.0f} mm, "
                f"worst {names} mm"
            )


def _compare_starts(
    console: Console, size: tuple[int, int], movements: tuple[str, ...], only: str, n_seeds: int
) -> None:
    """Starts off by as many degrees in every angle as centimetres in place, not looked for again."""
    table = _table("start error", "wrong start poses, no later bootstrapping", _START_COLUMNS)
    for movement in movements:
        for error in START_ERRORS:
            name = f"start {error} deg, {error} cm"
            if only.lower() in f"{name} {movement}".lower():
                with console.status(f"{name}, {movement}"):
                    outcomes = _wrong_starts(_simulated(Recipe(movement, seconds=0.4, size=size)), error, n_seeds)
                table.add_row(name, movement, *_start_row(outcomes))
    if table.rows:
        console.print(table)


def _wrong_starts(simulation: Simulation, error: float, n_seeds: int) -> list[Outcome]:
    frames, truth = list(simulation.frames())[:_START_FRAMES], simulation.poses[0]
    outcomes = []
    for seed in range(n_seeds):
        start = wrong_start(simulation.scene.persons[0].body, truth[0], error, seed)
        cycle = default_cycle(start, simulation.plates, recovers=False)
        outcomes.append(tracked(frames, simulation.scene, truth, cycle))
    return outcomes


def wrong_start(body: BodyModel, q: Array, error: float, seed: int) -> Array:
    """A pose (dof,) whose angles are all off by some degrees and whose place is off by as many centimetres."""
    rng = np.random.default_rng((seed, 77))
    off = np.radians(error) * rng.choice([-1.0, 1.0], body.dof)
    shift = rng.normal(size=int((~body.rotates).sum()))
    off[~body.rotates] = 0.01 * error * shift / np.linalg.norm(shift)
    return body.clamped(q + off)


def _start_row(outcomes: list[Outcome]) -> list[str]:
    last = np.array([outcome.joints_mm[-1] for outcome in outcomes])
    flagged = np.array([bool(outcome.lost.any()) for outcome in outcomes])
    converged = (last.mean(axis=1) < _CONVERGED_MM) & ~np.array([bool(outcome.lost[-1]) for outcome in outcomes])
    silent = ~converged & ~flagged
    hinges = np.array([outcome.hinges_deg[-1] for outcome in outcomes])
    counts = converged.sum(), flagged.sum(), silent.sum()
    joints, _, hinge = error_cells(last, hinges)
    return [str(len(outcomes)), *(str(int(count)) for count in counts), joints, hinge]
