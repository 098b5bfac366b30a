"""Evidence of departures: a limb that comes out of the body, passers-by, and what it must not take for background."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from observations import bent, four_views
from painted import painted
from test_skins import meshed

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence import GUESSED
from tracker.evidence.departures import DeparturesEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Image, Mask
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.objective import Objective

EVIDENCE, SYNTHESIS = DeparturesEvidence(), CpuSynthesis()


@pytest.fixture(scope="module")
def scene(body: BodyModel) -> Scene:
    return Scene((Person("one", body, bent(body)),), four_views((720, 576)))


@pytest.fixture(scope="module")
def raised(body: BodyModel, scene: Scene) -> Array:
    """The pose with the left arm raised sideways."""
    q = scene.persons[0].q.copy()
    q[body.index("left_arm_abduction")] += np.radians(60)
    return body.clamped(q)


def images_of(scene: Scene, noise: float = 6.0) -> tuple[Image, ...]:
    """A person in green before a grey wall."""
    colours = np.tile([60.0, 120.0, 70.0], (len(scene.shapes) + 1, 1))
    colours[-1] = 170.0, 165.0, 160.0
    return painted(scene, colours, noise)


def trusted(scene: Scene, *doubted: int) -> Mask:
    found = np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
    found[:, list(doubted)] = False
    return found


def learned(scene: Scene, images: tuple[Image | None, ...], memory: object = None, *doubted: int) -> object:
    sight = Sight(Frame(0, 0.0, images))
    return EVIDENCE.learned(memory, sight, scene, SYNTHESIS.contours(scene), trusted(scene, *doubted))


def asked(scene: Scene, images: tuple[Image | None, ...], memory: object) -> Comparison:
    sight = Sight(Frame(1, 0.04, images))
    return Comparison(scene, 0, SYNTHESIS, EVIDENCE.observe(sight, SYNTHESIS.contours(scene), memory))


@pytest.mark.parametrize("memory", [None, GUESSED])
def test_it_is_silent_before_it_has_seen_a_background(scene: Scene, raised: Array, memory: object) -> None:
    sight = Sight(Frame(1, 0.04, images_of(scene.with_pose(0, raised))))
    expected = None if memory is None else SYNTHESIS.contours(scene)
    question = Comparison(scene, 0, SYNTHESIS, EVIDENCE.observe(sight, expected, memory))
    poses = np.stack([scene.persons[0].q, raised])
    np.testing.assert_array_equal(EVIDENCE.distances(question, poses), 0)
    assert not EVIDENCE.account(question, raised).missed_px.any()


def dressed(scene: Scene) -> Scene:
    """The same person with her own surface."""
    person = scene.persons[0]
    return Scene((replace(person, body=meshed(person.body)),), scene.rig)


def judged(question: Comparison, poses: Array) -> Array:
    """Distances by the surface."""
    return EVIDENCE.distances(Objective(question, EVIDENCE).by_surface().asked, poses)


def test_a_start_is_held_by_what_it_covers(scene: Scene, raised: Array) -> None:
    """In the first frame already; a pose that leaves a limb bare there is worse, but nothing has departed."""
    scene = dressed(scene)
    question = asked(scene, images_of(scene), None)
    right, left_bare = judged(question, np.stack([scene.persons[0].q, raised]))
    assert left_bare > right + 1
    assert not EVIDENCE.account(question, raised).missed_px.any()


def test_what_looks_as_it_did_is_still_there(scene: Scene, raised: Array) -> None:
    """An arm seen where no background was ever seen must stay covered, also once a pose has left it bare."""
    scene = dressed(scene)
    images = images_of(scene)
    memory = learned(scene, images)
    for _ in range(3):
        right, left_bare = judged(asked(scene, images, memory), np.stack([scene.persons[0].q, raised]))
        assert left_bare > right + 1
        memory = learned(scene.with_pose(0, raised), images, memory)


def test_an_arm_that_has_gone_need_not_be_covered_where_it_was(scene: Scene, raised: Array) -> None:
    scene = dressed(scene)
    question = asked(scene, images_of(scene.with_pose(0, raised)), learned(scene, images_of(scene)))
    right, still = judged(question, np.stack([raised, scene.persons[0].q]))
    assert still > right + 1


def test_nothing_departs_from_a_person_at_rest(scene: Scene) -> None:
    memory = learned(scene, images_of(scene))
    question = asked(scene, images_of(scene), memory)
    assert EVIDENCE.distances(question, scene.persons[0].q[None])[0] < 0.05


def test_a_limb_that_has_come_out_must_be_covered(body: BodyModel, scene: Scene, raised: Array) -> None:
    """And is missed in the account of the limbs that reach it."""
    memory = learned(scene, images_of(scene))
    question = asked(scene, images_of(scene.with_pose(0, raised)), memory)
    still, right = EVIDENCE.distances(question, np.stack([scene.persons[0].q, raised]))
    # what contours and colours say of a limb is 0.2 to 1 px
    assert still > right + 1
    arm = body.parts_of("left_arm")
    missed, none = (EVIDENCE.account(question, q).missed_px for q in (scene.persons[0].q, raised))
    assert missed[arm].sum() > 50
    assert none.sum() < 0.2 * missed.sum()


def test_a_limb_is_missed_of_a_person_whose_whole_background_is_known(scene: Scene, raised: Array) -> None:
    """Somebody who was elsewhere before stands before a wall that was seen: all of him is change, nobody else's."""
    person = scene.persons[0]
    aside = person.q.copy()
    aside[person.body.index("torso_x")] += 1.0
    away = scene.with_pose(0, aside)
    memory = learned(scene, images_of(scene), learned(away, images_of(away)))
    question = asked(scene, images_of(scene.with_pose(0, raised)), memory)
    still, right = EVIDENCE.distances(question, np.stack([person.q, raised]))
    assert still > right + 1


def test_its_number_is_that_of_its_account(scene: Scene, raised: Array) -> None:
    question = asked(scene, images_of(scene.with_pose(0, raised)), learned(scene, images_of(scene)))
    q = scene.persons[0].q
    assert EVIDENCE.account(question, q).distance_px == EVIDENCE.distances(question, q[None])[0]
    assert EVIDENCE.equations(question, q, 10.0).total == 0


def test_another_colour_is_somebody_else(scene: Scene, raised: Array) -> None:
    memory = learned(scene, images_of(scene))
    colours = np.tile([60.0, 120.0, 70.0], (len(scene.shapes) + 1, 1))
    colours[-1], colours[scene.persons[0].body.parts_of("left_arm").nonzero()[0]] = (170.0, 165.0, 160.0), (40, 40, 220)
    question = asked(scene, painted(scene.with_pose(0, raised), colours, 6.0), memory)
    assert EVIDENCE.distances(question, scene.persons[0].q[None])[0] < 0.3


def test_a_hand_as_brown_as_wood_beside_her_is_a_hand_where_no_wood_was(scene: Scene, raised: Array) -> None:
    """The colours of what is beside a person are not those of what is known to be behind a limb."""
    wood = 40.0, 75.0, 125.0

    def images(of: Scene) -> tuple[Image, ...]:
        colours = np.tile([60.0, 120.0, 70.0], (len(of.shapes) + 1, 1))
        colours[-1], colours[of.persons[0].body.parts_of("left_arm").nonzero()[0]] = (170.0, 165.0, 160.0), wood
        found = painted(of, colours, 6.0)
        for image, ids in zip(found, SYNTHESIS.part_ids(of), strict=True):
            floor = ids < 0
            floor[: len(image) // 2] = False
            image[floor] = wood
        return found

    memory = learned(scene, images(scene))
    question = asked(scene, images(scene.with_pose(0, raised)), memory)
    still, right = EVIDENCE.distances(question, np.stack([scene.persons[0].q, raised]))
    assert still > right + 1


def test_shade_is_no_limb_though_the_person_is_as_dark(scene: Scene, raised: Array) -> None:
    """The wall at a third of its light is as grey as the trousers; where the raised arm would be nobody is."""
    colours = np.tile([60.0, 120.0, 70.0], (len(scene.shapes) + 1, 1))
    colours[-1] = 170.0, 165.0, 160.0
    legs = scene.persons[0].body.parts_of("left_leg") | scene.persons[0].body.parts_of("right_leg")
    colours[legs.nonzero()[0]] = colours[-1] / 3
    images = painted(scene, colours, 6.0)
    # a floor as dark, so that its colour tells nothing
    for image, ids in zip(images, SYNTHESIS.part_ids(scene), strict=True):
        floor = ids < 0
        floor[: len(image) // 2] = False
        image[floor] = (colours[-1] / 3).astype(np.uint8)
    memory = learned(scene, images)
    shaded = tuple(image.copy() for image in images)
    pairs = zip(shaded, SYNTHESIS.part_ids(scene), SYNTHESIS.part_ids(scene.with_pose(0, raised)), strict=True)
    for image, before, behind in pairs:
        shade = (before < 0) & (behind >= 0)
        image[shade] = (image[shade] / 3).astype(np.uint8)
    assert EVIDENCE.distances(asked(scene, shaded, memory), scene.persons[0].q[None])[0] < 0.3


def test_who_passes_apart_from_the_person_is_not_taken_for_a_limb(scene: Scene) -> None:
    memory, images = learned(scene, images_of(scene)), images_of(scene)
    green = np.array([60, 120, 70], dtype=np.uint8)
    passing = tuple(image.copy() for image in images)
    contours = SYNTHESIS.contours(scene)
    for v, image in enumerate(passing):
        right = int(contours.of(v).pixels[:, 0].max())
        image[200:260, min(right + 45, 700) : min(right + 65, 719)] = green
    question = asked(scene, passing, memory)
    assert EVIDENCE.distances(question, scene.persons[0].q[None])[0] < 0.05


def test_who_comes_along_is_no_limb_when_he_touches_the_person(scene: Scene) -> None:
    """In similar colours; a limb of as many pixels that comes out where nobody was before is one."""
    images, contours = images_of(scene), SYNTHESIS.contours(scene)

    def beside(gap_px: int) -> tuple[Image, ...]:
        passing = tuple(image.copy() for image in images)
        for v, image in enumerate(passing):
            right = int(contours.of(v).pixels[:, 0].max())
            image[200:272, min(right + gap_px, 690) : min(right + gap_px + 20, 719)] = (60, 120, 70)
        return passing

    memory = learned(scene, images)
    for gap_px in (45, 30, 15):
        memory = learned(scene, beside(gap_px), memory)
    q = scene.persons[0].q
    assert EVIDENCE.distances(asked(scene, beside(2), memory), q[None])[0] < 0.1
    assert EVIDENCE.distances(asked(scene, beside(2), learned(scene, images)), q[None])[0] > 1


def test_a_missed_limb_does_not_become_background(scene: Scene, raised: Array) -> None:
    """However long the tracked pose leaves it bare."""
    images = images_of(scene.with_pose(0, raised))
    memory = learned(scene, images_of(scene))
    for _ in range(10):
        memory = learned(scene, images, memory)
    still, right = EVIDENCE.distances(asked(scene, images, memory), np.stack([scene.persons[0].q, raised]))
    assert still > right + 1


def test_light_that_changes_slowly_is_followed(scene: Scene) -> None:
    images = images_of(scene)
    memory = learned(scene, images)
    for k in range(1, 20):
        lit = tuple((image * (1 - 0.02 * k)).astype(np.uint8) for image in images)
        assert EVIDENCE.distances(asked(scene, lit, memory), scene.persons[0].q[None])[0] < 0.05
        memory = learned(scene, lit, memory)


def test_who_is_doubted_teaches_nothing(scene: Scene) -> None:
    images = images_of(scene)
    memory = learned(scene, images)
    after = learned(scene, tuple(255 - image for image in images), memory, *range(len(scene.shapes)))
    assert all(one is other for one, other in zip(memory, after, strict=True))


def test_a_missing_view_says_nothing(scene: Scene, raised: Array) -> None:
    memory = learned(scene, images_of(scene))
    images = images_of(scene.with_pose(0, raised))
    question = asked(scene, (None, *images[1:]), memory)
    account = EVIDENCE.account(question, scene.persons[0].q)
    assert account.per_view_px[0] == 0 or np.isnan(account.per_view_px[0])
    assert account.distance_px > 0
    nothing = replace(question, observed=EVIDENCE.observe(Sight(Frame(1, 0.0, (None,) * 4)), None, memory))
    assert EVIDENCE.distances(nothing, raised[None])[0] == 0


def test_a_view_that_the_person_has_left_says_nothing_and_warns_of_nothing(scene: Scene, raised: Array) -> None:
    aside = scene.persons[0].q.copy()
    aside[:2] += np.array(scene.rig.cameras[0].centre[:2]) * 1.5
    gone = scene.with_pose(0, aside)
    assert not SYNTHESIS.silhouettes(gone)[0].any()
    memory = learned(gone, images_of(gone))
    question = asked(gone, images_of(gone), memory)
    assert EVIDENCE.account(question, aside).per_view_px[0] == 0
    assert learned(gone, images_of(gone), memory) is not None


def test_views_may_have_images_of_other_sizes(scene: Scene) -> None:
    cameras = scene.rig.cameras
    smaller = replace(scene, rig=Rig((*cameras[:3], replace(cameras[3].downscaled(2), downscale=1))))
    memory = learned(smaller, images_of(smaller))
    question = asked(smaller, (None, *images_of(smaller)[1:]), memory)
    assert EVIDENCE.distances(question, smaller.persons[0].q[None])[0] == 0.0
