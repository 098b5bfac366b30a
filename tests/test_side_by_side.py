"""Work done in threads finds what a loop finds."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, small_simulation
from rounding import SINGLE, assert_alike

from tracker.synthesis import side_by_side
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.egl import EglSynthesis
from tracker.synthesis.osmesa import OsmesaSynthesis
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.initialization._stance_search import ROUNDS
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.initialization.stance import StanceInitialization
from tracker.tracking.rehearsal import rehearsed
from tracker.tracking.start import Start


@pytest.mark.parametrize("synthesis", [CpuSynthesis(), EglSynthesis(), OsmesaSynthesis()])
def test_the_order_is_that_of_the_loop_and_a_graphics_context_stays_in_its_thread(synthesis):
    asked = set()

    def doubled(one: int) -> int:
        asked.add(threading.get_ident())
        return 2 * one

    assert side_by_side(synthesis, doubled, range(5)) == [0, 2, 4, 6, 8]
    assert (threading.get_ident() in asked) == (not isinstance(synthesis, CpuSynthesis))


def test_what_one_raises_is_raised():
    with pytest.raises(ZeroDivisionError):
        side_by_side(CpuSynthesis(), lambda one: 1 // one, [1, 0])


HASTY = BestFirstEstimation(range_deg=20.0, step_deg=20.0, range_m=0.05, step_m=0.05, halvings=0, patience=1)
"""What is found need not be right."""


def started(in_threads: bool, monkeypatch: pytest.MonkeyPatch) -> tuple[Start, Start]:
    """A start before plates that do not know all, as it is found and after a rehearsal."""
    monkeypatch.setattr(CpuSynthesis, "threads", in_threads)
    simulation = small_simulation("two_elbow_rotation", n_frames=4)
    unknown = np.zeros(simulation.plates[0].picture.shape[:2], dtype=bool)
    unknown[:40, :60] = True
    plates = tuple(replace(plate, unknown=unknown) for plate in simulation.plates)
    cycle = cycle_for(simulation, TrueStart(simulation), plates=plates, estimation=TwistIcpEstimation())
    cycle = replace(cycle, loss=replace(cycle.loss, rehearse=2, sure=1.0))
    first = next(iter(simulation.frames()))
    by_axis = PcaInitialization(hypotheses=2, finalists=2, turn_step_deg=60.0, fine=HASTY)
    found = by_axis.start(first, simulation.scene, cycle.stages)
    return found, rehearsed(found, first, simulation.scene, cycle, simulation.frames)


def on_edges(in_threads: bool, monkeypatch: pytest.MonkeyPatch) -> tuple[Start]:
    """A start without plates, limbs looked for anew."""
    monkeypatch.setattr(CpuSynthesis, "threads", in_threads)
    monkeypatch.setattr("tracker.tracking.initialization._limbs_anew._LEFT_OVER", 0.0)
    monkeypatch.setattr("tracker.tracking.initialization.stance.ROUNDS", ROUNDS[-1:])
    simulation = small_simulation("two_elbow_rotation", n_frames=1)
    stages = replace(cycle_for(simulation, estimation=TwistIcpEstimation()).stages, plates=(None,) * 4)
    initialization = StanceInitialization(hypotheses=2, finalists=2, step_m=0.6, farthest_m=6.0, least_score=1e-3)
    return (initialization.start(next(iter(simulation.frames())), simulation.scene, stages),)


@pytest.mark.parametrize("started", [started, on_edges])
def test_a_start_in_threads_is_that_of_a_loop(started, monkeypatch):
    for one, other in zip(started(True, monkeypatch), started(False, monkeypatch), strict=True):
        assert one.sureness == pytest.approx(other.sureness, rel=SINGLE)
        for mine, its in zip(one.hypotheses[0], other.hypotheses[0], strict=True):
            assert_alike(mine.q, its.q, SINGLE)
            assert (mine.distance_px, mine.left_over) == pytest.approx((its.distance_px, its.left_over), rel=SINGLE)
