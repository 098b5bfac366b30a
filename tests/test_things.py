"""What persons carry that nobody told of: found with its place, its size and its segment, or not at all."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from recordings import TrueStart, cycle_for, small_simulation
from test_body_fit import QUICK

from tracker.acquisition.body_fit import fit_bodies
from tracker.acquisition.calibrated_views import Seen, Watching
from tracker.acquisition.cells import CELL_M, How, Surroundings, most_moving, shown_in, sight_of, surroundings
from tracker.acquisition.shape_space import ShapePrior, space_of
from tracker.acquisition.things import Thing, _around, carried_of, entry_of, things_of, told_of_things, tracked_with
from tracker.bodies.body.description import BodyDescription, read_description, save_description
from tracker.bodies.scene import Person, Scene
from tracker.bodies.subject import Carried, Subject, with_carried
from tracker.cameras.frame import Frame
from tracker.foundation.configuration.tables import build_class
from tracker.foundation.resources import model_path
from tracker.images.analysis.contours import ContourAnalysis
from tracker.running.jobs._persons import _told
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.trajectory import Step
from tracker.tracking.windows import there

N_FRAMES = 16
BALL = Carried(name="ball", by="right_wrist", start=(0.0, 0.0, -0.15), end=(0.0, 0.0, -0.35), radii=(0.1, 0.1))
RUCKSACK = Carried(name="rucksack", by="neck", start=(-0.24, 0.0, -0.5), end=(-0.24, 0.0, -0.08), radii=(0.1, 0.15))


@pytest.fixture(scope="module")
def general() -> BodyDescription:
    return read_description(model_path("gavrila22"))


def filmed(folder: Path, description: BodyDescription, *things: Carried) -> Simulation:
    """Somebody with things, of whom the tracker has the model without."""
    path = folder / "laden.toml"
    save_description(with_carried(description, things), path, decimals=None)
    return small_simulation("arm_swing", n_frames=N_FRAMES, model=str(path), fps=15.0, seconds=N_FRAMES / 15)


def followed(simulation: Simulation, description: BodyDescription) -> list[Step]:
    """The frames, tracked with the model that knows of no thing."""
    return there(
        list(simulation.frames()), untold(simulation, description), cycle_for(simulation, TrueStart(simulation))
    )[0]


def untold(simulation: Simulation, description: BodyDescription) -> Scene:
    body = description.build()
    return Scene((Person("person1", body, body.rest()),), simulation.scene.rig)


def found_in(simulation: Simulation, description: BodyDescription) -> tuple[Thing, ...]:
    return things_of(seen_in(followed(simulation, description)), 0, description, watching(simulation))


def seen_in(steps: Sequence[Step]) -> list[Seen]:
    return [Seen(step.frame, step.scene.with_pose(0, step.estimates[0].q)) for step in steps]


def watching(simulation: Simulation) -> Watching:
    return Watching(simulation.scene.rig, CpuSynthesis(), ContourAnalysis(), simulation.plates)


def middle(body: BodyDescription, one: Carried) -> np.ndarray:
    """(3,) in the reference pose, metres."""
    return np.array(body.landmarks[one.by].at) + (np.array(one.start) + one.end) / 2


def sizes(one: Carried) -> list[float]:
    """Three, the largest first, metres."""
    return sorted([float(np.linalg.norm(np.subtract(one.end, one.start))), *(2 * r for r in one.radii)], reverse=True)


@pytest.fixture(scope="module")
def with_ball(tmp_path_factory: pytest.TempPathFactory, general: BodyDescription) -> Simulation:
    return filmed(tmp_path_factory.mktemp("ball"), general, BALL)


@pytest.fixture(scope="module")
def ball_steps(with_ball: Simulation, general: BodyDescription) -> list[Step]:
    return followed(with_ball, general)


def test_a_ball_is_found_in_the_hand_that_swings(
    with_ball: Simulation, ball_steps: list[Step], general: BodyDescription
) -> None:
    (thing,) = things_of(seen_in(ball_steps), 0, general, watching(with_ball))
    assert not thing.around
    one = thing.carried
    body = general.build()
    ends = {mark.name: mark.parameter for mark in body.landmarks}
    assert ends[one.by] == ends["right_wrist"]
    assert np.linalg.norm(middle(general, one) - middle(general, BALL)) < 2 * CELL_M
    # what is 5 cm beside the silhouette of the hand may be the hand's
    assert all(0.2 - 0.05 - CELL_M < size < 0.2 + 2 * CELL_M for size in sizes(one))


def test_who_carries_two_things_has_both(tmp_path: Path, general: BodyDescription) -> None:
    found = carried_of(found_in(filmed(tmp_path, general, BALL, RUCKSACK), general))
    assert [one.name for one in found][:2] == ["carried_1", "carried_2"]
    for thing in (BALL, RUCKSACK):
        gaps = [np.linalg.norm(middle(general, one) - middle(general, thing)) for one in found]
        assert min(gaps) < 0.1


def test_who_carries_nothing_has_nothing(tmp_path: Path, general: BodyDescription) -> None:
    assert found_in(filmed(tmp_path, general), general) == ()


def beside_chair(simulation: Simulation, low: Sequence[float], high: Sequence[float]) -> Iterator[Frame]:
    """The frames with an upright box behind the persons that no plate shows, from one corner to the other, metres."""
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    for frame in simulation.frames():
        models = CpuSynthesis().silhouettes(
            simulation.scene.with_poses(tuple(poses[frame.index] for poses in simulation.poses))
        )
        images = []
        for camera, image, model in zip(simulation.scene.rig.cameras, frame.images, models, strict=True):
            assert image is not None
            mask = np.zeros(image.shape[:2], dtype=np.uint8)
            cv2.fillConvexPoly(mask, cv2.convexHull(camera.project(corners).astype(np.int32)), 1)
            images.append(np.where(((mask > 0) & ~model)[..., None], np.uint8((70, 105, 140)), image))
        yield replace(frame, images=tuple(images))


def found_beside(simulation: Simulation, general: BodyDescription) -> tuple[Thing, ...]:
    """What is found of somebody behind whom a chair stands."""
    x, y, _ = general.build().landmarks_in_world(simulation.poses[0][0]).mean(axis=0)
    frames = list(beside_chair(simulation, (x - 0.5, y - 0.25, 0.0), (x - 0.25, y + 0.25, 0.9)))
    steps = there(frames, untold(simulation, general), cycle_for(simulation, TrueStart(simulation)))[0]
    return things_of(seen_in(steps), 0, general, watching(simulation))


def test_a_chair_that_no_plate_shows_stands_and_the_ball_is_carried(
    with_ball: Simulation, general: BodyDescription
) -> None:
    found = found_beside(with_ball, general)
    assert [one.how for one in found if one.how is not How.CARRIED] == [How.STANDS]
    (ball,) = carried_of(found)
    assert np.linalg.norm(middle(general, ball) - middle(general, BALL)) < 2 * CELL_M
    told, carried = _told("anna", found, True)
    assert "something stands beside anna, " in told
    assert "cm large, that the plates do not show: film plates with it" in told
    assert "right_wrist" in carried
    size = max(map(float, re.findall(r"\d+", told)))
    assert size == pytest.approx(90, abs=25)


def test_a_chair_behind_who_hardly_moves_is_in_doubt(general: BodyDescription) -> None:
    still = small_simulation("two_elbow_rotation", n_frames=8, model="gavrila22", fps=15.0, seconds=8 / 15)
    found = found_beside(still, general)
    assert {one.how for one in found} == {How.DOUBT}
    assert carried_of(found) == ()
    assert all("nothing moves enough to tell" in told for told in _told("anna", found, True))


def test_what_is_as_near_as_a_glove_is_the_persons_own(tmp_path: Path, general: BodyDescription) -> None:
    """A racket is not: what is carried reaches farther from the body than what a body has that its model has not."""
    glove = Carried(name="glove", by="right_wrist", start=(0.0, 0.0, 0.04), end=(0.0, 0.0, -0.12), radii=(0.11, 0.11))
    found = found_in(filmed(tmp_path, general, glove), general)
    assert {one.how for one in found} == {How.OWN}
    assert carried_of(found) == ()
    told = " ".join(_told("anna", found, True))
    assert "so near to anna that it is taken for a shoe, hair or clothes" in told
    assert "tell of it: carries = [" in told


def test_what_is_told_is_not_found_again(
    with_ball: Simulation, ball_steps: list[Step], general: BodyDescription
) -> None:
    told = with_carried(general, [BALL])
    assert things_of(seen_in(ball_steps), 0, told, watching(with_ball)) == ()


def test_a_skirt_is_found_and_is_no_part_of_the_body(tmp_path: Path, general: BodyDescription) -> None:
    """Legs are in it: tracked as carried it would make their contours what it hides."""
    skirt = Carried(
        name="skirt", by="pelvis", start=(0, 0, 0.05), end=(0, 0, -0.6), radii=(0.28, 0.32), squareness=(0.3, 1.0)
    )
    assert skirt.by in general.landmarks
    found = found_in(filmed(tmp_path, general, skirt), general)
    assert any("thigh" in one.around for one in found)
    assert "(a skirt, wide clothes?)" in told_of_things("anna", found)
    assert not any(np.linalg.norm(middle(general, one) - middle(general, skirt)) < 0.2 for one in carried_of(found))


@pytest.mark.parametrize(("part", "around"), [("right_thigh", "right_thigh"), ("right_forearm", ""), ("head", "head")])
def test_a_forearm_may_have_been_drawn_into_a_thing_and_a_thigh_is_in_it(
    part: str, around: str, general: BodyDescription
) -> None:
    """A fighter's forearm was in his rucksack, 0.2 m from where it should be: that is what things are found for."""
    inside, neck = next(one for one in general.parts if one.name == part), np.array(general.landmarks["neck"].at)
    start, end = np.array(inside.start) - neck, np.array(inside.end) - neck
    thing = Carried(name="thing", by="neck", start=tuple(start), end=tuple(end), radii=(0.06, 0.06))
    body = with_carried(general, [thing]).build()
    assert _around(body, body.rest()[None]) == around
    # carried before something else, and looked at again when both were tracked
    above = Carried(name="above", by="neck", start=(0, 0, 0.5), end=(0, 0, 0.6), radii=(0.1, 0.1))
    both = with_carried(general, [thing, above]).build()
    again = tracked_with([Thing(above), Thing(thing), Thing(RUCKSACK, "head")], both, both.rest()[None])
    assert [one.hides for one in again] == ["", around, ""]
    assert tracked_with([Thing(thing)], both, np.zeros((0, both.dof))) == (Thing(thing),), "lost throughout"


def test_a_thing_gets_a_name_that_the_body_has_not(
    with_ball: Simulation, ball_steps: list[Step], general: BodyDescription
) -> None:
    """A model from a result may have a thing of an earlier run."""
    first = Carried(name="carried_1", by="neck", start=(0, 0, -0.1), end=(0, 0, 0), radii=(0.02, 0.02))
    found = things_of(seen_in(ball_steps), 0, with_carried(general, [first]), watching(with_ball))
    assert [one.carried.name for one in found] == ["carried_2"]


def test_who_is_elsewhere_is_no_thing(with_ball: Simulation, ball_steps: list[Step], general: BodyDescription) -> None:
    """All of the person stands out beside a model that was put somewhere else: no view tells of things then."""
    moved = shift(general)
    away = [Seen(one.frame, one.scene.with_pose(0, one.scene.persons[0].q + moved)) for one in seen_in(ball_steps)]
    assert things_of(away, 0, general, watching(with_ball)) == ()


def shift(body: BodyDescription) -> np.ndarray:
    """A pose's change by a metre to the side."""
    change = np.zeros(body.build().dof)
    change[body.build().index("torso_x")] = 1.0
    return change


def test_what_is_tracked_and_what_is_not_is_said_apart() -> None:
    things = Thing(BALL), Thing(RUCKSACK, "right_thigh")
    tracked, other = _told("anna", things, True)
    assert "with the segment of right_wrist; tracked as carried" in tracked
    assert "around right_thigh" in other
    assert "look at the overlay" in other
    (hiding,) = _told("anna", [replace(things[0], hides="left_thigh")], True)
    assert "around left_thigh (a skirt, wide clothes?); tracked as carried, and what it hides nobody sees" in hiding
    (both,) = _told("anna", things, False)
    assert "right_wrist" in both
    assert "tracked as carried" not in both


def test_without_frames_nothing_is_found(with_ball: Simulation, general: BodyDescription) -> None:
    assert things_of([], 0, general, watching(with_ball)) == ()


def around(simulation: Simulation, steps: Sequence[Step]) -> list[Surroundings]:
    told = watching(simulation)
    return [surroundings(sight_of(one, told), one.scene, 0, told.synthesis) for one in seen_in(steps)]


def test_cells_of_a_ball_are_in_the_ball(
    with_ball: Simulation, ball_steps: list[Step], general: BodyDescription
) -> None:
    """All of its own are found, and none is further from it than a cell and what poses are off."""
    body = general.build()
    moving = most_moving(around(with_ball, ball_steps), body)
    assert moving is not None
    assert body.names[moving.end].startswith("right_")
    far = np.linalg.norm(moving.points - middle(general, BALL), axis=1)
    assert far.max() < 0.1 + 2 * CELL_M
    volume = 4 / 3 * np.pi * 0.1**3
    assert 0.5 * volume < len(moving.points) * CELL_M**3 < 3 * volume


def test_what_is_beside_the_persons_is_what_every_cell_tried_shows(
    with_ball: Simulation, ball_steps: list[Step], general: BodyDescription
) -> None:
    """A brute-force twin: all cells around the ball, instead of those behind what views show."""
    (one,) = around(with_ball, ball_steps[:1])
    numbers = np.round(one.beside / CELL_M).astype(int)
    low, high = numbers.min(axis=0) - 5, numbers.max(axis=0) + 6
    lattice = np.stack(np.meshgrid(*map(np.arange, low, high), indexing="ij"), axis=-1).reshape(-1, 3)
    empty, n_apart = shown_in(one.views, lattice * CELL_M)
    there_are = {tuple(cell) for cell in lattice[~empty & (n_apart >= 2)]}
    ours = {tuple(cell) for cell in numbers}
    assert ours <= there_are
    assert len(ours) > 0.8 * len(there_are)


def test_bodies_are_fitted_with_what_is_carried(
    with_ball: Simulation, ball_steps: list[Step], general: BodyDescription
) -> None:
    cycle, spaces = cycle_for(with_ball, TrueStart(with_ball)), {0: space_of(general, ShapePrior())}
    scene = untold(with_ball, general)
    settings = replace(QUICK, fit=replace(QUICK.fit, iterations=2))
    found = fit_bodies(spaces, scene, cycle, with_ball.frames, N_FRAMES, settings, untold=[0])
    assert [one.carried.name for one in found.things[0]] == ["carried_1"]
    assert "carried_1" in [part.name for part in found.fits[0].body.parts]

    def left_over(steps: Sequence[Step]) -> float:
        return float(np.mean([step.estimates[0].account.left_over for step in steps]))

    assert left_over(found.steps) < left_over(ball_steps)


def test_the_lines_told_are_those_of_a_configuration() -> None:
    things = (
        Carried(name="carried_1", by="neck", start=(-0.2, 0, 0), end=(-0.2, 0, 0.4), radii=(0.1, 0.2), front=(0, 1, 0)),
        BALL,
    )
    assert told_of_things("anna", [Thing(things[0])]).endswith("40 x 40 x 20 cm large, with the segment of neck")
    table = tomllib.loads(entry_of(things))
    again = build_class(Subject, {"model": str(model_path("gavrila22")), **table}, "persons[0]", Path())
    assert again.carries is not None
    for one, other in zip(again.carries, things, strict=True):
        assert (one.name, one.by, one.start, one.end, one.radii) == (
            other.name,
            other.by,
            other.start,
            other.end,
            other.radii,
        )


@pytest.mark.parametrize(("told", "carries"), [({}, None), ({"carries": []}, ())])
def test_nothing_told_is_not_that_nothing_is_carried(told: dict[str, object], carries: object) -> None:
    assert build_class(Subject, told, "persons[0]", Path()).carries == carries
