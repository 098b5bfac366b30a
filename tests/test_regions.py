"""Region evidence: what it remembers, what it says before it knows anything, and whom it learns from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from observations import bent, four_views
from painted import painted

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.evidence import GUESSED
from tracker.evidence._colours import Colours, corrected
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.regions import RegionEvidence
from tracker.foundation.arrays import Array, Mask
from tracker.images.sight import Sight
from tracker.kernels.regions import N_COLOURS, Tables
from tracker.synthesis.cpu import CpuSynthesis

EVIDENCE, SYNTHESIS = RegionEvidence(), CpuSynthesis()


def trusted(scene: Scene, *doubted: int) -> Mask:
    """All parts of a scene but some."""
    found = np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
    found[:, list(doubted)] = False
    return found


@pytest.fixture(scope="module")
def scene(body: BodyModel) -> Scene:
    return Scene((Person("one", body, bent(body)),), four_views((720, 576)))


@pytest.fixture(scope="module")
def sight(scene: Scene) -> Sight:
    colours = np.random.default_rng(5).integers(20, 236, (len(scene.shapes) + 1, 3)).astype(np.float64)
    return Sight(Frame(0, 0.0, painted(scene, colours, noise=6.0)))


@pytest.fixture(scope="module")
def memory(scene: Scene, sight: Sight) -> Colours:
    learned = EVIDENCE.learned(None, sight, scene, SYNTHESIS.contours(scene), trusted(scene))
    assert learned is not None
    return learned


def asked(scene: Scene, sight: Sight, memory: Colours | None, blind: bool = False) -> Comparison:
    expected = None if blind else SYNTHESIS.contours(scene)
    return Comparison(scene, 0, SYNTHESIS, EVIDENCE.observe(sight, expected, memory))


def test_before_anything_is_learnt_it_is_silent(scene: Scene, sight: Sight) -> None:
    question, q = asked(scene, sight, None, blind=True), scene.persons[0].q
    assert not EVIDENCE.distances(question, np.stack([q, q + 0.1])).any()
    assert EVIDENCE.equations(question, q, 10.0).total == 0
    account = EVIDENCE.account(question, q)
    assert account.distance_px == 0
    assert not account.visible_px.any()


def test_a_start_pose_teaches_the_first_frame(scene: Scene, sight: Sight, memory: Colours) -> None:
    q = scene.persons[0].q
    poses = np.stack([q, scene.persons[0].body.clamped(q + 0.1)])
    known, first = (EVIDENCE.distances(asked(scene, sight, one), poses) for one in (memory, None))
    np.testing.assert_array_equal(first, known)


def test_a_guessed_pose_does_not_confirm_itself(scene: Scene, sight: Sight) -> None:
    q, contours = scene.persons[0].q, SYNTHESIS.contours(scene)
    question = Comparison(scene, 0, SYNTHESIS, EVIDENCE.observe(sight, contours, GUESSED))
    assert not EVIDENCE.distances(question, np.stack([q, q + 0.1])).any()
    assert EVIDENCE.equations(question, q, 10.0).total == 0


def test_a_wrong_start_pose_is_not_confirmed_by_its_own_colours(scene: Scene, sight: Sight, body: BodyModel) -> None:
    """An arm taken to be where there is none has the same colours on both sides."""
    q = scene.persons[0].q.copy()
    q[body.index("left_arm_abduction")] += np.radians(70)
    wrong = scene.with_pose(0, body.clamped(q))
    account = EVIDENCE.account(asked(wrong, sight, None), wrong.persons[0].q)
    arm = body.parts_of("left_arm")
    assert account.of(arm).explained < 0.5
    assert account.of(~arm).explained > 0.8


def test_at_the_truth_nearly_all_contours_are_explained(scene: Scene, sight: Sight, memory: Colours) -> None:
    account = EVIDENCE.account(asked(scene, sight, memory), scene.persons[0].q)
    assert account.explained > 0.9
    assert account.distance_px < 3


def test_a_refinement_finds_the_way_back(scene: Scene, sight: Sight, memory: Colours, body: BodyModel) -> None:
    """From an arm 12 degrees off, up to 6 cm at the hand, with the colours of the frame before."""
    truth = scene.persons[0].q
    q = truth.copy()
    columns = body.group("left_arm")
    q[columns] += np.radians([8.0, -8.0, 0.0, 12.0])
    off = np.linalg.norm(body.landmarks_in_world(q) - body.landmarks_in_world(truth), axis=1).max()
    question = asked(scene, sight, memory)
    for gate_px in np.geomspace(30, 8, 6):
        found = EVIDENCE.equations(question, q, float(gate_px))
        matrix = found.matrix + np.diag(1 / np.where(body.rotates, np.radians(15), 0.15) ** 2)
        q = q - np.linalg.solve(matrix, found.vector)
    left = np.linalg.norm(body.landmarks_in_world(q) - body.landmarks_in_world(truth), axis=1).max()
    assert off > 0.05
    # a pixel is 6 mm there
    assert left < 0.012


def test_memory_is_a_frozen_value(scene: Scene, sight: Sight, memory: Colours) -> None:
    before = [values.copy() for values in (*memory.tables, memory.posteriors, memory.known)]
    other = Sight(Frame(1, 0.04, tuple(255 - image for image in sight.frame.images if image is not None)))
    later = EVIDENCE.learned(memory, other, scene, SYNTHESIS.contours(scene), trusted(scene))
    assert later is not None
    assert (later.tables.inside != memory.tables.inside).any()
    for values, kept in zip((*memory.tables, memory.posteriors, memory.known), before, strict=True):
        np.testing.assert_array_equal(values, kept)
    for values in (*later.tables, later.posteriors, later.known):
        assert not values.flags.writeable


@pytest.mark.parametrize(("size", "around"), [((128, 104), EVIDENCE.around), ((720, 576), 0.0)])
def test_what_was_looked_at_before_does_not_tell_what_is_learnt(
    body: BodyModel, size: tuple[int, int], around: float
) -> None:
    """A resumed run replays frames in which nothing was looked at."""
    scene = Scene((Person("one", body, bent(body)),), four_views(size))
    images = tuple(np.random.default_rng(v).integers(0, 256, (*size[::-1], 3), dtype=np.uint8) for v in range(4))
    evidence, contours, learned = RegionEvidence(around=around), SYNTHESIS.contours(scene), []
    for looked_at in (False, True):
        sight = Sight(Frame(0, 0.0, images))
        if looked_at:
            evidence.observe(sight, None)
        learned.append(evidence.learned(None, sight, scene, contours, trusted(scene)))
    fresh, other = learned
    assert fresh is not None
    assert other is not None
    for one, another in zip((*fresh.tables, fresh.posteriors), (*other.tables, other.posteriors), strict=True):
        np.testing.assert_array_equal(one, another)


def test_nothing_is_learnt_from_who_is_doubted(scene: Scene, sight: Sight, memory: Colours) -> None:
    contours, nothing = SYNTHESIS.contours(scene), np.zeros((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
    assert EVIDENCE.learned(None, sight, scene, contours, nothing) is None
    assert EVIDENCE.learned(memory, sight, scene, contours, nothing) is memory


def test_a_doubted_limb_teaches_nothing_and_is_forgotten_by_nothing(
    body: BodyModel, scene: Scene, sight: Sight, memory: Colours
) -> None:
    arm = body.parts_of("left_arm")
    q = scene.persons[0].q.copy()
    q[body.index("left_arm_abduction")] += np.radians(70)
    wrong = scene.with_pose(0, body.clamped(q))
    contours = SYNTHESIS.contours(wrong)
    doubted, believed = (
        EVIDENCE.learned(memory, sight, wrong, contours, which)
        for which in (trusted(scene, *np.flatnonzero(arm)), trusted(scene))
    )
    assert doubted is not None
    assert believed is not None
    np.testing.assert_array_equal(doubted.tables.inside[:, arm], memory.tables.inside[:, arm])
    assert (doubted.tables.inside[:, ~arm] != memory.tables.inside[:, ~arm]).any()
    assert (believed.tables.inside[:, arm] != memory.tables.inside[:, arm]).any()


def test_of_two_persons_the_trusted_one_is_learnt(body: BodyModel, sight: Sight, scene: Scene) -> None:
    q = scene.persons[0].q.copy()
    q[0] += 0.8
    both = Scene((*scene.persons, Person("two", body, q)), scene.rig)
    n_parts = len(body.parts)
    learned = EVIDENCE.learned(None, sight, both, SYNTHESIS.contours(both), trusted(both, *range(n_parts)))
    assert learned is not None
    assert not learned.known[:, :n_parts].any()
    assert learned.known[:, n_parts:].any()


def test_a_missing_view_teaches_and_says_nothing(scene: Scene, sight: Sight) -> None:
    images = (None, *sight.frame.images[1:])
    blind = Sight(replace(sight.frame, images=images))
    learned = EVIDENCE.learned(None, blind, scene, SYNTHESIS.contours(scene), trusted(scene))
    assert learned is not None
    assert not learned.known[0].any()
    assert learned.known[1:].any()
    account = EVIDENCE.account(asked(scene, blind, learned), scene.persons[0].q)
    np.testing.assert_array_equal(np.isnan(account.per_view_px), [True, False, False, False])


def spikes(*colours: int) -> Array:
    """A table of a few colours."""
    table = np.zeros(N_COLOURS, dtype=np.float32)
    table[list(colours)] = 1 / len(colours)
    return table


def tables_of(inside: Array, outside: Array | None = None) -> Tables:
    """Tables (V, P, 4096) with nothing known of hiders."""
    beside = np.zeros_like(inside) if outside is None else outside
    return Tables(inside, beside, np.zeros((len(inside), N_COLOURS), dtype=np.float32))


def test_what_hides_a_part_at_the_start_is_told_by_the_other_views() -> None:
    inside = np.zeros((4, 2, N_COLOURS), dtype=np.float32)
    inside[:, 0] = spikes(1, 2), spikes(1, 2, 3), spikes(1, 2), spikes(70, 71)
    inside[:, 1] = spikes(1), spikes(50), spikes(100), spikes(150)
    before = inside.copy()
    known = np.ones((4, 2), dtype=np.bool_)
    tables = tables_of(inside)
    replaced = corrected(tables, known, known)
    np.testing.assert_array_equal(replaced, [[False, False], [False, False], [False, False], [True, False]])
    np.testing.assert_allclose(inside[3, 0], before[:3, 0].mean(axis=0))
    np.testing.assert_array_equal(inside[:3], before[:3])
    # beside the contour is something else: a part that looks otherwise from there, not one that is hidden
    assert not tables.hiders.any()
    # what was learnt long ago is believed
    inside = before.copy()
    assert not corrected(tables_of(inside), np.zeros_like(known), known).any()


def test_what_is_on_both_sides_of_a_contour_hides_the_part_and_others_of_the_view() -> None:
    inside = np.zeros((4, 2, N_COLOURS), dtype=np.float32)
    inside[:3, 0], inside[3, 0] = spikes(1, 2), spikes(70, 71)
    # half of the second part is hidden as well
    inside[:3, 1], inside[3, 1] = spikes(1, 5), spikes(1, 5, 70, 71)
    outside = np.zeros_like(inside)
    outside[3, 0] = spikes(70, 71, 72)
    known, tables = np.ones((4, 2), dtype=np.bool_), tables_of(inside, outside)
    np.testing.assert_array_equal(corrected(tables, known, known)[:, 0], [False, False, False, True])
    np.testing.assert_allclose(tables.hiders[3], spikes(70, 71))
    assert not tables.hiders[:3].any()
    np.testing.assert_allclose(inside[3, 0], spikes(1, 2))
    np.testing.assert_allclose(inside[3, 1], spikes(1, 5))


def test_a_board_before_a_limb_counts_neither_for_nor_against_it(body: BodyModel, scene: Scene) -> None:
    """One view shows a board over half of the person; where a leg is behind it is told by the others."""
    colours = np.random.default_rng(5).integers(20, 236, (len(scene.shapes) + 1, 3)).astype(np.float64)
    images = list(painted(scene, colours, noise=6.0))
    board = np.random.default_rng(1).normal((40, 90, 160), 6.0, images[1].shape).clip(0, 255).astype(np.uint8)
    low = images[1].shape[0] // 2
    images[1][low:] = board[low:]
    sight, q, legs = Sight(Frame(0, 0.0, tuple(images))), scene.persons[0].q, body.parts_of("left_leg")
    learned = EVIDENCE.learned(None, sight, scene, SYNTHESIS.contours(scene), trusted(scene))
    assert learned is not None
    assert learned.tables.hiders[1].any()
    assert not learned.tables.hiders[[0, 2, 3]].any()
    open_account, account = (
        EVIDENCE.account(asked(scene, shown, learned), q)
        for shown in (Sight(Frame(0, 0.0, painted(scene, colours, noise=6.0))), sight)
    )
    assert account.of(legs).explained > 0.85
    assert account.of(legs).visible_px.sum() < 0.9 * open_account.of(legs).visible_px.sum()
    assert account.explained > 0.85


def test_of_two_views_that_differ_nobody_knows_which_is_right() -> None:
    inside = np.stack([spikes(1), spikes(70)])[:, None]
    known = np.ones((2, 1), dtype=np.bool_)
    assert not corrected(tables_of(inside), known, known).any()
