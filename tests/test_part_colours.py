"""Parts have few colours where a body is, and more where it is not: told by one frame alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import small_simulation
from rounding import assert_alike

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.measures.part_colours import PartColours, part_colours
from tracker.foundation.arrays import Array
from tracker.images.sight import Sight
from tracker.synthesis.simulation.sequence import Simulation


@pytest.fixture(scope="module")
def filmed() -> Simulation:
    return small_simulation(n_frames=1, size=(720, 576))


@pytest.fixture(scope="module")
def frame(filmed: Simulation) -> Frame:
    return next(iter(filmed.frames()))


def impurity(colours: PartColours, scene: Scene) -> float:
    return float(colours.impurities(scene, 0, scene.persons[0].q[None])[0])


def seen(filmed: Simulation, frame: Frame, plates: bool = True) -> Sight:
    sight = Sight(frame, filmed.plates if plates else ())
    for v, camera in enumerate(filmed.scene.rig.cameras):
        sight.changes(v, (0, 0, *camera.size))
    return sight


def with_values(scene: Scene, **degrees: float) -> Scene:
    person = scene.persons[0]
    q: Array = person.q.copy()
    for name, value in degrees.items():
        q[person.body.index(name)] = np.radians(value)
    return scene.with_pose(0, person.body.clamped(q))


@pytest.mark.parametrize("plates", [True, False])
@pytest.mark.parametrize(
    "elsewhere",
    [
        {"right_arm_elevation": 60.0},
        {"left_arm_extension": 110.0, "left_arm_twist": 60.0},
        {"right_leg_elevation": 45.0},
        {"left_arm_abduction": 90.0},
    ],
)
def test_the_true_place_of_a_limb_is_the_purest(filmed, frame, plates: bool, elsewhere: dict[str, float]) -> None:
    colours = part_colours(seen(filmed, frame, plates), filmed.scene)
    true = impurity(colours, filmed.scene)
    assert impurity(colours, with_values(filmed.scene, **elsewhere)) > true + 0.005


def test_what_has_one_colour_everywhere_is_pure(filmed, frame) -> None:
    grey = replace(frame, images=tuple(np.full_like(image, 90) for image in frame.images))
    colours = part_colours(seen(filmed, grey, plates=False), filmed.scene)
    assert impurity(colours, filmed.scene) == pytest.approx(0, abs=1e-9)


def test_the_entropy_is_that_of_pixels_counted_one_by_one(filmed, frame) -> None:
    colours = part_colours(seen(filmed, frame), filmed.scene)
    scene = filmed.scene
    from tracker.synthesis.cpu import CpuSynthesis

    names = [part.name for part in scene.persons[0].body.parts]
    counts: dict[str, dict[int, int]] = {}
    for ids, numbers, places in zip(
        CpuSynthesis().part_ids(Scene(scene.persons, colours.rig)), colours.numbers, colours.places, strict=True
    ):
        for part, number in zip(ids.ravel()[places].tolist(), numbers.tolist(), strict=True):
            kind = "nothing" if part < 0 else names[part].replace("left_", "").replace("right_", "")
            counts.setdefault(kind, {})
            counts[kind][number] = counts[kind].get(number, 0) + 1
    nats = 0.0
    for table in counts.values():
        total = sum(table.values())
        nats -= sum(n * np.log(n / total) for n in table.values())
    assert impurity(colours, scene) == pytest.approx(nats / colours.n_px[0], rel=1e-9)


def test_views_without_images_do_not_count(filmed, frame) -> None:
    missing = replace(frame, images=(None, *frame.images[1:]))
    colours = part_colours(seen(filmed, missing), filmed.scene)
    whole = part_colours(seen(filmed, frame), filmed.scene)
    assert len(colours.numbers[0]) == len(colours.places[0]) == 0
    for one, other in zip(colours.numbers[1:], whole.numbers[1:], strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.isfinite(impurity(colours, filmed.scene))


def test_who_is_out_of_sight_divides_by_nothing(filmed, frame) -> None:
    away = filmed.scene.with_pose(0, filmed.scene.persons[0].q + np.eye(filmed.scene.persons[0].body.dof)[0] * 500)
    colours: PartColours = part_colours(seen(filmed, frame, plates=False), away)
    assert impurity(colours, away) == 0


@pytest.mark.parametrize("moved", ["left_arm_extension", "torso_twist"])
def test_many_poses_are_told_what_each_alone_is(filmed, frame, moved: str) -> None:
    """What stands still in all of them is drawn once; the background of nobody, and of everybody, as well."""
    colours, person = part_colours(seen(filmed, frame), filmed.scene), filmed.scene.persons[0]
    poses = np.tile(person.q, (5, 1))
    poses[:, person.body.index(moved)] += np.radians([0, 20, 40, 60, 20])
    together = colours.impurities(filmed.scene, 0, poses)
    alone = [impurity(colours, filmed.scene.with_pose(0, q)) for q in poses]
    assert_alike(together, alone)
    assert len(np.unique(together)) == 4
    assert len(colours.impurities(filmed.scene, 0, poses[:0])) == 0
