"""Persons who come in after the first windows: the frames before are tracked back from where everybody is found."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from doubted import in_doubt
from recordings import Staying, TrueStart, cycle_for, joint_errors_mm, small_simulation, with_images

import tracker.tracking.coming_in
from tracker.cameras.frame import Frame
from tracker.evidence.auto import AutoEvidence
from tracker.foundation.arrays import Image
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.backwards import as_replay, frames_before
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Status
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.loss import LossRule
from tracker.tracking.trajectory import Replay, Step
from tracker.tracking.two_passes import track_twice

IN_VIEW, NOBODY_BEFORE = 5, 9
"""From which frame on the person is there, and is looked for: in the third window."""


@pytest.fixture(scope="module", autouse=True)
def _short_windows() -> Iterator[None]:
    """And limbs are not looked for in other places after a loss: that takes half of the time, and is no window's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tracker.tracking.windows._LONGEST", 4)
        patch.setattr("tracker.tracking.two_passes.SHORTEST", 4)
        patch.setattr("tracker.tracking.cycle_turn.in_likeliest_places", lambda _, estimate, *more: estimate)
        yield


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("walking_on_the_spot", n_frames=24)


@pytest.fixture(scope="module")
def frames(simulation: Simulation) -> tuple[Frame, ...]:
    def shown(t: int, v: int, image: Image | None) -> Image | None:
        return simulation.plates[v].picture.copy() if t < IN_VIEW else image

    return tuple(itertools.islice(with_images(simulation, shown), 14))


@pytest.fixture(scope="module")
def cycle(simulation: Simulation) -> Cycle:
    """Poses are refined and never searched: who is there is a little off, and in the empty room a search is in vain."""
    return cycle_for(
        simulation,
        TrueStart(simulation),
        evidence=AutoEvidence(),
        estimation=TwistIcpEstimation(),
        nobody_before=NOBODY_BEFORE,
        loss=LossRule(rehearse=0, start_within=1),
    )


def tracked(
    simulation: Simulation, frames: tuple[Frame, ...], cycle: Cycle, done: dict[int, Replay] | None = None
) -> list[Step]:
    return list(track_twice(iter(frames), simulation.scene, cycle, done or {}, lambda: iter(frames)))


@pytest.fixture(scope="module")
def whole(simulation: Simulation, frames: tuple[Frame, ...], cycle: Cycle) -> list[Step]:
    """All of it, at once."""
    return tracked(simulation, frames, cycle)


def kept(steps: list[Step]) -> dict[int, Replay]:
    """What a journal has of them."""
    return {step.frame.index: as_replay(step) for step in steps}


def test_who_comes_in_is_tracked_back_over_windows(
    simulation: Simulation, frames: tuple[Frame, ...], whole: list[Step]
) -> None:
    steps = whole
    assert [step.frame.index for step in steps] == list(range(14))
    assert all(step.frame.images[0] is frame.images[0] for step, frame in zip(steps, frames, strict=True))
    assert [step.estimates[0].lost for step in steps] == [True] * IN_VIEW + [False] * (14 - IN_VIEW)
    assert [step.frame.index for step in steps if step.start is not None] == [NOBODY_BEFORE]
    errors = [joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean() for step in steps]
    assert max(errors[IN_VIEW:]) < 15
    assert [step.ready for step in steps] == [*range(11, -1, -1), 1, 0], "frames that are ready at once are told"
    assert not any(step.provisional for step in steps)


@pytest.mark.parametrize(("gone_s", "n_pieces"), [(0.03, 2), (0.1, 3), (100.0, 4)])
def test_an_empty_room_is_not_gone_through_for_long(
    simulation: Simulation,
    frames: tuple[Frame, ...],
    cycle: Cycle,
    monkeypatch: pytest.MonkeyPatch,
    gone_s: float,
    n_pieces: int,
) -> None:
    told: list[str] = []
    monkeypatch.setattr(tracker.tracking.coming_in, "_GONE_S", gone_s)
    monkeypatch.setattr(tracker.tracking.coming_in, "_LONGEST", 2)
    steps = tracked(simulation, frames, replace(cycle, progress=lambda line, *_: told.append(line)))
    assert [step.estimates[0].lost for step in steps] == [True] * IN_VIEW + [False] * (14 - IN_VIEW)
    assert sum(line.startswith("back to the first frame") for line in told) == n_pieces


def test_what_is_in_doubt_on_the_way_back_is_tracked_the_other_way_as_well(
    simulation: Simulation, frames: tuple[Frame, ...], cycle: Cycle
) -> None:
    told: list[str] = []
    doubting = replace(cycle.loss, doubtful_above=0.0, again_after=100)
    steps = tracked(simulation, frames, replace(cycle, loss=doubting, progress=lambda line, *_: told.append(line)))
    for way in ("forwards", "back"):
        assert any(line.startswith(f"{way}: frame {IN_VIEW + 1}, ") for line in told)
    errors = [joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean() for step in steps]
    assert max(errors[IN_VIEW:]) < 15


def test_a_limb_that_jumps_between_two_windows_is_told(
    simulation: Simulation, frames: tuple[Frame, ...], cycle: Cycle, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = list[list[int]]()

    def doubting_all(steps: list[Step]) -> list[Step]:
        seen.append([step.frame.index for step in steps])
        return [replace(step, estimates=(in_doubt(step.estimates[0], "left_arm"),)) for step in steps]

    monkeypatch.setattr(tracker.tracking.coming_in, "_LONGEST", 2)
    monkeypatch.setattr(tracker.tracking.coming_in, "with_jumps", doubting_all)
    steps = tracked(simulation, frames, cycle)
    assert seen == [[7, 6, 5, 4, 3, 2, 1, 0]], "all windows on the way back, together"
    assert all("left_arm" in step.estimates[0].ambiguous for step in steps[IN_VIEW:8])


def test_an_interrupted_run_goes_on_to_the_same_poses(
    simulation: Simulation, frames: tuple[Frame, ...], cycle: Cycle, whole: list[Step]
) -> None:
    for n_kept in (2, 8, 13):
        again = tracked(simulation, frames, cycle, kept(whole[:n_kept]))
        for one, other in zip(whole, again, strict=True):
            assert one.frame.index == other.frame.index
            assert one.estimates[0].status is other.estimates[0].status, n_kept
            np.testing.assert_array_equal(one.estimates[0].q, other.estimates[0].q, err_msg=f"{n_kept} kept")


def test_who_is_lost_for_a_moment_before_is_followed_on_and_called_found_when_he_is_back(
    simulation: Simulation, cycle: Cycle
) -> None:
    """Also in the first frame of the window in which he is looked for; time goes on, the way back does not."""
    away = {0, 1, 2, 3, 6, 8}
    cycle = replace(cycle, estimation=Staying())

    def shown(t: int, v: int, image: Image | None) -> Image | None:
        return simulation.plates[v].picture.copy() if t in away else image

    steps = tracked(simulation, tuple(itertools.islice(with_images(simulation, shown), 10)), cycle)
    told = [step.estimates[0].status for step in steps]
    assert [n for n, status in enumerate(told) if status is Status.LOST] == sorted(away)
    assert [n for n, status in enumerate(told) if status is Status.RECOVERED] == [7]
    assert [n for n, status in enumerate(told) if status is Status.BOOTSTRAPPED] == [NOBODY_BEFORE]


def test_who_leaves_before_gets_what_there_is_and_it_is_done_again(
    simulation: Simulation, frames: tuple[Frame, ...], cycle: Cycle
) -> None:
    back = itertools.count()

    def leaving() -> bool:
        return any(line.startswith("back to the first frame") for line in told) and next(back) >= 1

    told: list[str] = []
    steps = tracked(simulation, frames, replace(cycle, leaving=leaving, progress=lambda line, *_: told.append(line)))
    assert [step.frame.index for step in steps] == list(range(12))
    assert all(step.provisional for step in steps)
    assert [step.estimates[0].status for step in steps[6:8]] == [Status.TRACKED] * 2
    assert all(step.estimates[0].lost for step in steps[:6])


def test_frames_come_backwards_in_pieces_that_fit_into_memory(
    frames: tuple[Frame, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = itertools.count()

    def reopen() -> Iterator[Frame]:
        next(opened)
        return iter(frames)

    n_bytes = sum(image.nbytes for image in frames[7].images if image is not None)
    for at_once, n_times in ((1, 6), (2, 3), (4, 2), (100, 1)):
        opened = itertools.count()
        monkeypatch.setattr("tracker.tracking.backwards._MOST_BYTES", at_once * n_bytes)
        assert [frame.index for frame in frames_before(frames[7], 1, reopen)] == [6, 5, 4, 3, 2, 1]
        assert next(opened) == n_times
