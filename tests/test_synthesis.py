"""Occluding contours: conics and brute-force ray casting as oracles, visibility, scale laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig_samples import FISHEYE
from rounding import SINGLE, assert_alike
from scipy.spatial import cKDTree
from solids import MIDDLE, MODELS, RIGS, SHAPES, camera_at, least, outline_errors, posed, solid, thing

from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Mask
from tracker.foundation.geometry.superquadrics import inside_outside
from tracker.kernels.projection import project_point
from tracker.synthesis.cpu import CpuSynthesis

ASIDE = Camera.looking_at("aside", (1280, 720), 500.0, (2.6, 0.3, 1.4), np.array([0.0, 3.2, 1.0]))
TALL = Camera.looking_at("tall", (1280, 720), 500.0, (2.6, -0.3, 1.4), MIDDLE)
CORNER = Rig((ASIDE, replace(TALL, size=(1280, 1440), matrix=TALL.matrix * [[1], [2], [1]])))
"""A view whose axis is 50 degrees off the persons, and one with pixels half as high as wide."""


@pytest.mark.parametrize("shear", [0.0, 7.0])
@pytest.mark.parametrize("lens", [(-0.3, 0.1, 0.003, -0.002, 0.02), FISHEYE])
def test_compiled_projection_is_that_of_the_camera(lens: tuple[float, ...], shear: float) -> None:
    matrix = np.array([[850.0, shear, 362.0], [0, 830.0, 280.0], [0, 0, 1]])
    camera = replace(camera_at(lens=lens), matrix=matrix)
    points = np.random.default_rng(3).uniform(-2, 2, (200, 3)) + MIDDLE
    row = Rig((camera,)).packed[0]
    found = np.array([project_point(row, *point) for point in points])
    np.testing.assert_allclose(found[:, :2], camera.project(points), atol=1e-9)
    np.testing.assert_allclose(found[:, 2], camera.in_camera(points)[:, 2], atol=1e-12)
    assert project_point(row, *(2 * camera.centre - MIDDLE))[:2] == (0.0, 0.0)


@pytest.mark.parametrize("name", ["sphere", "ellipsoid"])
def test_the_contour_of_an_ellipsoid_is_its_conic(name: str) -> None:
    """A quadric with dual matrix Q is imaged as the conic with dual matrix P Q P^T; so are normals and length."""
    camera, rng = camera_at(), np.random.default_rng(0)
    for _ in range(10):
        part = solid(name, rng)
        view = CpuSynthesis().contours(Scene((thing(part),), Rig((camera,)))).of(0)
        projection = camera.matrix @ camera.camera_from_world[:3] @ part.model_from_part
        dual = projection @ np.diag([*part.shape.size**2, -1.0]) @ projection.T
        conic = np.linalg.inv(dual / -dual[2, 2])
        pixels = np.concatenate([view.pixels, np.ones((len(view.parts), 1))], axis=1)
        slope = (pixels @ conic)[:, :2]
        steepness = np.linalg.norm(slope, axis=1)
        distance = (pixels @ conic * pixels).sum(axis=1) / (2 * steepness)
        assert np.abs(distance).max() < 0.2
        normal = slope / steepness[:, None] * np.sign((slope * view.normals).sum())
        turn = np.degrees(np.arccos((normal * view.normals).sum(axis=1).clip(-1, 1)))
        assert np.average(turn, weights=view.weights) < 1.5
        assert turn.max() < 8
        # A little short: chords of the outline are measured.
        assert -0.02 < view.weights.sum() / perimeter(conic) - 1 < 0.002


def perimeter(conic: Array) -> float:
    """Length of an ellipse given by its conic (3, 3), after Ramanujan, exact to 1e-4 at an axis ratio of 5."""
    form, linear = conic[:2, :2], conic[:2, 2]
    level = linear @ np.linalg.solve(form, linear) - conic[2, 2]
    a, b = np.sqrt(level / np.linalg.eigvalsh(form))
    return float(np.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b))))


@pytest.mark.parametrize("rig", ["narrow", "distorted", "fisheye"])
@pytest.mark.parametrize("name", SHAPES)
def test_contours_are_the_outlines_of_ray_casting(name: str, rig: str) -> None:
    rng = np.random.default_rng(0)
    errors, weights = [], []
    for _ in range(6):
        part = solid(name, rng)
        contours = CpuSynthesis().contours(Scene((thing(part),), RIGS[rig]))
        for v, camera in enumerate(RIGS[rig].cameras):
            view = contours.of(v)
            assert not view.between.any()
            assert (view.parts == 0).all()
            np.testing.assert_allclose(camera.project(view.points), view.pixels, atol=1e-3)
            errors.append(outline_errors(view, part, camera))
            weights.append(view.weights)
    rms = np.sqrt(np.average(np.concatenate(errors) ** 2, weights=np.concatenate(weights)))
    # A surface grid of 9 x 16 bends least evenly at the edges of a box.
    allowed_rms, allowed = (0.2, 0.8) if name == "box" else (0.1, 0.3)
    assert rms < allowed_rms
    assert np.abs(np.concatenate(errors)).max() < allowed


def test_a_finer_grid_is_closer_to_the_outline() -> None:
    rng, camera = np.random.default_rng(3), RIGS["narrow"].cameras[0]
    part = solid("torso", rng)
    scene = Scene((thing(part),), Rig((camera,)))
    coarse, fine = (
        outline_errors(CpuSynthesis(n_eta=n, n_omega=2 * n).contours(scene).of(0), part, camera) for n in (7, 21)
    )
    assert np.abs(fine).mean() < 0.3 * np.abs(coarse).mean()


@pytest.mark.parametrize("rig", ["narrow", "distorted", "fisheye"])
@pytest.mark.parametrize("name", ["ellipsoid", "torso", "limb"])
def test_image_normals_stand_on_the_outline(name: str, rig: str) -> None:
    """Beside a sample, along its tangent, the outline stays where it is to second order."""
    rng, camera = np.random.default_rng(2), RIGS[rig].cameras[0]
    slopes, weights = [], []
    for _ in range(6):
        part = solid(name, rng)
        view = CpuSynthesis().contours(Scene((thing(part),), Rig((camera,)))).of(0)
        tangents = view.normals[:, ::-1] * np.float32([-1, 1])
        sides = [replace(view, pixels=view.pixels + side * tangents) for side in (-2, 2)]
        left, right = (outline_errors(side, part, camera) for side in sides)
        slopes.append((right - left) / 4)
        weights.append(view.weights)
    turn = np.degrees(np.arctan(np.abs(np.concatenate(slopes))))
    assert np.average(turn, weights=np.concatenate(weights)) < 2
    assert turn.max() < 12


def scenes_for_visibility(kind: str) -> list[Scene]:
    rng = np.random.default_rng(7)
    if kind == "corner":
        return [Scene((person,), CORNER) for person in posed("gavrila22", 2, seed=3)]
    if kind == "pile":
        things = [thing(*(solid(name, rng, 0.35) for name in SHAPES)) for _ in range(4)]
    else:
        things = posed(kind, 4)
    return [Scene((person,), RIGS["wide" if i == 1 else "narrow"]) for i, person in enumerate(things)]


def among(points: Array32, others: Array32) -> Mask:
    """Which points (N, 3) are some of the others (M, 3), but for rounding."""
    near = SINGLE * float(np.abs(points).max(initial=0.0))
    return np.asarray(cKDTree(others).query(points)[0] <= near, dtype=np.bool_)


@pytest.mark.parametrize("kind", [*MODELS, "pile", "corner"])
def test_exactly_what_no_other_part_covers_is_drawn(kind: str) -> None:
    """Each part's contour, traced alone and tested by ray casting against the others, is what the tracer leaves."""
    n_samples = n_visible = 0
    doubtful = []
    for scene in scenes_for_visibility(kind):
        person = scene.persons[0]
        part_from_world = np.linalg.inv(scene.world_from_parts()[0])
        drawn = CpuSynthesis().contours(scene)
        for p, part in enumerate(person.body.parts):
            alone = replace(scene, persons=(replace(person, body=replace(person.body, parts=(part,))),))
            traced = CpuSynthesis().contours(alone)
            for v, camera in enumerate(scene.rig.cameras):
                points, view = traced.of(v).points, drawn.of(v)
                others = [q for q in range(len(part_from_world)) if q != p]
                values = [least(scene.shapes[q], part_from_world[q], camera.centre, points) for q in others]
                nearest = np.min(values, axis=0)
                drawn_points = view.points[view.parts == p]
                visible = among(points, drawn_points)
                assert visible.sum() == len(drawn_points)
                doubtful.append(nearest[visible != (nearest >= 1)])
                n_samples, n_visible = n_samples + len(points), n_visible + int(visible.sum())
    assert 0.2 < n_visible / n_samples < 0.8
    # Only rays that graze a part may be taken for the wrong side, and few of them.
    wrong = np.concatenate(doubtful)
    assert (np.abs(wrong - 1) < 0.15).all(), wrong
    assert len(wrong) < 0.004 * n_samples


def test_edges_between_touching_parts_are_marked() -> None:
    """Marked is what lies inside another part when moved outwards by the contact distance."""
    synthesis, n_marked, n_wrong = CpuSynthesis(contact_m=0.03), 0, 0
    for person in posed("gavrila22", 10):
        # near the reference pose the limbs hang beside the body
        q = np.where(person.body.rotates, 0.1, 1.0) * person.q
        scene = Scene((replace(person, q=q),), RIGS["narrow"])
        placed = scene.world_from_parts()[0]
        contours = synthesis.contours(scene)
        for v in range(len(scene.rig)):
            view = contours.of(v)
            np.testing.assert_array_equal(view.weights > 0, ~view.between)
            values = np.full(len(view.parts), 99.0)
            for p in np.unique(view.parts):
                mine = view.parts == p
                moved = view.points[mine] + 0.03 * surface_normals(scene.shapes[p], placed[p], view.points[mine])
                for q in set(range(len(placed))) - {int(p)}:
                    local = (moved - placed[q][:3, 3]) @ placed[q][:3, :3]
                    values[mine] = np.minimum(values[mine], inside_outside(scene.shapes[q], local))
            n_marked += int(view.between.sum())
            n_wrong += int(((values < 1) != view.between)[np.abs(values - 1) > 0.1].sum())
    assert n_marked > 100
    assert n_wrong <= 0.01 * n_marked


def surface_normals(shape: Array, placement: Array, points: Array) -> Array:
    """World normals (N, 3) of a part near its surface: the gradient of the inside-outside function."""
    local = (points - placement[:3, 3]) @ placement[:3, :3]
    step = 1e-6
    slope = [inside_outside(shape, local + d) - inside_outside(shape, local - d) for d in step * np.eye(3)]
    gradient = np.stack(slope, axis=1)
    normals: Array = gradient @ placement[:3, :3].T / np.linalg.norm(gradient, axis=1, keepdims=True)
    return normals


def test_without_contact_only_intersections_are_marked() -> None:
    rng = np.random.default_rng(4)
    apart = []
    for y in (-0.25, 0.25):
        placement = np.eye(4)
        placement[:3, 3] = 0, y, 1
        apart.append(replace(solid("ellipsoid", rng), model_from_part=placement))
    scene = Scene((thing(*apart),), RIGS["narrow"])
    assert not CpuSynthesis(contact_m=0.0).contours(scene).of(0).between.any()
    assert not CpuSynthesis(contact_m=0.05).contours(scene).of(0).between.any()
    assert CpuSynthesis(contact_m=0.15).contours(scene).of(0).between.any()


@pytest.mark.parametrize("name", MODELS)
def test_half_the_resolution_and_half_the_step_is_the_same_contour(name: str) -> None:
    scenes = [Scene((posed(name, 1)[0],), rig) for rig in (RIGS["distorted"], RIGS["distorted"].downscaled(2))]
    large, small = (CpuSynthesis(step_px=s).contours(x) for s, x in zip((8.0, 4.0), scenes, strict=True))
    for v in range(2):
        one, other = large.of(v), small.of(v)
        np.testing.assert_allclose(one.points, other.points, atol=1e-5)
        np.testing.assert_array_equal(one.between, other.between)
        np.testing.assert_allclose((one.pixels + 0.5) / 2 - 0.5, other.pixels, atol=1e-3)
        np.testing.assert_allclose(one.normals, other.normals, atol=1e-5)
        np.testing.assert_allclose(one.weights / 2, other.weights, atol=1e-3)


@pytest.mark.parametrize("size", [(720, 576), (1920, 1536)])
def test_a_finer_step_finds_the_same_contour_in_more_samples(size: tuple[int, int]) -> None:
    rig = Rig((Camera.looking_at("a", size, 1.2 * size[0], (5.2, 0.3, 2.3), MIDDLE),))
    scene = Scene((posed("gavrila22", 1)[0],), rig)
    coarse, fine = (CpuSynthesis(step_px=step).contours(scene).of(0) for step in (8.0, 2.0))
    for view, step in ((coarse, 8.0), (fine, 2.0)):
        assert 0 < view.weights.max() <= step
    assert len(fine.parts) > 2 * len(coarse.parts)
    n_parts = len(scene.shapes)
    lengths = [np.bincount(view.parts, view.weights, n_parts) for view in (coarse, fine)]
    assert lengths[0].sum() == pytest.approx(lengths[1].sum(), rel=0.02)
    np.testing.assert_allclose(*lengths, atol=0.02 * size[0])


def test_everybody_hides_everybody() -> None:
    """Parts are numbered through all persons; whose poses vary makes no difference; the one behind is hidden."""
    first, second = posed("gavrila22", 2)
    q = np.stack([second.q, second.q])
    q[:, :3] = np.add(first.q[:3], (0.3, 0.0, 0.0)), (30.0, 0.0, 1.0)
    q[:, 3:6] = 0.0
    scene = Scene((first, replace(second, q=q[0])), RIGS["narrow"])
    both, gone = CpuSynthesis().contours(scene, 1, q), CpuSynthesis().contours(replace(scene, persons=(first,)))
    n_parts = len(first.body.parts)
    for v in range(len(scene.rig)):
        assert_alike(both.of(v, 0).points, CpuSynthesis().contours(scene).of(v).points)
        alone = both.of(v, 1).parts < n_parts
        assert_alike(both.of(v, 1).points[alone], gone.of(v).points)
    swapped = CpuSynthesis().contours(replace(scene, persons=scene.persons[::-1]))
    for v in range(len(scene.rig)):
        one, other = both.of(v), swapped.of(v)
        assert among(one.points, other.points).all()
        assert among(other.points, one.points).all()
        renumbered = (other.parts + n_parts) % (2 * n_parts)
        np.testing.assert_array_equal(np.bincount(one.parts), np.bincount(renumbered))
    still_seen = sum(int((both.of(v).parts < n_parts).sum()) for v in range(len(scene.rig)))
    assert 20 < still_seen < gone.counts.sum() - 20


def test_samples_lie_in_the_image_and_before_the_camera() -> None:
    rng = np.random.default_rng(9)
    close = Camera.looking_at("close", (320, 240), 300.0, (1.2, 0.2, 1.1), MIDDLE)
    for person in posed("gavrila22", 10):
        for x in rng.uniform(-1, 3, 4):
            q = np.concatenate([[x], person.q[1:]])
            view = CpuSynthesis().contours(Scene((replace(person, q=q),), Rig((close,)))).of(0)
            assert (view.pixels >= -0.5).all()
            assert (view.pixels <= (319.5, 239.5)).all()
            assert (close.in_camera(view.points.astype(np.float64))[:, 2] > 0.05).all()
            assert np.isfinite(view.normals).all()
    behind = replace(person, q=np.concatenate([[9.0], person.q[1:]]))
    assert CpuSynthesis().contours(Scene((behind,), Rig((close,)))).counts.sum() == 0
    assert not CpuSynthesis().silhouettes(Scene((behind,), Rig((close,))))[0].any()


def test_no_pose_has_no_contour() -> None:
    scene = Scene((posed("gavrila22", 1)[0],), RIGS["narrow"])
    contours = CpuSynthesis().contours(scene, 0, np.zeros((0, 22)))
    assert (contours.n_poses, contours.n_views) == (0, 3)
