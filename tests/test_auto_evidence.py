"""The default evidence: foregrounds where the recording has plates or masks, colours of the parts where it has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation

from tracker.cameras.frame import Frame
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.regions import ObservedRegions
from tracker.evidence.silhouettes import Foregrounds
from tracker.evidence.together import TogetherEvidence
from tracker.images.sight import Sight
from tracker.results.recording._journal_line import line_of, replay_of
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.sequence import track

EVIDENCE = AutoEvidence()


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation(n_frames=4)


@pytest.fixture(scope="module")
def frame(simulation: Simulation) -> Frame:
    return next(iter(simulation.frames()))


def second_kind(simulation: Simulation, sight: Sight) -> object:
    """What the kind of evidence beside the contours has observed."""
    contours = cycle_for(simulation).synthesis.contours(simulation.scene)
    return EVIDENCE.observe(sight, contours).observed[1]


def test_plates_of_two_views_make_it_look_at_the_foreground(simulation: Simulation, frame: Frame) -> None:
    plates = simulation.plates
    none: tuple[None, ...] = (None,) * len(plates)
    for known, kind in (
        (plates, Foregrounds),
        (plates[:2] + none[2:], Foregrounds),
        (plates[:1] + none[1:], ObservedRegions),
    ):
        assert isinstance(second_kind(simulation, Sight(frame, known)), kind)
    assert isinstance(second_kind(simulation, Sight(frame)), ObservedRegions)


def test_masks_are_as_good_as_plates_even_where_one_is_missing(simulation: Simulation, frame: Frame) -> None:
    masks = tuple(np.ones(image.shape[:2], dtype=np.bool_) for image in frame.images if image is not None)
    for given in (masks, (None,) * len(masks)):
        assert isinstance(second_kind(simulation, Sight(replace(frame, masks=given))), Foregrounds)


def test_who_stays_before_plates_is_told_by_colours_and_by_the_foreground(simulation: Simulation, frame: Frame) -> None:
    plates = tuple(None if plate is None else replace(plate, recorded=True, stays=True) for plate in simulation.plates)
    contours = cycle_for(simulation).synthesis.contours(simulation.scene)
    seen = EVIDENCE.observe(Sight(frame, plates), contours)
    assert seen.by is EVIDENCE.partly
    assert [isinstance(one, Foregrounds | ObservedRegions) for one in seen.observed[1:3]] == [True, True]
    masks = tuple(np.ones(image.shape[:2], dtype=np.bool_) for image in frame.images if image is not None)
    assert EVIDENCE.observe(Sight(replace(frame, masks=masks), plates), contours).by is EVIDENCE.with_plates
    assert EVIDENCE.told(plates) == (
        "contours, foreground where nobody stays, colours and motion of the parts, 4 of 4 views have plates or masks, "
        "which the recording itself has made"
    )


def test_its_numbers_are_those_of_the_one_chosen(simulation: Simulation, frame: Frame) -> None:
    scene, cycle = simulation.scene, cycle_for(simulation)
    contours, q = cycle.synthesis.contours(scene), scene.persons[0].q
    partly = tuple(None if plate is None else replace(plate, stays=True) for plate in simulation.plates)
    for sight, one in (
        (Sight(frame), EVIDENCE.without),
        (Sight(frame, simulation.plates), EVIDENCE.with_plates),
        (Sight(frame, partly), EVIDENCE.partly),
    ):
        known = one.learned(None, sight, scene, contours, np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_))
        mine = Comparison(scene, 0, cycle.synthesis, EVIDENCE.observe(sight, contours, known))
        plain = Comparison(scene, 0, cycle.synthesis, one.observe(sight, contours, known))
        poses = q + np.array([[0.0], [0.02]])
        np.testing.assert_array_equal(EVIDENCE.distances(mine, poses), one.distances(plain, poses))
        np.testing.assert_array_equal(EVIDENCE.equations(mine, q, 20).vector, one.equations(plain, q, 20).vector)
        assert EVIDENCE.account(mine, q).left_over == one.account(plain, q).left_over


def test_it_says_what_it_goes_by() -> None:
    assert EVIDENCE.told((None, None)) == "contours, colours and motion of the parts, no background plates"
    assert (
        EVIDENCE.told((object(), object(), None))
        == "contours, foreground, colours and motion of the parts, 2 of 3 views have plates or masks"
    )
    assert EVIDENCE.told((object(), None)).startswith("contours, colours and motion of the parts, 1 of 2")
    assert TogetherEvidence().told((None,)) == ""


def test_plates_that_know_a_part_are_for_the_evidence_that_is_made_for_them() -> None:
    assert EVIDENCE.takes_part_plates()
    assert not TogetherEvidence().takes_part_plates()
    assert TogetherEvidence(
        of=(EVIDENCE, ContourEvidence()), ranking=(1.0, 1.0), refining=(1.0, 1.0)
    ).takes_part_plates()


def test_without_plates_colours_track(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TrueStart(simulation), evidence=EVIDENCE, plates=(None,) * len(simulation.plates))
    steps = list(track(simulation.frames(), simulation.scene, cycle))
    assert len(steps) == 4
    for step in steps:
        assert joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean() < 15


def test_colours_are_learnt_again_where_a_run_is_resumed(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TrueStart(simulation), evidence=EVIDENCE, plates=(None,) * len(simulation.plates))
    whole = list(track(simulation.frames(), simulation.scene, cycle))
    done = {step.frame.index: replay_of(line_of(step).encode()) for step in whole[:2]}
    resumed = list(track(simulation.frames(), simulation.scene, cycle, done))
    for step, again in zip(whole, resumed, strict=True):
        np.testing.assert_array_equal(step.estimates[0].q, again.estimates[0].q)
        np.testing.assert_array_equal(step.estimates[0].account.explained_px, again.estimates[0].account.explained_px)
