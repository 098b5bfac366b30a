"""Processor time of a refinement in one compiled call, beside the same asked of the evidence step by step."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.trial import default_cycle, tracked
from tracker.evidence.measures.correspondences import Equations
from tracker.foundation.arrays import Array
from tracker.synthesis import cpu
from tracker.synthesis.simulation.sequence import Recipe, simulate
from tracker.tracking.estimation import twist_icp
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective


@dataclass(frozen=True)
class Refined:
    """One refinement, both ways."""

    compiled_s: float
    stepwise_s: float
    """Least processor time of this thread, of some repeats in turn."""

    apart: float
    """Largest difference of the two poses, rad or m."""


def compare(console: Console, n_frames: int, quick: bool) -> None:
    """Prints what the refinements of a simulated walking cost, with plates and without."""
    size, n_frames, repeats = ((320, 240), 3, 1) if quick else ((720, 576), n_frames, 5)
    table = Table(title="a refinement: all kinds of evidence, four views", title_justify="left")
    for column in (
        "plates",
        "refinements",
        "step by step ms",
        "compiled ms",
        "to step by step",
        "poses apart, at most",
    ):
        table.add_column(column, justify="right")
    for plates in (True, False):
        with console.status(f"plates: {plates}"):
            refined = _refinements(size, n_frames, plates, repeats)
        stepwise, compiled = (sum(getattr(one, f"{way}_s") for one in refined) for way in ("stepwise", "compiled"))
        ms = (f"{1000 * seconds / len(refined):.2f}" for seconds in (stepwise, compiled))
        apart = f"{max(one.apart for one in refined):.0e}"
        table.add_row("yes" if plates else "no", str(len(refined)), *ms, f"{stepwise / compiled:.2f}x", apart)
    console.print(table)


def _refinements(size: tuple[int, int], n_frames: int, plates: bool, repeats: int) -> list[Refined]:
    simulation = simulate(Recipe("walking_on_the_spot", seconds=n_frames / 25, size=size))
    truth, known = simulation.poses[0], simulation.plates
    cycle = default_cycle(truth[0], known if plates else (None,) * len(known), recovers=False)
    found: list[Refined] = []
    with _measured(found, repeats):
        tracked(simulation.frames(), simulation.scene, truth, cycle)
    return found


def _step_by_step() -> AbstractContextManager[object]:
    """Has refinements find nothing compiled."""
    return patch.object(twist_icp, "compiled_descent", lambda objective: None)


@contextmanager
def _measured(found: list[Refined], repeats: int) -> Iterator[None]:
    """Has every refinement made both ways, in turn."""
    usual = TwistIcpEstimation._descend

    def measured(
        self: TwistIcpEstimation, objective: Objective, start: Array, q: Array, gates: list[float]
    ) -> tuple[Array, Equations]:
        def refine(way: AbstractContextManager[object]) -> tuple[float, tuple[Array, Equations]]:
            objective._answers.clear()
            cpu._TRACED.clear()  # or the repeats would trace nothing
            with way:
                begin = time.thread_time()
                reached = usual(self, objective, start, q, gates)
                return time.thread_time() - begin, reached

        if not gates:
            return usual(self, objective, start, q, gates)
        pairs = [(refine(_step_by_step()), refine(nullcontext())) for _ in range(repeats)]
        stepwise, together = zip(*pairs, strict=True)
        apart = float(np.abs(stepwise[0][1][0] - together[0][1][0]).max())
        found.append(Refined(min(s for s, _ in together), min(s for s, _ in stepwise), apart))
        reached: tuple[Array, Equations] = together[0][1]
        return reached

    with patch.object(TwistIcpEstimation, "_descend", measured):
        yield
