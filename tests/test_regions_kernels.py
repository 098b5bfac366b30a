"""Correspondence lines and their equations against plain twins, finite differences and painted truth."""

from __future__ import annotations

import numpy as np
import pytest
from observations import bent, four_views
from painted import RULE, colour_numbers, encoded, looks_of, painted, samples_of, scattered_tables

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Person, Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.kernels.regions import (
    EVEN,
    N_COLOURS,
    SPOTS,
    Lines,
    Looks,
    Picture,
    Samples,
    Tables,
    find_shifts,
    learn_lines,
    parts_beside,
    score_lines,
    shift_equations,
)
from tracker.synthesis.cpu import CpuSynthesis, _grids

COLOURS = np.random.default_rng(5).integers(20, 236, (40, 3)).astype(np.float64)


def half_extents(scene: Scene) -> Array:
    return np.ascontiguousarray(scene.shapes[:, :2].min(axis=1))


def beside_of(scene: Scene, contours: Contours) -> Integers:
    """What `parts_beside` finds at the scene's poses."""
    return all_beside(scene, scene.world_from_parts(), contours)[0]


def all_beside(scene: Scene, placements: Array, contours: Contours, grid: tuple[int, int] = (9, 16)) -> Integers:
    """What it finds with the parts at placements (B, P, 4, 4)."""
    found = np.full((*contours.parts.shape, 2), -5, dtype=np.int64)
    bounds = _grids(scene.shapes, *grid)[2]
    samples = contours.positions, contours.points, contours.parts, contours.counts
    parts_beside(placements, scene.shapes, bounds, scene.rig.packed, *samples, RULE.step_m, found)
    return found


def steps_px(rig: Rig, v: int, points: Array) -> Array:
    """Image size (N,) of `Rule.step_m` at world points (N, 3), at least a pixel."""
    camera = rig.cameras[v]
    steps: Array = np.maximum(camera.matrix[0, 0] * RULE.step_m / camera.in_camera(points)[:, 2], 1.0)
    return steps


@pytest.fixture(scope="module")
def contours(truth: Scene) -> Contours:
    return CpuSynthesis().contours(truth)


@pytest.fixture(scope="module")
def near(body: BodyModel) -> Scene:
    """A man whose arms are before the trunk in some views, larger in the images: a pixel is 4 mm."""
    return Scene((Person("one", body, bent(body)),), four_views((1080, 864)))


def test_the_part_beside_a_contour_is_the_one_a_picture_shows(near: Scene) -> None:
    contours = CpuSynthesis().contours(near)
    found = beside_of(near, contours)
    ids = CpuSynthesis().part_ids(near)
    right = total = on_parts = 0
    for v in range(len(near.rig)):
        view = contours.of(v)
        steps = steps_px(near.rig, v, view.points.astype(np.float64))
        for k, spot in enumerate(SPOTS):
            pixels = np.round(view.pixels + spot * steps[:, None] * view.normals).astype(np.int64)
            height, width = ids[v].shape
            kept = (view.weights > 0) & (pixels >= 0).all(axis=1) & (pixels < (width, height)).all(axis=1)
            shown = ids[v][pixels[kept, 1], pixels[kept, 0]]
            mine = found[v, : len(kept), k][kept]
            # At the end of its contour a part may itself be seen beside one of its samples.
            other = shown != view.parts[kept]
            right += int((mine == shown)[other].sum())
            on_parts += int((shown >= 0)[other].sum())
            total += int(other.sum())
    assert on_parts > 200
    assert right > 0.97 * total


def plain_shifts(image: Array, looks: Looks, rig: Rig, v: int, contours: Contours, beside: Integers) -> Array:
    """(N, 3) mean shift, information and support in view v, 0 without support; the twin of `find_shifts`."""
    view = contours.of(v)
    steps = steps_px(rig, v, view.points.astype(np.float64))
    radii = looks.half_extents[view.parts] * steps / RULE.step_m
    small = steps == 1.0
    depth = rig.cameras[v].in_camera(view.points.astype(np.float64))[:, 2]
    radii[small] = (looks.half_extents[view.parts] * rig.cameras[v].matrix[0, 0] / depth)[small]
    results = []
    for m in range(len(steps)):
        p = view.parts[m]
        places = np.arange(-10, 10) + 0.5
        pixels = view.pixels[m] + places[:, None] * steps[m] * view.normals[m]
        colour = colour_numbers(image, pixels)
        other = np.where(places < np.mean(SPOTS), beside[v, m, 0], beside[v, m, 1])
        share = looks.posteriors[v, p, colour].astype(np.float64)
        for s in np.flatnonzero(other >= 0):
            own, theirs = (looks.tables.inside[v, q, colour[s]] + RULE.floor for q in (p, other[s]))
            share[s] = 254 * np.clip(own / (own + theirs), 0.018, 0.982)
        share[(colour < 0) | (places * steps[m] < -1.7 * radii[m])] = 127
        inside = np.round(share) / 254
        lucky = (1 - RULE.slack) * inside + RULE.slack * (1 - inside)
        loss = [-np.log(np.where(places < d, lucky, 1 - lucky)).sum() for d in range(-7, 8)]
        chance = np.exp(np.min(loss) - loss)
        chance /= chance.sum()
        mean = chance @ np.arange(-7, 8)
        variance = (chance @ np.arange(-7, 8) ** 2 - mean**2 + 1 / 12) * steps[m] ** 2
        best = int(np.argmin(loss))
        held = share[best : best + 3].sum() > 420 and share[best + 3 : best + 6].sum() < 399
        found = [mean * steps[m], 1 / max(variance, 0.5), 1.0 if 0 < best < 14 else 0.3]
        results.append(found if held else [0.0, 0.0, 0.0])
    return np.array(results)


@pytest.mark.parametrize("size", [(360, 288), (1080, 864)])
def test_shifts_equal_their_plain_twin(truth: Scene, size: tuple[int, int]) -> None:
    scene = Scene(truth.persons, four_views(size))
    contours = CpuSynthesis().contours(scene)
    rng = np.random.default_rng(2)
    images = tuple(rng.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8) for _ in range(4))
    looks = looks_of(scattered_tables(4, len(scene.shapes)), half_extents(scene))
    looks.known[2, 1] = False
    beside = beside_of(scene, contours)
    wanted = np.ones(len(scene.shapes), dtype=np.bool_)
    wanted[3] = False
    shifts = np.full((*contours.parts.shape[1:], 3), np.nan, dtype=np.float32)
    picture, samples = encoded(images), samples_of(contours)
    find_shifts(picture, looks, samples, beside, scene.rig.packed, wanted, RULE, shifts)
    for v in range(4):
        view = contours.of(v)
        expected = plain_shifts(images[v], looks, scene.rig, v, contours, beside)
        used = (view.weights > 0) & wanted[view.parts] & looks.known[v, view.parts]
        assert used.sum() > 40
        # A place half a rounding error from the border of two pixels may read either.
        same = np.isclose(shifts[v, : len(used)], expected, atol=1e-3).all(axis=1)
        assert (same[used]).mean() > 0.97
        assert (shifts[v, : len(used)][~used] == 0).all()


def test_scores_equal_their_plain_twin(truth: Scene, body: BodyModel) -> None:
    rng = np.random.default_rng(3)
    poses = truth.persons[0].q + 0.1 * rng.normal(size=(3, body.dof))
    contours = CpuSynthesis().contours(truth, 0, poses)
    images = tuple(rng.integers(0, 256, (288, 360, 3), dtype=np.uint8) for _ in range(4))
    looks = looks_of(scattered_tables(4, len(truth.shapes)), half_extents(truth))
    misfits = np.zeros((3, 4, len(truth.shapes), 3))
    wanted = np.ones(len(truth.shapes), dtype=np.bool_)
    columns = contours.positions, contours.points, contours.parts, contours.counts
    beside = all_beside(truth, truth.world_from_parts(0, poses), contours)
    lines = Lines(encoded(images), looks, wanted, RULE)
    score_lines(lines, *columns, beside, truth.rig.packed, misfits)
    for b, v in np.ndindex(3, 4):
        view = contours.of(v, b)
        steps = steps_px(truth.rig, v, view.points.astype(np.float64))
        along = np.array([1.5, 3.5, 5.5, 7.5])
        expected = np.zeros((len(truth.shapes), 3))
        depth = truth.rig.cameras[v].in_camera(view.points.astype(np.float64))[:, 2]
        deep = 1.7 * looks.half_extents[view.parts] * truth.rig.cameras[v].matrix[0, 0] / depth
        for m, p in enumerate(view.parts):
            read = []
            for side in (-1, 1):
                pixels = view.pixels[m] + side * along[:, None] * steps[m] * view.normals[m]
                colour = colour_numbers(images[v], pixels)
                other = np.full(4, beside[b, v, m, 0])
                share = looks.posteriors[v, p, colour] / 254
                for s in np.flatnonzero(other >= 0):
                    own, theirs = (looks.tables.inside[v, q, colour[s]] + RULE.floor for q in (p, other[s]))
                    share[s] = np.clip(own / (own + theirs), 0.018, 0.982)
                share[colour < 0] = 0.5
                kept = (along * steps[m] < deep[m]) | (along == 1.5) if side < 0 else along > 0
                read.append(share[kept].mean())
            wrong = (1 - read[0] + read[1]) / 2
            expected[p] += view.weights[m] * np.array([1.0, wrong * 16 * steps[m], wrong < 0.45])
        np.testing.assert_allclose(misfits[b, v, :, 0], expected[:, 0], rtol=1e-6)
        np.testing.assert_allclose(misfits[b, v, :, 1:], expected[:, 1:], rtol=0.06, atol=60)


def learnt(scene: Scene, images: tuple[Array, ...]) -> tuple[Picture, Looks, Contours]:
    """Colours learnt at the true pose."""
    contours = CpuSynthesis().contours(scene)
    n_parts = len(scene.shapes)
    shape = len(scene.rig), n_parts, N_COLOURS
    tables = Tables(*np.zeros((2, *shape), dtype=np.float32), np.zeros((shape[0], N_COLOURS), dtype=np.float32))
    picture, samples, useful = encoded(images), samples_of(contours), valid(contours)
    changed = learn_lines(
        picture,
        samples,
        beside_of(scene, contours),
        scene.rig.packed,
        half_extents(scene),
        useful,
        RULE.step_m,
        0.15,
        np.full(shape, EVEN, dtype=np.uint8),
        tables,
    )
    looks = looks_of(tables, half_extents(scene))
    return picture, looks._replace(known=changed), contours


def valid(contours: Contours) -> Mask:
    """(V, M) samples of the first pose that are there and are matched."""
    there = np.arange(contours.parts.shape[2]) < contours.counts[0, :, None]
    found: Mask = there & (contours.positions[0, :, :, 4] > 0)
    return found


def moved(contours: Contours, distance_px: float) -> Contours:
    """Contours off by a distance along their normals."""
    positions = np.where(valid(contours)[None, ..., None], contours.positions, np.float32(0))
    positions[..., :2] += np.float32(distance_px) * positions[..., 2:4]
    return Contours(positions, contours.points, contours.parts, contours.between, contours.counts)


@pytest.mark.parametrize("distance_px", [-4.0, 0.0, 3.0])
def test_lines_find_how_far_a_contour_is_off(near: Scene, distance_px: float) -> None:
    picture, looks, contours = learnt(near, painted(near, COLOURS[: len(near.shapes) + 1], noise=8.0))
    shifts = np.zeros((*contours.parts.shape[1:], 3), dtype=np.float32)
    wanted = np.ones(len(near.shapes), dtype=np.bool_)
    samples = samples_of(moved(contours, distance_px))
    find_shifts(picture, looks, samples, beside_of(near, contours), near.rig.packed, wanted, RULE, shifts)
    sure = shifts[..., 2] == 1.0
    assert sure.sum() > 0.7 * valid(contours).sum()
    errors = shifts[sure, 0] + distance_px
    # Places are read at whole pixels, of a picture drawn in whole pixels: the contour is known to a place, 1 to 1.3 px.
    assert np.abs(np.median(errors)) < 0.5
    assert np.percentile(np.abs(errors), 90) < 1.3


def test_an_arm_before_the_trunk_is_seen_against_the_trunk(near: Scene) -> None:
    """Its lines tell where it ends, though the background beside the trunk looks like the arm."""
    n_parts = len(near.shapes)
    colours = COLOURS[: n_parts + 1].copy()
    arms = [k for k, part in enumerate(near.persons[0].body.parts) if "arm" in part.name]
    colours[-1] = colours[arms] = (60, 90, 150)
    picture, looks, contours = learnt(near, painted(near, colours, noise=8.0))
    beside, wanted = beside_of(near, contours), np.isin(np.arange(n_parts), arms)
    parts = np.where(valid(contours), contours.parts[0], 0)
    before = valid(contours) & (beside[..., 0] >= 0) & wanted[parts] & ~np.isin(beside[..., 0], arms)
    sure = {}
    for name, sides in (("part", beside), ("background", np.full_like(beside, -1))):
        shifts = np.zeros((*contours.parts.shape[1:], 3), dtype=np.float32)
        samples = samples_of(moved(contours, 2.0))
        find_shifts(picture, looks, samples, sides, near.rig.packed, wanted, RULE, shifts)
        good = (shifts[..., 2] == 1.0) & (np.abs(shifts[..., 0] + 2.0) < 1.5)
        sure[name] = good[before].mean()
    assert before.sum() > 20
    assert sure["part"] > 0.7
    assert sure["background"] < 0.5 * sure["part"]


def test_scores_tell_the_true_pose(near: Scene, body: BodyModel) -> None:
    picture, looks, _ = learnt(near, painted(near, COLOURS[: len(near.shapes) + 1], noise=8.0))
    q = near.persons[0].q
    off = np.random.default_rng(4).choice([-1, 1], (20, body.dof)) * np.where(body.rotates, np.radians(6), 0.02)
    poses = np.concatenate([q[None], q + off])
    contours = CpuSynthesis().contours(near, 0, poses)
    beside = all_beside(near, near.world_from_parts(0, poses), contours)
    misfits = np.zeros((21, 4, len(near.shapes), 3))
    columns = contours.positions, contours.points, contours.parts, contours.counts
    wanted = np.ones(len(near.shapes), dtype=np.bool_)
    score_lines(Lines(picture, looks, wanted, RULE), *columns, beside, near.rig.packed, misfits)
    wrong = misfits[..., 1].sum(axis=(1, 2)) / misfits[..., 0].sum(axis=(1, 2))
    explained = misfits[..., 2].sum(axis=(1, 2)) / misfits[..., 0].sum(axis=(1, 2))
    assert wrong.argmin() == 0
    assert explained.argmax() == 0
    assert explained[0] > 0.8


@pytest.mark.parametrize("group", ["torso_head", "left_arm", "right_leg"])
@pytest.mark.parametrize("known", [True, False])
def test_a_limb_that_moves_alone_is_scored_as_pose_by_pose(
    near: Scene, body: BodyModel, group: str, known: bool
) -> None:
    """Two persons, one of them hides the other; lines of parts that stand still are read once, with the same result."""
    other = near.persons[0].q.copy()
    other[:2] += 0.35, 0.1
    both = Scene((*near.persons, Person("two", body, other)), near.rig)
    colours = np.random.default_rng(6).integers(20, 236, (len(both.shapes) + 1, 3)).astype(np.float64)
    picture, looks, _ = learnt(both, painted(both, colours, noise=8.0))
    looks.known[1, len(body.parts) + 3] = False
    columns = body.group(group)
    poses = np.tile(other, (40, 1))
    poses[:, columns] += np.random.default_rng(7).normal(size=(40, len(columns))) * np.where(
        body.rotates[columns], 0.6, 0.1
    )
    poses = body.clamped(poses)
    wanted = np.arange(len(both.shapes)) >= len(body.parts)
    lines, synthesis = Lines(picture, looks, wanted, RULE), CpuSynthesis()
    together = synthesis.region_misfits(both, 1, poses, lines)
    alone = np.concatenate([synthesis.region_misfits(both, 1, q[None], lines) for q in poses])
    np.testing.assert_allclose(together, alone, rtol=1e-12)
    drawn, plain = synthesis.contours(both, 1, poses, coarse=True), np.zeros_like(together)
    beside = all_beside(both, both.world_from_parts(1, poses), drawn, grid=(6, 12))
    score_lines(lines, drawn.positions, drawn.points, drawn.parts, drawn.counts, beside, both.rig.packed, plain)
    np.testing.assert_allclose(together, plain, rtol=1e-9)
    assert not together[:, :, ~wanted].any()
    assert len(np.unique(together[..., 1].sum(axis=(1, 2)))) == 40


def residuals(samples: Samples, targets: Array, scene: Scene, q: Array) -> Array:
    """Distances (K,) px along the normals of samples, carried by their parts to a pose, from where they should be."""
    body, start = scene.persons[0].body, scene.persons[0].q
    moving = body.world_from_part(q) @ np.linalg.inv(body.world_from_part(start))
    found = []
    for v, camera in enumerate(scene.rig.cameras):
        for m in range(samples.counts[v]):
            motion, point = moving[samples.parts[v, m]], samples.points[v, m].astype(np.float64)
            pixel = camera.project(motion[:3, :3] @ point + motion[:3, 3])
            found.append((pixel - targets[v, m]) @ samples.positions[v, m, 2:4].astype(np.float64))
    return np.array(found)


def test_equations_are_those_of_finite_differences(truth: Scene, contours: Contours, body: BodyModel) -> None:
    rng = np.random.default_rng(6)
    samples, scene = samples_of(contours), truth
    shifts = rng.uniform(0.2, 2.0, (*contours.parts.shape[1:], 3)).astype(np.float32)
    shifts[..., 0] *= rng.choice([-1, 1], shifts.shape[:2])
    shifts[:, ::7, 2] = 0
    q = scene.persons[0].q
    matrix, vector, squares, total = shift_equations(
        shifts, samples, body.part_parameters, scene.rig.packed, body.twists(q), body.moves, 16.0
    )
    there = np.arange(shifts.shape[1]) < samples.counts[:, None]
    points = np.where(there[..., None], samples.points, 0).astype(np.float64)
    positions = np.where(there[..., None], samples.positions, 0).astype(np.float64)
    pixels = np.stack([camera.project(points[v]) for v, camera in enumerate(scene.rig.cameras)])
    targets = pixels + shifts[..., :1] * positions[..., 2:4]
    weights = (positions[..., 4] / 16.0 * shifts[..., 1] * shifts[..., 2])[there]
    step = 1e-5
    residual = residuals(samples, targets, scene, q)
    jacobian = np.stack(
        [
            (residuals(samples, targets, scene, q + d) - residuals(samples, targets, scene, q - d)) / (2 * step)
            for d in step * np.eye(body.dof)
        ],
        axis=1,
    )
    np.testing.assert_allclose(matrix, jacobian.T @ (weights[:, None] * jacobian), rtol=1e-4, atol=1e-3 * matrix.max())
    np.testing.assert_allclose(vector, jacobian.T @ (weights * residual), rtol=1e-3, atol=1e-4 * np.abs(vector).max())
    assert squares == pytest.approx(weights @ residual**2, rel=1e-4)
    assert total == pytest.approx(weights.sum(), rel=1e-5)
    assert np.linalg.matrix_rank(matrix) > 15
