"""Foreground overlap against plain twins, and what it knows that edges do not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from observations import off
from rounding import assert_alike

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.silhouettes import Foregrounds, SilhouetteEvidence
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import ConfigError
from tracker.images.sight import Changes, Sight
from tracker.kernels.pictures import cover_shares
from tracker.synthesis.cpu import CpuSynthesis


class Cut(Sight):
    """A sight in which the foreground is known exactly."""

    def __init__(self, masks: tuple[Mask | None, ...]) -> None:
        images = tuple(None if mask is None else np.zeros((*mask.shape, 3), dtype=np.uint8) for mask in masks)
        super().__init__(Frame(0, 0.0, images))
        self.masks = masks

    def changes(self, view: int, region: object) -> Changes | None:
        mask = self.masks[view]
        return None if mask is None else Changes(mask, mask)


@pytest.fixture(scope="module")
def masks(truth: Scene) -> tuple[Mask, ...]:
    return CpuSynthesis().silhouettes(truth)


def asked(scene: Scene, masks: tuple[Mask | None, ...], evidence: SilhouetteEvidence | None = None) -> Comparison:
    observed = (evidence or SilhouetteEvidence()).observe(Cut(masks), None)
    return Comparison(scene, 0, CpuSynthesis(), observed)


def plain(seen: Foregrounds, scene: Scene, q: Array, scale_px: float) -> Array:
    """(V,) distances from silhouettes filled by the synthesis in the small views, the twin of `covered_sums`."""
    small = Scene(scene.with_pose(0, q).persons, scene.rig.downscaled(seen.factor))
    found = []
    for v, mask in enumerate(CpuSynthesis().silhouettes(small)):
        start, width, height = seen.regions[v]
        if width == 0:
            found.append(np.nan)
            continue
        cost, worth = np.moveaxis(seen.pictures[start : start + width * height].reshape(height, width, 2), 2, 0)
        found.append(scale_px * (cost[mask].sum() + worth[~mask].sum()) / worth.sum())
    return np.array(found)


def test_distances_equal_their_plain_twin(truth: Scene, masks: tuple[Mask, ...]) -> None:
    body, q = truth.persons[0].body, truth.persons[0].q
    question = asked(truth, (None, *masks[1:]))
    poses = body.clamped(q + np.array([off(body, 15.0, 0.1, seed) for seed in range(6)]))
    found = SilhouetteEvidence()._per_view(question, poses)
    expected = [plain(question.observed, truth, pose, 10.0) for pose in poses]
    assert np.isnan(found[:, 0]).all()
    # The grid that is filled is coarser than that of the pictures. A person is 75 small pixels high here: a sixth of
    # a pixel along the outline is 3 % of the area.
    np.testing.assert_allclose(found, expected, atol=0.03 * 10.0)


def test_a_limb_alone_is_the_whole_body_with_the_limb_moved(truth: Scene, masks: tuple[Mask, ...]) -> None:
    body, q = truth.persons[0].body, truth.persons[0].q
    poses = np.tile(q, (5, 1))
    poses[:, body.group("left_arm")] += np.random.default_rng(1).normal(scale=0.4, size=(5, 4))
    question, evidence = asked(truth, masks), SilhouetteEvidence()
    together = evidence.distances(question, poses)
    assert_alike(together, [evidence.distances(question, pose[None])[0] for pose in poses])


def test_what_stands_still_from_batch_to_batch_changes_no_answer(truth: Scene, masks: tuple[Mask, ...]) -> None:
    body, q, rng = truth.persons[0].body, truth.persons[0].q, np.random.default_rng(2)
    kept, evidence, elsewhere = asked(truth, masks), SilhouetteEvidence(), np.array(q)
    elsewhere[body.group("right_leg")] += 0.2
    for start, limb in ((q, "left_arm"), (q, "left_arm"), (q, "right_arm"), (elsewhere, "left_arm"), (q, "left_arm")):
        poses = np.tile(start, (6, 1))
        poses[:, body.group(limb)] += rng.normal(scale=0.4, size=(6, 4))
        assert_alike(evidence.distances(kept, poses), evidence.distances(asked(truth, masks), poses))


def test_the_truth_covers_the_foreground(truth: Scene, masks: tuple[Mask, ...]) -> None:
    question, evidence = asked(truth, masks), SilhouetteEvidence()
    body, q = truth.persons[0].body, truth.persons[0].q
    around = body.clamped(q + np.array([off(body, 5.0, 0.03, seed) for seed in range(20)]))
    account = evidence.account(question, q)
    assert 2 * account.distance_px < evidence.distances(question, around).min()
    assert account.explained > 0.95
    assert account.missed_px.sum() < 0.02 * account.visible_px.sum()


def test_a_few_known_pixels_count_as_what_they_are_of_the_person(truth: Scene, masks: tuple[Mask, ...]) -> None:
    """Beside somebody who stays a plate knows of a finger alone: bare, it had cost as much as a whole person."""
    evidence, q = SilhouetteEvidence(), truth.persons[0].q
    elsewhere = q + 10.0 * np.eye(len(q))[0]  # covers nothing
    slivers: list[Mask] = []
    for mask in masks:
        rows = np.flatnonzero(mask.any(axis=1))
        sliver = np.zeros_like(mask)
        sliver[rows.min() : rows.min() + 12] = mask[rows.min() : rows.min() + 12]
        slivers.append(sliver)
    unknown = tuple(mask & ~sliver for mask, sliver in zip(masks, slivers, strict=True))
    model_px = tuple(float(mask.sum()) for mask in masks)

    def bare(known: tuple[Mask, ...], *told: object) -> Array:
        seen = evidence.seen(known, *told)  # type: ignore[arg-type]
        return evidence._per_view(Comparison(truth, 0, CpuSynthesis(), seen), elsewhere[None])[0]

    few = evidence.seen(tuple(slivers), unknown, model_px)
    share = few.worth / (evidence.least_share * np.array(model_px) / few.factor**2)
    assert (share < 1).all()
    np.testing.assert_allclose(bare(tuple(slivers), unknown), 10.0)
    np.testing.assert_allclose(bare(tuple(slivers), unknown, model_px), 10.0 * share)
    assert_alike(bare(masks, (None,) * 4, model_px), bare(masks))


@pytest.mark.parametrize("limb", ["left_arm", "right_leg"])
def test_a_displaced_limb_costs_and_is_told(truth: Scene, masks: tuple[Mask, ...], limb: str) -> None:
    body, q = truth.persons[0].body, truth.persons[0].q
    question, evidence = asked(truth, masks), SilhouetteEvidence()
    turned = q + np.radians(50) * np.eye(body.dof)[body.index(f"{limb}_abduction")]
    right, wrong = evidence.distances(question, np.stack([q, turned]))
    assert wrong > right + 0.5
    before, after = (evidence.account(question, pose).of(body.parts_of(limb)) for pose in (q, turned))
    assert after.left_over > before.left_over + 0.5


def test_refined_on_outlines_alone_the_pose_comes_back(truth: Scene, masks: tuple[Mask, ...]) -> None:
    body, truth_q = truth.persons[0].body, truth.persons[0].q
    q = body.clamped(truth_q + off(body, 2.0, 0.015, seed=3))
    question, evidence = asked(truth, masks), SilhouetteEvidence()
    prior = np.diag(np.where(body.rotates, np.radians(15), 0.15) ** -2.0)
    gaps = []
    for gate_px in (20.0, 14.0, 10.0, 8.0, 8.0):
        found = evidence.equations(question, q, gate_px)
        q = body.clamped(q - np.linalg.solve(found.matrix + prior, found.vector))
        gaps.append(np.linalg.norm(np.subtract(*body.landmarks_in_world(np.stack([q, truth_q]))), axis=1).mean())
    assert gaps[-1] < 0.01


def test_together_is_the_weighted_sum(truth: Scene, masks: tuple[Mask, ...]) -> None:
    one, other = SilhouetteEvidence(), SilhouetteEvidence(scale_px=3.0)
    both = TogetherEvidence(of=(one, other), ranking=(0.5, 2.0), refining=(0.5, 2.0))
    sight, q = Cut(masks), truth.persons[0].q
    poses = q + 0.05 * np.eye(len(q))[:3]
    question = Comparison(truth, 0, CpuSynthesis(), both.observe(sight, None))
    parts = [Comparison(truth, 0, CpuSynthesis(), kind.observe(sight, None)) for kind in (one, other)]
    expected = 0.5 * one.distances(parts[0], poses) + 2.0 * other.distances(parts[1], poses)
    np.testing.assert_allclose(both.distances(question, poses), expected)
    found, each = both.equations(question, poses[0], 20.0), one.equations(parts[0], poses[0], 20.0)
    np.testing.assert_allclose(found.matrix, 2.5 * each.matrix, rtol=1e-9)
    assert both.account(question, poses[0]).distance_px == pytest.approx(expected[0])


def test_what_ranks_need_not_refine(truth: Scene, masks: tuple[Mask, ...]) -> None:
    """The distance is that of both; equations and shares are those of the one that refines."""
    one, other = SilhouetteEvidence(), SilhouetteEvidence(scale_px=3.0)
    both, sight, q = TogetherEvidence(of=(one, other), refining=(1.0, 0.0)), Cut(masks), truth.persons[0].q
    question = Comparison(truth, 0, CpuSynthesis(), both.observe(sight, None))
    alone = Comparison(truth, 0, CpuSynthesis(), one.observe(sight, None))
    account = both.account(question, q)
    assert account.distance_px == pytest.approx(1.3 * one.distances(alone, q[None])[0])
    assert_alike(account.explained_px, one.account(alone, q).explained_px)
    assert_alike(both.equations(question, q, 20.0).matrix, one.equations(alone, q, 20.0).matrix)


@pytest.mark.parametrize("weights", [{"ranking": (1.0,)}, {"refining": (0.0, 0.0)}, {"ranking": (1.0, 1.0, 1.0)}])
def test_every_kind_has_its_weights(weights: dict[str, tuple[float, ...]]) -> None:
    with pytest.raises(ConfigError, match="together: "):
        TogetherEvidence(of=(SilhouetteEvidence(), SilhouetteEvidence()), **weights)


def test_a_view_that_shows_but_a_speck_tells_nothing(truth: Scene, masks: tuple[Mask, ...]) -> None:
    speck, q = np.zeros_like(masks[0]), truth.persons[0].q[None]
    speck[30, 40] = True
    evidence = SilhouetteEvidence()
    with np.errstate(all="raise"):
        found, none = (
            evidence.distances(asked(truth, (mask, *masks[1:]), evidence), q) for mask in (speck, np.zeros_like(speck))
        )
    assert_alike(found, none)


@pytest.mark.parametrize("factor", [1, 2, 3, 4, 5, 7, 10])
def test_shares_of_squares_equal_those_of_opencv(factor: int) -> None:
    """But for rounding: half of a square is foreground, and a hundredth of it is not nothing."""
    mask = np.random.default_rng(factor).random((60, 83)) < 0.5
    height, width = (length // factor for length in mask.shape)
    whole = mask[: height * factor, : width * factor].astype(np.float32)
    found = np.empty((height, width), dtype=np.float32)
    cover_shares(mask, factor, found)
    assert_alike(found, cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


def test_shares_of_a_mask_with_empty_rows_are_written_there_too() -> None:
    mask, found = np.zeros((12, 8), dtype=np.bool_), np.full((3, 2), 7, dtype=np.float32)
    mask[5, 3] = True
    cover_shares(mask, 4, found)
    np.testing.assert_array_equal(found, [[0, 0], [1 / 16, 0], [0, 0]])


@pytest.mark.parametrize("reach_px", [5.0, 20.0, 33.3])
@pytest.mark.parametrize("hidden", [False, True])
def test_what_covering_costs_near_the_foreground_is_what_it_costs_in_whole_pictures(
    reach_px: float, hidden: bool, masks: tuple[Mask, ...]
) -> None:
    """Distances are asked for no farther away than they matter."""
    evidence, mask = SilhouetteEvidence(reach_px=reach_px), np.pad(masks[0], ((0, 200), (0, 300)))
    unknown = np.zeros_like(mask) if hidden else None
    if unknown is not None:
        unknown[300:330, 500:560] = True
    seen = evidence.seen((mask,), (unknown,))
    (_, width, height), factor = seen.regions[0], seen.factor
    inside, free = np.empty((height, width), np.float32), np.zeros((height, width), np.float32)
    cover_shares(mask, factor, inside)
    if unknown is not None:
        cover_shares(unknown, factor, free)
    within = inside >= 0.5
    outwards = factor * cv2.distanceTransform((~(within | (free > 0))).astype(np.uint8), cv2.DIST_L2, 3)
    inwards = cv2.distanceTransform(within.astype(np.uint8), cv2.DIST_L2, 3)
    cost = np.clip((outwards - 0.75 * factor) / reach_px, 0, 1)
    assert 0.01 < (cost < 1).mean() < 0.9, "else nothing is near, or far"
    worth = within * np.minimum(inwards / 2, 1)
    assert_alike(seen.pictures, np.stack([cost, worth], axis=-1).reshape(-1, 2))


def test_foregrounds_found_ahead_are_made_ready_once(
    truth: Scene, masks: tuple[Mask, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were in every frame's own time, though nothing of them hangs on the prediction."""
    images = tuple(np.zeros((*mask.shape, 3), dtype=np.uint8) for mask in masks)
    sights = [Sight(Frame(0, 0.0, images, masks)) for _ in range(2)]
    evidence, contours = SilhouetteEvidence(), CpuSynthesis().contours(truth)
    fresh = evidence.observe(sights[0], contours)
    for v, mask in enumerate(masks):
        sights[1].changes(v, (0, 0, mask.shape[1], mask.shape[0]))
    evidence.look(sights[1], contours)
    with monkeypatch.context() as patch:
        patch.delattr(SilhouetteEvidence, "seen")
        ahead = evidence.observe(sights[1], contours)
    assert_alike(ahead.pictures, fresh.pictures)
    sights[1].hide({})
    assert evidence.observe(sights[1], contours) is not ahead, "what is before the persons is not theirs"
