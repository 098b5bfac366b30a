"""Level sets: laws of the energy, two ways to its minimum, densities, and what evidence and pose make of them."""

from __future__ import annotations

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest
from observations import off
from painted import painted

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import GUESSED
from tracker.evidence._around import Reach, around
from tracker.evidence.level_set import LevelSetEvidence
from tracker.evidence.measures.outlines import Comparison, overlap
from tracker.evidence.silhouettes import SilhouetteEvidence
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Mask
from tracker.images.operations import level_set
from tracker.images.operations.level_set import (
    Forces,
    colour_codes,
    densities,
    descent,
    energy,
    gradient,
    signed_distance,
    texture_codes,
    threshold_dynamics,
)
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation.coupled import CoupledEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective

SIZE = 96, 128


def disc(x: float, y: float, radius: float, size: tuple[int, int] = SIZE) -> Mask:
    rows, columns = np.mgrid[: size[0], : size[1]]
    return np.hypot(columns - x, rows - y) < radius


def noisy_forces(seed: int = 0, **changes: object) -> tuple[Mask, Forces]:
    """A disc that its odds show, with noise as large as they are."""
    truth = disc(64, 48, 25)
    rng = np.random.default_rng(seed)
    odds = (np.where(truth, 1.0, -1.0) + rng.normal(size=SIZE)).astype(np.float32)
    return truth, replace(Forces(odds, 2.0), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("with_prior", [False, True])
def test_gradient_is_that_of_the_energy(with_prior: bool) -> None:
    rng = np.random.default_rng(1)
    prior = signed_distance(disc(12, 9, 6, (20, 24))) if with_prior else None
    forces = Forces(rng.normal(size=(20, 24)).astype(np.float32), 1.7, prior, 0.05)
    phi = signed_distance(disc(11, 10, 6, (20, 24))).astype(np.float64) + 0.3 * rng.normal(size=(20, 24))
    found, step = gradient(phi, forces), 1e-5
    for place in np.ndindex(20, 24):
        moved = np.zeros_like(phi)
        moved[place] = step
        numeric = (energy(phi + moved, forces) - energy(phi - moved, forces)) / (2 * step)
        assert found[place] == pytest.approx(numeric, abs=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_no_step_of_the_descent_raises_the_energy(seed: int) -> None:
    truth, forces = noisy_forces(seed, prior=signed_distance(disc(66, 50, 24)), shape=0.02)
    region, steps = descent(disc(58, 44, 20), forces)
    assert len(steps) > 10
    assert all(after <= before for before, after in steps)
    assert steps[-1][1] < steps[0][0]
    assert overlap(region, truth) > overlap(disc(58, 44, 20), truth) + 0.2


def region_energy(region: Mask, forces: Forces) -> float:
    """What `threshold_dynamics` minimizes: the energy with the length of the outline as a Gaussian measures it."""
    inside = region.astype(np.float32)
    flown = ((1 - inside) * level_set._blurred(inside)).sum(dtype=np.float64)
    drive = level_set._drive(forces)
    return float(forces.length * level_set._CIRCUMFERENCE * flown - (inside * drive).sum(dtype=np.float64))


@pytest.mark.parametrize("seed", range(3))
def test_no_step_of_threshold_dynamics_raises_the_energy(seed: int) -> None:
    _, forces = noisy_forces(seed, prior=signed_distance(disc(66, 50, 24)), shape=0.02)
    region = disc(50, 40, 15)
    energies = [region_energy(region, forces)]
    for _ in range(12):
        region = threshold_dynamics(region, forces, 1)
        energies.append(region_energy(region, forces))
    # in single precision, of energies of thousands
    assert all(later <= before + 0.01 for before, later in itertools.pairwise(energies))
    assert energies[-1] < energies[0] - 100


def test_both_ways_find_the_same_region() -> None:
    """The same energy, its length measured in two ways; a ring of half a pixel about the disc is 4 % of it."""
    truth, forces = noisy_forces()
    start = disc(58, 44, 22)
    fast, slow = threshold_dynamics(start, forces, 40), descent(start, forces, 150)[0]
    assert overlap(fast, slow) > 0.95
    assert overlap(fast, truth) > 0.95
    assert overlap(slow, truth) > 0.95


def test_length_is_that_of_the_outline() -> None:
    """2 pi 25 px: both measures of it without odds, differences of their energies per unit of weight."""
    phi, nothing = signed_distance(disc(64, 48, 25)), np.zeros(SIZE, dtype=np.float32)
    length = 2 * np.pi * 25
    found = energy(phi.astype(np.float64), Forces(nothing, 1.0)) - energy(np.full(SIZE, -50.0), Forces(nothing, 1.0))
    assert found == pytest.approx(length, rel=0.05)
    assert region_energy(phi > 0, Forces(nothing, 1.0)) == pytest.approx(length, rel=0.05)


def test_the_prior_holds_where_nothing_is_seen() -> None:
    nothing, prior = np.zeros(SIZE, dtype=np.float32), disc(64, 48, 25)
    start = disc(70, 52, 22)
    for shape, least in ((0.0, 0.0), (0.2, 0.95)):
        forces = Forces(nothing, 0.5, signed_distance(prior), shape)
        for region in (threshold_dynamics(start, forces, 60), descent(start, forces, 120)[0]):
            assert (overlap(region, prior) > 0.95) == (least > 0)


@pytest.mark.parametrize("shape", [0.02, 0.04, 0.08])
def test_both_ways_weigh_the_prior_alike(shape: float) -> None:
    """Against odds of 1 everywhere a straight contour rests where 2 lambda of its distance are H'(0) = 0.4 (eq. 4)."""
    prior = np.zeros(SIZE, dtype=np.bool_)
    prior[:, :60] = True
    forces = Forces(np.full(SIZE, -1.0, dtype=np.float32), 0.3, signed_distance(prior), shape)
    for region in (threshold_dynamics(prior, forces, 200), descent(prior, forces, 400)[0]):
        assert 60 - region[SIZE[0] // 2].sum() == pytest.approx(0.4 / (2 * shape), abs=1)


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_a_silhouette_made_smaller_stays_where_it_is(factor: int) -> None:
    """What images are made smaller by has the middle of each small pixel in the middle of its pixels."""
    mask = disc(301.3, 230.8, 90.0, (480, 640))
    frame = Frame(0, 0.0, (np.zeros((480, 640, 3), dtype=np.uint8),))
    seen = around(Sight(frame), 0, mask, Reach(30.0, factor, "colours"))
    assert seen is not None
    again = seen.uncut(seen.cut(mask), mask.shape)
    middles = [np.mean(np.nonzero(one), axis=1) for one in (again, mask)]
    np.testing.assert_allclose(middles[0], middles[1], atol=0.3)
    assert overlap(again, mask) > 0.97


def test_signed_distance_is_zero_between_the_pixels() -> None:
    half = np.zeros((10, 20), dtype=np.bool_)
    half[:, 10:] = True
    np.testing.assert_allclose(signed_distance(half)[5, 8:12], [-1.5, -0.5, 0.5, 1.5], atol=0.1)
    assert (signed_distance(np.zeros((4, 4), dtype=np.bool_), 7.0) == -7).all()
    assert signed_distance(half, 3.0).max() == 3


def test_densities_are_shares_that_tell_sides_apart() -> None:
    rng = np.random.default_rng(2)
    inside = disc(64, 48, 25)
    image = np.where(inside[..., None], (40, 90, 160), (90, 90, 90)) + rng.normal(scale=12, size=(*SIZE, 3))
    codes = (colour_codes(np.clip(image, 0, 255).astype(np.uint8)),)
    found = densities(codes, inside, ~inside)
    assert found is not None
    np.testing.assert_allclose(found.tables.sum(axis=-1), 1, rtol=1e-5)
    odds = found.log_odds(codes)
    assert (odds[inside] > 0).mean() > 0.95
    assert (odds[~inside] < 0).mean() > 0.95
    np.testing.assert_allclose(found.mixed(found, 0.3).tables, found.tables, rtol=1e-5)
    assert densities(codes, disc(5, 5, 1), ~inside) is None


def test_texture_tells_what_colours_cannot() -> None:
    """Stripes of the same grey levels, upright inside and level outside."""
    inside = disc(64, 48, 30)
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    grey = np.where(inside, columns // 3 % 2, rows // 3 % 2) * 120 + 60
    image = np.repeat(grey[..., None], 3, axis=2).astype(np.uint8)
    both = (colour_codes(image), texture_codes(image))
    found = {}
    for name, codes in (("colour", both[:1]), ("texture", both)):
        known = densities(codes, inside, ~inside)
        assert known is not None
        region = threshold_dynamics(disc(50, 40, 20), Forces(known.log_odds(codes), 1.0), 60)
        found[name] = overlap(region, inside)
    assert found["texture"] > 0.9 > found["colour"]


@pytest.fixture(scope="module")
def seen(truth: Scene) -> tuple[Sight, tuple[Mask, ...]]:
    """Parts of a person in colours near one another, before a room of others, and the true silhouettes."""
    rng = np.random.default_rng(7)
    colours = np.vstack([rng.integers(30, 110, (len(truth.shapes), 3)), [150, 140, 130]]).astype(np.float64)
    images = painted(truth, colours, noise=10.0)
    return Sight(Frame(0, 0.0, images)), CpuSynthesis().silhouettes(truth)


EVIDENCE = LevelSetEvidence()


def asked(scene: Scene, sight: Sight, evidence: LevelSetEvidence = EVIDENCE, memory: object = None) -> Comparison:
    expected = CpuSynthesis().contours(scene)
    return Comparison(scene, 0, CpuSynthesis(), evidence.observe(sight, expected, memory))


def displaced(scene: Scene, off_deg: float, off_m: float) -> Scene:
    body, q = scene.persons[0].body, scene.persons[0].q
    return scene.with_pose(0, body.clamped(q + off(body, off_deg, off_m, seed=2)))


def known_of(scene: Scene, sight: Sight, evidence: LevelSetEvidence = EVIDENCE) -> object:
    trusted = np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
    return evidence.learned(None, sight, scene, CpuSynthesis().contours(scene), trusted)


@pytest.mark.parametrize("way", ["threshold_dynamics", "descent"])
def test_the_region_is_nearer_to_the_truth_than_the_pose_expected(truth, seen, way) -> None:
    """Learnt at the true pose, the contours start at poses 5 degrees and 3 cm off."""
    sight, masks = seen
    guess, evidence = displaced(truth, 5.0, 0.03), LevelSetEvidence(way=way)
    before = [overlap(one, mask) for one, mask in zip(CpuSynthesis().silhouettes(guess), masks, strict=True)]
    question = asked(guess, sight, evidence, known_of(truth, sight))
    found = evidence.regions(question.observed, guess)
    after = [overlap(one, mask) for one, mask in zip(found, masks, strict=True)]
    assert np.mean(before) < 0.8
    assert np.mean(after) > 0.9


def test_densities_of_a_wrong_start_are_mended_by_what_they_find(truth, seen) -> None:
    """EM: taught by a pose that is off, the region teaches better, three times over."""
    sight, masks = seen
    guess = displaced(truth, 5.0, 0.03)
    found = []
    for adaptations in (0, 3):
        evidence = LevelSetEvidence(adaptations=adaptations, shape=0.0, channels="colours")
        regions = evidence.regions(asked(guess, sight, evidence).observed, guess)
        found.append(np.mean([overlap(one, mask) for one, mask in zip(regions, masks, strict=True)]))
    assert found[1] > found[0] + 0.01


def test_a_guess_and_nothing_expected_are_not_confirmed(truth, seen) -> None:
    sight, _ = seen
    for expected, memory in ((None, None), (CpuSynthesis().contours(truth), GUESSED)):
        observed = EVIDENCE.observe(sight, expected, memory)
        question, q = Comparison(truth, 0, CpuSynthesis(), observed), truth.persons[0].q
        assert not EVIDENCE.distances(question, np.stack([q, q + 0.1])).any()
        assert EVIDENCE.equations(question, q, 10.0).total == 0


def test_doubtful_poses_teach_nothing(truth, seen) -> None:
    sight, _ = seen
    doubted = np.zeros((len(truth.rig), len(truth.shapes)), dtype=np.bool_)
    assert EVIDENCE.learned("known", sight, truth, CpuSynthesis().contours(truth), doubted) == "known"


def test_a_region_of_quite_another_size_is_not_believed(truth, seen) -> None:
    """Densities that call everything the person, as after a change of light."""
    sight, _ = seen
    everything = [replace(one, tables=one.tables[:, ::-1].copy()) for one in known_of(truth, sight)]
    question = asked(truth, sight, replace(EVIDENCE, shape=0.0), tuple(everything))
    assert replace(EVIDENCE, shape=0.0).regions(question.observed, truth) == (None,) * len(truth.rig)


def test_it_is_compared_as_a_foreground_is(truth, seen) -> None:
    """Distances, equations and accounts are those of silhouettes given the same regions."""
    sight, _ = seen
    question, q = asked(truth, sight), truth.persons[0].q
    given = replace(question, observed=SilhouetteEvidence().seen(*EVIDENCE.drawn(question.observed, truth)))
    np.testing.assert_array_equal(EVIDENCE.distances(question, q[None]), SilhouetteEvidence().distances(given, q[None]))
    mine, theirs = EVIDENCE.equations(question, q, 20.0), SilhouetteEvidence().equations(given, q, 20.0)
    np.testing.assert_array_equal(mine.matrix, theirs.matrix)
    account = EVIDENCE.account(question, q)
    assert account.explained > 0.9
    assert account.by_view_px is None  # a contour drawn from the pose hides nothing


@pytest.mark.parametrize("channels", ["appearance", "colours", "tensor"])
def test_a_limb_that_the_shape_alone_holds_counts_neither_for_nor_against(truth, channels) -> None:
    """The trunk stands out, the arm beside it looks as the wall does: the prior draws it, and the witness tells so."""
    mask = np.zeros((240, 320), dtype=np.bool_)
    mask[60:180, 100:160] = mask[80:104, 160:240] = True
    image = np.full((240, 320, 3), (90, 110, 100), dtype=np.uint8)
    image[60:180, 100:160] = (40, 40, 190)
    sight, evidence = Sight(Frame(0, 0.0, (image,))), LevelSetEvidence(channels=channels, shape=0.3)
    region, held = evidence._region(sight, 0, mask, None)
    assert overlap(region, mask) > 0.9
    assert held[86:98, 175:225].mean() > 0.9, "the arm"
    assert held[70:170, 105:150].mean() == 0, "the trunk"
    assert replace(evidence, witness=False)._region(sight, 0, mask, None)[1] is None


def test_coupled_rounds_look_again_at_the_pose_found(truth, seen) -> None:
    """From a pose so far off that the first contour is drawn to it; the second one is drawn to a better one."""
    sight, _ = seen
    guess = displaced(truth, 8.0, 0.05)
    body, wanted = truth.persons[0].body, truth.persons[0].q
    papers = LevelSetEvidence(shape=0.2, channels="colours", witness=False)
    both = TogetherEvidence(of=(papers,), ranking=(1.0,), refining=(1.0,))
    observed = both.observe(sight, CpuSynthesis().contours(guess), (known_of(truth, sight, papers),))
    objective = Objective(Comparison(guess, 0, CpuSynthesis(), observed), both)
    gaps = []
    for estimation in (TwistIcpEstimation(), CoupledEstimation(rounds=3)):
        q = estimation.estimate(objective, guess.persons[0].q[None]).q
        gaps.append(np.linalg.norm(np.subtract(*body.landmarks_in_world(np.stack([q, wanted]))), axis=1).mean())
    assert gaps[1] < gaps[0]
    assert gaps[1] < 0.03


def test_a_person_in_a_cluttered_room_is_cut_out(data) -> None:
    """R-UpperBody: from an outline 6 px wider and 4 px aside, against the exact mask (start 0.63)."""
    folder = data("room/R-UpperBody")
    video = cv2.VideoCapture(str(folder / "RIGHT.mp4"))
    ok, image = video.read()
    video.release()
    assert ok
    exact = cv2.imread(str(folder / "masks" / "RIGHT" / "0000.png"), cv2.IMREAD_GRAYSCALE) == 1
    small = cv2.resize(image, (360, 288), interpolation=cv2.INTER_AREA)
    mask = exact[::2, ::2]
    start = np.roll(cv2.dilate(mask.astype(np.uint8), np.ones((7, 7))) > 0, (2, 2), (0, 1))
    codes, near = (colour_codes(small),), signed_distance(start) > -20
    region = start
    for _ in range(3):
        known = densities(codes, region, near & ~region)
        assert known is not None
        odds = np.where(near, known.log_odds(codes), np.float32(-4))
        region = threshold_dynamics(start, Forces(odds, 3.0))
    assert overlap(region, mask) > max(0.8, overlap(start, mask) + 0.1)
