"""Somebody who is none of the persons: found in space, hidden, and neither tracked nor taken for a limb."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation
from scipy import ndimage

from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.evidence.auto import AutoEvidence
from tracker.foundation.arrays import Mask
from tracker.foundation.resources import model_path
from tracker.images.sight import Sight
from tracker.results.recording._journal_line import as_kept, line_of, replay_of
from tracker.running.jobs._messages import told_of_start
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.cycle import Cycle
from tracker.tracking.doubts import Doubts
from tracker.tracking.initialization._persons import find_persons, in_order, ways_to_find
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.loss import LossRule
from tracker.tracking.sequence import track
from tracker.tracking.start import Hypothesis, Start
from tracker.tracking.strangers import _has_piece_of, hide_strangers, strangers
from tracker.tracking.trajectory import Step

SYNTHESIS = CpuSynthesis()


@pytest.fixture(scope="module")
def both() -> Simulation:
    """A man, and beside him somebody of seven eighths of his height."""
    simulation = small_simulation("arm_swing", n_frames=6, persons=2, size=(720, 576))
    (first, second), (there, beside) = simulation.scene.persons, (poses.copy() for poses in simulation.poses)
    root = second.body.root.shifts
    beside[:, root[0]] -= 0.75
    beside[:, root[1]] += 0.35
    beside[:, root[2]] *= 7 / 8
    persons = first, Person("smaller", load_body(model_path("gavrila22"), 7 / 8), beside[0])
    return replace(simulation, scene=Scene(persons, simulation.scene.rig), poses=(there, beside))


@pytest.fixture(scope="module")
def frame(both: Simulation) -> Frame:
    return next(iter(both.frames()))


def alone(simulation: Simulation, k: int = 0) -> Scene:
    """The scene as a configuration has it that knows of one person alone."""
    return Scene((simulation.scene.persons[k],), simulation.scene.rig)


def silhouettes(scene: Scene, k: int) -> tuple[Mask, ...]:
    return SYNTHESIS.silhouettes(Scene((scene.persons[k],), scene.rig))


def silhouettes_of_all(scene: Scene) -> tuple[Mask, ...]:
    return SYNTHESIS.silhouettes(scene)


def of_one(simulation: Simulation) -> Simulation:
    return replace(simulation, scene=alone(simulation), poses=simulation.poses[:1])


def moved(person: Person, way: tuple[float, float, float]) -> Person:
    q = person.q.copy()
    q[list(person.body.root.shifts)] += way
    return replace(person, q=q)


@pytest.mark.parametrize("k", [0, 1])
def test_the_other_one_is_found_where_the_images_show_him(both: Simulation, frame: Frame, k: int) -> None:
    found = strangers(Sight(frame, both.plates), alone(both, k), SYNTHESIS)
    mine, other = silhouettes(both.scene, k), silhouettes(both.scene, 1 - k)
    assert sorted(found) == list(range(len(both.scene.rig)))
    beside = [other[v] & ~mine[v] for v in found]
    hidden = [(found[v] & beside[v]).sum() / beside[v].sum() for v in found]
    wrongly = [(found[v] & mine[v] & ~other[v]).sum() / mine[v].sum() for v in found]
    assert min(hidden) > 0.6, hidden
    assert np.mean(hidden) > 0.8, hidden
    assert max(wrongly) < 0.2, wrongly
    assert np.mean(wrongly) < 0.06, wrongly


def test_before_the_person_he_hides_behind_her_he_does_not(both: Simulation, frame: Frame) -> None:
    told = []
    for k in (0, 1):
        found = strangers(Sight(frame, both.plates), alone(both, k), SYNTHESIS)
        mine, other = silhouettes(both.scene, k), silhouettes(both.scene, 1 - k)
        for v, camera in enumerate(both.scene.rig.cameras):
            shared = mine[v] & other[v]
            middles = [person.body.landmarks_in_world(person.q).mean(axis=0) for person in both.scene.persons]
            depths = camera.in_camera(np.array(middles))[:, 2]
            if shared.sum() > 400:
                told.append((bool(depths[1 - k] < depths[k]), float((found[v] & shared).sum() / shared.sum())))
    assert {before for before, _ in told} == {True, False}
    assert all(share > 0.6 if before else share < 0.2 for before, share in told), told


def test_persons_whom_the_scene_has_are_no_strangers(both: Simulation, frame: Frame) -> None:
    assert strangers(Sight(frame, both.plates), both.scene, SYNTHESIS) == {}


def test_a_limb_in_a_wrong_place_is_no_stranger(both: Simulation) -> None:
    simulation = of_one(both)
    frame, (person,) = next(iter(simulation.frames())), simulation.scene.persons
    rng, body = np.random.default_rng(1), person.body
    for group in body.fine_groups:
        for _ in range(4):
            q = person.q.copy()
            q[body.group(group)] += rng.uniform(-1.5, 1.5, len(q[body.group(group)]))
            scene = simulation.scene.with_pose(0, body.clamped(q))
            assert strangers(Sight(frame, simulation.plates), scene, SYNTHESIS) == {}, group


def test_who_is_elsewhere_is_no_stranger_to_himself(both: Simulation) -> None:
    simulation = of_one(both)
    frame, (person,) = next(iter(simulation.frames())), simulation.scene.persons
    scene = Scene((moved(person, (0.0, 0.9, 0.0)),), simulation.scene.rig)
    assert strangers(Sight(frame, simulation.plates), scene, SYNTHESIS) == {}


def test_nothing_is_told_without_two_plates_or_with_masks(both: Simulation, frame: Frame) -> None:
    one = (both.plates[0], *[None] * (len(both.plates) - 1))
    assert strangers(Sight(frame, one), alone(both), SYNTHESIS) == {}
    assert strangers(Sight(frame), alone(both), SYNTHESIS) == {}
    masked = replace(frame, masks=silhouettes(both.scene, 0))
    assert strangers(Sight(masked, both.plates), alone(both), SYNTHESIS) == {}


def test_what_is_hidden_is_nobodys(both: Simulation, frame: Frame) -> None:
    sight, whole = Sight(frame, both.plates), (0, 0, *both.scene.rig.cameras[0].size)
    before = sight.changes(0, whole)
    hide_strangers(sight, alone(both), SYNTHESIS)
    after, other = sight.changes(0, whole), silhouettes(both.scene, 1)[0] & ~silhouettes(both.scene, 0)[0]
    assert sight.strangers
    assert before is not None
    assert after is not None
    assert (before.silhouette & other).sum() > 0.8 * other.sum()
    assert (after.silhouette & other).sum() < 0.25 * other.sum()
    occluder, unknown = sight.occluder(0), sight.unknown(0)
    assert occluder is not None
    assert unknown is not None
    assert (unknown & other).sum() > 0.75 * other.sum()
    plate = both.plates[0]
    assert plate is not None
    assert plate.occluder is None, "that of other frames"


@pytest.fixture(scope="module")
def cycle(both: Simulation) -> Cycle:
    return cycle_for(both, TrueStart(of_one(both)), evidence=AutoEvidence(), loss=LossRule(rehearse=0))


@pytest.fixture(scope="module")
def steps(both: Simulation, cycle: Cycle) -> list[Step]:
    """The first one tracked, the other one beside him."""
    return list(track(both.frames(), alone(both), cycle))


def test_one_of_two_is_tracked_and_the_other_is_told(both: Simulation, steps: list[Step]) -> None:
    doubts = Doubts()
    for step in steps:
        (estimate,) = step.estimates
        assert not estimate.lost
        assert joint_errors_mm(both, 0, step.frame.index, estimate.q).mean() < 15
        assert step.strangers
        assert not step.untrusted, "before, foregrounds of two persons were too large for one"
        assert replay_of(line_of(step).encode()).strangers
        doubts = doubts.after(step)
    assert doubts.sentence().endswith("; another person beside in 6 (frames 0-5)")


def test_an_interrupted_run_goes_on_as_if_it_had_not_been(both: Simulation, cycle: Cycle, steps: list[Step]) -> None:
    whole = [as_kept(step) for step in steps]
    done = {step.frame.index: replay_of(line_of(step).encode()) for step in whole[:3]}
    for one, other in zip(whole, track(both.frames(), alone(both), cycle, done), strict=True):
        np.testing.assert_array_equal(one.estimates[0].q, other.estimates[0].q)
        assert one.strangers == other.strangers


def test_of_two_bodies_a_start_takes_the_one_that_the_model_fits(both: Simulation, frame: Frame) -> None:
    """They are one piece of the hull; taken for one person they were found in a pose of nobody, 0.5 m off."""
    scene = alone(both, 1)
    start = PcaInitialization().start(frame, scene, cycle_for(both).stages)
    assert joint_errors_mm(both, 1, 0, start.poses[0]).mean() < 60


@pytest.mark.parametrize("k", [0, 1])
def test_where_the_person_is_told_to_be_the_nearest_body_is_taken(both: Simulation, frame: Frame, k: int) -> None:
    """Of the other one neither stature nor fit count."""
    taller, there = both.scene.persons[0], both.scene.persons[k]
    x, y = there.body.landmarks_in_world(there.q)[:, :2].mean(axis=0)
    asked = (replace(taller, at=(float(x) + 0.2, float(y))),)
    masks = silhouettes_of_all(both.scene)
    ((found,),) = ways_to_find(masks, both.scene.rig, asked, ())
    assert np.linalg.norm(np.median(found.points[:, :2], axis=0) - (x, y)) < 0.15


def test_places_tell_persons_apart_whatever_their_statures(both: Simulation) -> None:
    first, second = both.scene.persons
    places = [tuple(one.body.landmarks_in_world(one.q)[:, :2].mean(axis=0).tolist()) for one in (second, first)]
    asked = tuple(replace(one, at=place) for one, place in zip((first, second), places, strict=True))
    masks = silhouettes_of_all(both.scene)
    found = in_order(find_persons(masks, both.scene.rig, asked, ()), asked, both.scene.rig, seen_before=False)
    for one, place in zip(found, places, strict=True):
        assert np.linalg.norm(np.median(one.points[:, :2], axis=0) - place) < 0.15


def test_a_start_tells_where_else_a_body_is(both: Simulation) -> None:
    scene, (person, other) = alone(both), both.scene.persons
    elsewhere = moved(person, tuple(other.q[list(other.body.root.shifts)] - person.q[list(person.body.root.shifts)]))
    nearby = moved(person, (0.05, 0.0, 0.0))
    ranking = tuple(Hypothesis(one.q, 3.0, 0.9, 0.2, 0.0) for one in (person, nearby, elsewhere))
    axes = ((None,) * 4,)
    (line,) = told_of_start(Start((person.q,), axes, (ranking,)), scene)
    assert line.startswith("person1 may be one of 2 bodies: the model fits best at (")
    assert 'persons = [{ name = "person1", at = [' in line
    assert told_of_start(Start((person.q,), axes, (ranking[:2],)), scene) == ()
    assert told_of_start(Start((person.q,), (), (ranking,)), scene) == (), "without plates"
    shadow = (*ranking[:2], replace(ranking[2], left_over=0.5))
    assert told_of_start(Start((person.q,), axes, (shadow,)), scene) == (), "nobody is where the model fits much worse"


@pytest.mark.parametrize("density", [0.0, 0.02, 0.1, 0.3, 0.45, 0.6, 0.9])
def test_pieces_are_as_high_as_their_labels_say(density: float) -> None:
    mask: Mask = np.random.default_rng(7).random((48, 60)) < density
    found = ndimage.find_objects(ndimage.label(mask, np.ones((3, 3)))[0])
    highest = max((rows.stop - rows.start for rows, _ in found), default=0)
    for least_px in (1, highest / 2 + 0.5, max(highest, 1), highest + 0.5, highest + 1, 48, 49):
        assert _has_piece_of(mask, least_px) == (least_px <= highest)
