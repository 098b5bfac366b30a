"""Limbs that something hides from a view: noticed where other views show them, and left out there alone."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from observations import bent, four_views
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation, with_images

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.measures.account import LONG_FRAMES, Account, hidden_limbs, not_shown_by
from tracker.foundation.arrays import Image, Mask
from tracker.results.recording._drawing import draw_step
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.doubts import Doubts
from tracker.tracking.estimate import Estimate
from tracker.tracking.loss import trusted_parts
from tracker.tracking.sequence import track
from tracker.tracking.trajectory import History, Step

ARM, BLUE = "left_arm", (220, 120, 60)


@pytest.fixture(scope="module")
def scene(body: BodyModel) -> Scene:
    return Scene((Person("anna", body, bent(body)),), four_views())


def account_of(body: BodyModel, left_over: dict[tuple[int, str], float], n_views: int = 4) -> Account:
    """100 px of each part in each view, a tenth of which is left over but where something else is told of a limb."""
    shares = np.full((n_views, len(body.parts)), 0.1)
    for (view, group), share in left_over.items():
        shares[view, body.parts_of(group)] = share
    visible = np.full(shares.shape, 100.0)
    by_view = np.array([visible, visible * (1 - shares), np.zeros(shares.shape)])
    return Account(1.0, np.ones(n_views), np.ones(len(body.parts)), *by_view.sum(axis=1), by_view)


def found(scene: Scene, account: Account, hidden: Mask | None = None) -> set[tuple[int, str]]:
    """View and limb of what is not shown."""
    body = scene.persons[0].body
    places = scene.world_from_parts()[0, :, :3, 3]
    mask = not_shown_by(body, scene.rig, places, account, hidden)
    return set(hidden_limbs(body, replace(account, hidden=mask)))


def test_a_limb_that_one_view_does_not_show_is_hidden_there(scene: Scene, body: BodyModel) -> None:
    assert found(scene, account_of(body, {})) == set()
    assert found(scene, account_of(body, {(2, ARM): 0.8})) == {(2, ARM)}
    assert found(scene, account_of(body, {(2, ARM): 0.4})) == set()


def test_what_no_two_views_show_from_different_sides_may_be_anywhere(scene: Scene, body: BodyModel) -> None:
    unclear = account_of(body, {(2, ARM): 0.8, (0, ARM): 0.3})
    assert found(scene, unclear) == {(2, ARM)}
    between = np.mean([scene.rig.cameras[v].centre for v in (1, 3)], axis=0)
    assert not_shown_by(body, scene.rig, np.tile(between, (len(body.parts), 1)), unclear) is None
    assert found(scene, account_of(body, {(2, ARM): 0.8, (3, ARM): 0.8})) == set()


def test_a_person_of_whom_much_is_left_over_is_not_hidden_but_wrong(scene: Scene, body: BodyModel) -> None:
    limbs = body.limbs
    assert found(scene, account_of(body, {(2, group): 0.8 for group in limbs})) == set()


def test_what_hid_a_limb_is_believed_longer(scene: Scene, body: BodyModel) -> None:
    before = np.zeros((4, len(body.parts)), dtype=np.bool_)
    before[2, body.parts_of(ARM)] = True
    account = account_of(body, {(2, ARM): 0.4, (0, ARM): 0.25})
    assert found(scene, account) == set()
    assert found(scene, account, before) == {(2, ARM)}
    assert found(scene, account_of(body, {(2, ARM): 0.2}), before) == set()


def test_evidence_that_cannot_tell_views_apart_hides_nothing(scene: Scene, body: BodyModel) -> None:
    assert found(scene, replace(account_of(body, {(2, ARM): 0.8}), by_view_px=None)) == set()


def test_an_account_without_hidden_parts_is_the_sum_of_the_rest(body: BodyModel) -> None:
    account = account_of(body, {(2, ARM): 0.8, (1, ARM): 0.5})
    hidden = np.zeros((4, len(body.parts)), dtype=np.bool_)
    hidden[2, body.parts_of(ARM)] = True
    rest = account.without(hidden)
    expected = np.where(hidden, 0, account.by_view_px).sum(axis=1)
    np.testing.assert_allclose([rest.visible_px, rest.explained_px, rest.missed_px], expected)
    np.testing.assert_array_equal(rest.hidden, hidden)
    np.testing.assert_allclose(rest.of(body.parts_of(ARM)).left_over, (0.1 + 0.5 + 0.1) / 3)
    assert account.without(np.zeros_like(hidden)) is account


def test_a_history_counts_for_how_long_a_view_has_not_shown_a_part(body: BodyModel) -> None:
    def estimate(parts: list[int]) -> Estimate:
        not_shown = np.zeros((4, len(body.parts)), dtype=np.bool_)
        not_shown[1, parts] = True
        account = replace(account_of(body, {}), not_shown=not_shown if parts else None)
        return Estimate(body.rest(), np.eye(body.dof), account, 0.0, 1)

    history = History.start(0.0, body.rest())
    for k, parts in enumerate(([2, 3], [3], [3, 4])):
        history = history.after(0.04 * (k + 1), estimate(parts))
    assert history.unseen is not None
    assert history.unseen[1, :5].tolist() == [0, 0, 0, 3, 1]
    assert not history.unseen[[0, 2, 3]].any()
    assert history.after(1.0, estimate([])).unseen is None


VIEW = 0


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation(n_frames=12, size=(720, 576))


@pytest.fixture(scope="module")
def steps(simulation: Simulation) -> list[Step]:
    """A recording tracked, in which a board stands before the left arm in a view."""
    camera, body = simulation.scene.rig.cameras[VIEW], simulation.scene.persons[0].body
    board = np.zeros(camera.size[::-1], dtype=np.uint8)
    for q in simulation.poses[0]:
        pixels = camera.project(body.landmarks_in_world(q)[body.landmarks_of(ARM)])
        cv2.fillConvexPoly(board, cv2.convexHull(np.round(pixels).astype(np.int32)), 1)
    board = cv2.dilate(board, np.ones((31, 31), np.uint8))[..., None]

    def before(_: int, v: int, image: Image | None) -> Image | None:
        return np.where(board, np.uint8(90), image).astype(np.uint8) if v == VIEW else image

    plates = tuple(None if v == VIEW else plate for v, plate in enumerate(simulation.plates))
    cycle = cycle_for(simulation, TrueStart(simulation), plates=plates, evidence=AutoEvidence())
    return list(track(with_images(simulation, before), simulation.scene, cycle))


def test_behind_a_board_in_one_view_an_arm_is_followed_and_not_in_doubt(
    simulation: Simulation, steps: list[Step]
) -> None:
    body = simulation.scene.persons[0].body
    for k, step in enumerate(steps):
        estimate = step.estimates[0]
        assert (hidden_limbs(body, estimate.account) == [(VIEW, ARM)]) == (k > LONG_FRAMES), k
        assert joint_errors_mm(simulation, 0, k, estimate.q)[body.landmarks_of(ARM)].max() < 40
        if k > LONG_FRAMES:
            assert ARM not in estimate.ambiguous
            np.testing.assert_array_equal(trusted_parts(body, estimate)[VIEW], ~body.parts_of(ARM))
            assert trusted_parts(body, estimate)[[v for v in range(4) if v != VIEW]].all()


def test_the_run_says_what_was_hidden_from_which_view(simulation: Simulation, steps: list[Step]) -> None:
    doubts = Doubts()
    for step in steps:
        doubts = doubts.after(step)
    name = simulation.scene.rig.names[VIEW]
    assert (
        f"left arm hidden from {name} in {len(steps) - LONG_FRAMES - 1} (frames {LONG_FRAMES + 1}-{len(steps) - 1})"
        in doubts.sentence()
    )
    shown, hidden = (draw_step(steps[k], simulation.scene, 1440) for k in (0, -1))
    assert not (shown == BLUE).all(axis=2).any()
    assert (hidden == BLUE).all(axis=2).any()
