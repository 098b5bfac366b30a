"""Evidence of motion: turns that contours do not show, places that left their parts, and its kernels' plain twins."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from observations import four_views

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence import GUESSED
from tracker.evidence._anchors import Anchors, attached, seen_parts
from tracker.evidence._attachment import met_by_rays
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.motion import MotionEvidence, Remembered, _grey
from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.resources import model_path
from tracker.images.sight import Sight
from tracker.kernels.body import meet_parts
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.rendering import draw_persons, mesh_of

EVIDENCE, SYNTHESIS = MotionEvidence(), CpuSynthesis()
TURN_DEG = 6.0


@pytest.fixture(scope="module")
def human() -> BodyModel:
    return load_body(model_path("human"))


@pytest.fixture(scope="module")
def rig() -> Rig:
    return four_views((1440, 1152))


@pytest.fixture(scope="module")
def scene(human: BodyModel, rig: Rig) -> Scene:
    q = human.rest()
    q[:3] = 0.1, -0.05, 1.0
    for side in ("left", "right"):
        q[human.index(f"{side}_arm_abduction")] = np.radians(35)
    return Scene((Person("one", human, q),), rig)


@pytest.fixture(scope="module")
def turned(scene: Scene, human: BodyModel) -> Scene:
    """The chest turned about its axis; arms go with it, and the head is held."""
    q = scene.persons[0].q.copy()
    q[human.index("spine_twist")] += np.radians(TURN_DEG)
    q[human.index("neck_twist")] -= np.radians(TURN_DEG)
    return scene.with_pose(0, q)


def checked(scene: Scene) -> tuple[Image, ...]:
    """A person in checks of 5 cm before a grey wall."""
    mesh = mesh_of(scene.persons[0])
    checks = np.sign(np.sin(np.pi * mesh.points / 0.05)).prod(axis=1, keepdims=True)
    mesh = replace(mesh, colours=np.repeat(140.0 + 80.0 * checks, 3, axis=1).astype(np.float32))
    wall = np.full((1152, 1440, 3), 160, dtype=np.uint8)
    return tuple(draw_persons(wall, camera, scene, (mesh,))[0] for camera in scene.rig.cameras)


@pytest.fixture(scope="module")
def images(scene: Scene, turned: Scene) -> tuple[tuple[Image, ...], ...]:
    return checked(scene), checked(turned)


def trusted(scene: Scene, *doubted: int) -> Mask:
    found = np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
    found[:, list(doubted)] = False
    return found


def learned(scene: Scene, seen: tuple[Image | None, ...], memory: object = None, *doubted: int) -> Remembered:
    sight = Sight(Frame(0, 0.0, seen))
    return EVIDENCE.learned(memory, sight, scene, SYNTHESIS.contours(scene), trusted(scene, *doubted))


def asked(scene: Scene, seen: tuple[Image | None, ...], memory: object) -> Comparison:
    sight = Sight(Frame(1, 0.04, seen))
    return Comparison(scene, 0, SYNTHESIS, EVIDENCE.observe(sight, SYNTHESIS.contours(scene), memory))


def test_images_are_made_grey_ahead_once(monkeypatch: pytest.MonkeyPatch, scene: Scene) -> None:
    sight = Sight(Frame(0, 0.0, (np.full((8, 9, 3), 100, dtype=np.uint8), None)))
    EVIDENCE.look(sight, SYNTHESIS.contours(scene))
    monkeypatch.delattr(cv2, "cvtColor")
    grey, missing = (_grey(sight, v) for v in range(2))
    assert missing is None
    np.testing.assert_array_equal(grey, np.full((8, 9), 100))


def test_it_turns_a_round_trunk_with_what_is_printed_on_it(scene, turned, images, human):
    question = asked(scene, images[1], learned(scene, images[0]))
    k = human.index("spine_twist")
    q = scene.persons[0].q.copy()
    for _ in range(4):
        found = EVIDENCE.equations(question, q, 20.0)
        q -= np.linalg.solve(found.matrix + np.eye(human.dof), found.vector)
    truth = turned.persons[0].q
    # 0.15 px of following are 0.1 degrees on a radius of 15 cm; the surface stands for the checks to a few millimetres
    assert abs(np.degrees(q[k] - truth[k])) < 0.1 * TURN_DEG
    before, after = (
        np.linalg.norm(_joints(human, pose) - _joints(human, truth), axis=1) for pose in (scene.persons[0].q, q)
    )
    assert after.max() < 0.1 * before.max()


def _joints(body: BodyModel, q: Array) -> Array:
    return body.landmarks_in_world(q)


def test_poses_that_carry_the_places_are_nearer(scene, turned, images):
    question = asked(scene, images[1], learned(scene, images[0]))
    poses = np.array([turned.persons[0].q, scene.persons[0].q])
    right, wrong = EVIDENCE.distances(question, poses)
    assert right < 0.5 < 2 * right + 0.5 < wrong
    assert EVIDENCE.distances(question, poses[1:]) == pytest.approx(wrong)
    assert EVIDENCE.account(question, poses[1]).distance_px == pytest.approx(wrong)


def test_an_account_of_it_explains_nothing(scene, images):
    """Places were put where the pose had its parts: that they are there confirms no pose."""
    account = EVIDENCE.account(asked(scene, images[0], learned(scene, images[0])), scene.persons[0].q)
    assert not account.visible_px.any()
    assert not account.explained_px.any()


@pytest.mark.parametrize("memory", [None, GUESSED])
def test_without_a_frame_before_it_says_nothing(scene, images, memory):
    question = asked(scene, images[0], memory)
    assert EVIDENCE.equations(question, scene.persons[0].q, 20.0).total == 0
    assert EVIDENCE.distances(question, scene.persons[0].q[None]) == 0


def test_its_equations_are_those_of_projected_places(scene, images, human):
    """Against J^T W J of each place by `point_jacobian` and `project_jacobian`."""
    question = asked(scene, images[1], learned(scene, images[0]))
    anchors, shares = question.observed.of(question)
    q = scene.persons[0].q
    placed, rig = scene.world_from_parts()[0][anchors.parts], scene.rig
    world = np.einsum("nij,nj->ni", placed[:, :3, :3], anchors.surface[:, :3]) + placed[:, :3, 3]
    motion = human.point_jacobian(q, world, human.part_parameters[anchors.parts])
    slopes = np.array([rig.cameras[v].project_jacobian(x) for v, x in zip(anchors.views, world, strict=True)])
    shown = np.array([rig.cameras[v].project(x[None])[0] for v, x in zip(anchors.views, world, strict=True)])
    residual, jacobian = shown - anchors.pixels, slopes @ motion
    rays = np.einsum("nij,nj->ni", placed[:, :3, :3], anchors.surface[:, 6:])
    spread = anchors.depths_m[:, None, None] ** 2 * rays[:, :, None] * rays[:, None] + EVIDENCE.slide_m**2 * np.eye(3)
    variance = np.trace(slopes @ spread @ slopes.transpose(0, 2, 1), axis1=1, axis2=2) / 2 + anchors.variances
    scale = EVIDENCE.reach_px**2 + 9 * variance
    weights = (1 + (residual**2).sum(axis=1) / scale) ** -2 * shares * (anchors.strikes == 0) / variance
    rows = jacobian.reshape(-1, human.dof)
    twin = Equations.of(residual.ravel(), rows, np.repeat(weights, 2))
    found = EVIDENCE.equations(question, q, 20.0)
    np.testing.assert_allclose(found.matrix, twin.matrix, rtol=1e-6, atol=1e-6 * np.abs(twin.matrix).max())
    np.testing.assert_allclose(found.vector, twin.vector, rtol=1e-6, atol=1e-6 * np.abs(twin.vector).max())
    assert (found.squares, found.total) == pytest.approx((twin.squares, twin.total))


def test_the_places_on_a_part_count_as_few_observations(scene, images):
    anchors = learned(scene, images[0]).anchors
    sizes = np.bincount(anchors.parts * 4 + anchors.views)
    assert sizes.max() > EVIDENCE.observations
    sums = np.bincount(anchors.parts * 4 + anchors.views, anchors.shares(EVIDENCE.observations))
    np.testing.assert_allclose(sums, np.minimum(sizes, EVIDENCE.observations))


def test_rays_meet_known_parts_where_the_plain_twin_does(scene, images):
    anchors = learned(scene, images[0]).anchors
    camera = scene.rig.cameras[1]
    rows = anchors.views == 1
    assert rows.sum() > 30
    rays, placed = camera.rays(anchors.pixels[rows]), scene.world_from_parts()[0]
    found = np.empty((len(rays), 10))
    meet_parts(placed, scene.shapes, camera.centre, rays, anchors.parts[rows], found)
    twin = met_by_rays(camera.centre, rays, placed, scene.shapes)
    same = twin.part == anchors.parts[rows]
    assert same.mean() > 0.98  # all but at boundaries of coarse surfaces
    np.testing.assert_allclose(found[same, :3], twin.point[same], atol=2e-4)
    np.testing.assert_allclose(found[same, 9], twin.facing[same], atol=0.01)


def test_places_are_taken_inside_trusted_parts_alone(scene, images):
    chest = next(k for k, part in enumerate(scene.persons[0].body.parts) if part.name == "chest")
    anchors = learned(scene, images[0], None, chest).anchors
    assert len(anchors.parts) > 50
    assert chest not in anchors.parts
    assert chest in learned(scene, images[0]).anchors.parts
    ids = SYNTHESIS.part_ids(scene)
    at = np.round(anchors.pixels).astype(int)
    shown = np.array([ids[v][y, x] for v, (x, y) in zip(anchors.views, at, strict=True)])
    assert (shown == anchors.parts).mean() > 0.95


def test_shown_parts_are_those_of_the_synthesis(scene, human):
    """Also where arms hide the outline of the chest, and where a person leaves the image."""
    q = scene.persons[0].q.copy()
    for side in ("left", "right"):
        q[human.index(f"{side}_arm_abduction")] = np.radians(5)
    q[2] = 0.2
    for one in (scene, scene.with_pose(0, q)):
        ids = SYNTHESIS.part_ids(one)
        for v in range(len(one.rig)):
            shown = seen_parts(one, v)
            where = shown.inner(3, trusted(one)[0])
            y, x = np.nonzero(where)
            pixels = np.stack([x, y], axis=1) + shown.corner
            assert len(x) > 0.6 * (ids[v] >= 0).sum()
            assert (shown.at(pixels) == shown.parts[y, x]).all()
            assert (ids[v][pixels[:, 1], pixels[:, 0]] == shown.parts[y, x]).mean() > 0.995
            assert (shown.at(np.array([[-5.0, 3.0], [1e4, 3.0]])) == -1).all()


def test_a_view_from_within_shows_nothing(scene, rig):
    """A part around the camera has no outline: it is left out."""
    camera = rig.cameras[0]
    q = scene.persons[0].q.copy()
    q[:3] = camera.centre
    assert (seen_parts(scene.with_pose(0, q), 0).parts != 0).all()


@pytest.fixture(scope="module")
def far(scene, human) -> Scene:
    """The chest turned so far that nothing on it is where it was."""
    q = scene.persons[0].q.copy()
    q[human.index("spine_twist")] += np.radians(40)
    return scene.with_pose(0, q)


def test_places_that_leave_their_part_are_given_up(scene, far, images, human):
    """They go somewhere, and a pose turns the chest elsewhere: after `patience` frames they are not followed there."""
    anchors = learned(scene, images[0]).anchors
    anchors = replace(anchors, origins=anchors.pixels + 5.0)
    chest = next(k for k, part in enumerate(human.parts) if part.name == "chest")
    kept = EVIDENCE._judged(anchors, far, trusted(scene))
    off = kept.strikes > 0
    assert (kept.parts[off] == chest).sum() > 5
    assert not EVIDENCE._judged(replace(kept, strikes=off * EVIDENCE.patience), far, trusted(scene)).strikes.any()
    back = EVIDENCE._judged(kept, scene, trusted(scene))
    assert len(back.parts) == len(kept.parts)
    assert not back.strikes.any()


def test_what_stands_still_before_a_part_that_turns_is_not_on_it(scene, far, images):
    """A board, or a table: it holds nothing, and nothing is attached there again as long as it is seen."""
    memory, seen = learned(scene, images[0]), Frame(0, 0.0, images[0])
    for _ in range(EVIDENCE.patience):
        memory = EVIDENCE.learned(memory, Sight(seen), far, SYNTHESIS.contours(far), trusted(scene))
    foreign = memory.anchors.parts < 0
    assert foreign.sum() > 5
    question = asked(far, images[0], memory)
    assert (question.observed.anchors.parts >= 0).all()
    places, own = memory.anchors.pixels[foreign], memory.anchors.pixels[~foreign]
    views = memory.anchors.views
    apart = np.linalg.norm(places[:, None] - own[None], axis=2)
    same = views[foreign][:, None] == views[~foreign][None]
    fresh = (memory.anchors.pixels == memory.anchors.origins).all(axis=1)[~foreign]
    assert apart[same & fresh[None]].min() > EVIDENCE.spacing_px - 1.5
    gone = EVIDENCE.learned(memory, Sight(Frame(1, 0.04, images[1])), far, SYNTHESIS.contours(far), trusted(scene))
    assert (gone.anchors.parts < 0).sum() < foreign.sum()


def test_a_view_that_is_missing_takes_its_places_with_it(scene, images):
    memory = learned(scene, images[0])
    seen = (None, *images[1][1:])
    anchors = asked(scene, seen, memory).observed.anchors
    assert 0 not in anchors.views
    assert len(anchors.parts) > 50
    after = EVIDENCE.learned(memory, Sight(Frame(1, 0.04, seen)), scene, SYNTHESIS.contours(scene), trusted(scene))
    back = asked(scene, images[1], after).observed.anchors
    assert 0 not in back.views


def test_no_place_at_all_is_no_fault(scene):
    """A person and a room of one colour have no texture."""
    blank = tuple(np.full((1152, 1440, 3), 120, dtype=np.uint8) for _ in scene.rig.cameras)
    memory = learned(scene, blank)
    assert not len(memory.anchors.parts)
    question = asked(scene, blank, memory)
    assert EVIDENCE.equations(question, scene.persons[0].q, 20.0).total == 0
    nothing = Anchors.none().joined(Anchors.none())
    assert not len(nothing.shares(8.0))
    assert not len(attached(scene, 0, np.zeros((0, 2)), nothing.parts, 0.5, (0.015, 0.15)).parts)
