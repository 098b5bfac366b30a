"""Contours of skins: superquadrics made into meshes, rasterization and finite differences as oracles."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rounding import assert_alike
from solids import RIGS, outline_errors, posed, solid, thing

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.contours import Contours, ViewContours
from tracker.bodies.scene import Person, Scene
from tracker.bodies.skin import Skin
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.geometry.superquadrics import meshes_of
from tracker.foundation.resources import model_path
from tracker.kernels.pictures import rasterize
from tracker.synthesis.cpu import CpuSynthesis

CPU = CpuSynthesis()


def meshed(body: BodyModel, n_eta: int = 17, n_omega: int = 28) -> BodyModel:
    """A body whose skin is the mesh of its parts."""
    meshes = meshes_of(body.shapes, n_eta, n_omega)
    n_parts, n_points = meshes.points.shape[:2]
    points = np.einsum("pij,pnj->pni", body.model_from_parts[:, :3, :3], meshes.points)
    points = points + body.model_from_parts[:, None, :3, 3]
    faces = (meshes.triangles + n_points * np.arange(n_parts)[:, None, None]).reshape(-1, 3)
    weights = np.eye(n_parts).repeat(n_points, axis=0)
    return replace(body, skin=Skin(points.reshape(-1, 3), faces, weights, np.linalg.inv(body.model_from_parts)))


def smooth(body: BodyModel, width_m: float = 0.06) -> BodyModel:
    """The same with weights that fall off over the distance to the parts."""
    assert body.skin is not None
    centres = body.model_from_parts[:, :3, 3]
    gaps = np.linalg.norm(body.skin.points[:, None] - centres, axis=2)
    near = np.exp(-((gaps - gaps.min(axis=1, keepdims=True)) ** 2) / width_m**2)
    return replace(body, skin=replace(body.skin, weights=body.skin.weights + near))


@pytest.fixture(scope="module")
def people() -> list[Person]:
    return [replace(one, body=meshed(one.body)) for one in posed("gavrila22", 2, seed=4)]


def bare(person: Person) -> Person:
    return replace(person, body=replace(person.body, skin=None))


def nearest(one: ViewContours, other: ViewContours) -> tuple[Array, Array]:
    """Of the samples of one that are matched: distances along normals, px, and turns, degrees, to the other."""
    pixels, normals = one.pixels[~one.between], one.normals[~one.between]
    gaps = np.linalg.norm(pixels[:, None] - other.pixels, axis=2)
    same = (normals @ other.normals.T) > 0.5
    gaps = np.where(same, gaps, np.inf)
    k = gaps.argmin(axis=1)
    found = gaps.min(axis=1) < 12
    across = ((pixels - other.pixels[k]) * other.normals[k]).sum(axis=1)
    turns = np.degrees(np.arccos(np.clip((normals * other.normals[k]).sum(axis=1), -1, 1)))
    return np.where(found, np.abs(across), np.inf), np.where(found, turns, np.inf)


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("name", ["ellipsoid", "limb", "torso"])
def test_the_contour_of_a_meshed_solid_is_its_outline(name: str, rig: str) -> None:
    rng = np.random.default_rng(2)
    part = solid(name, rng, spread=0.3)
    person = thing(part)
    scene = Scene((replace(person, body=meshed(person.body)),), RIGS[rig])
    found, own = CPU.contours(scene), CPU.contours(Scene((person,), RIGS[rig]))
    for v, camera in enumerate(RIGS[rig].cameras):
        view = found.of(v)
        errors = outline_errors(view, part, camera)
        # 13 degrees of turn between two vertices, bent: what is left is of fourth order
        assert np.abs(errors).mean() < 0.03
        assert np.abs(errors).max() < 0.2
        assert not view.between.any()
        # a sample is 8 px, and those left over at the end are not made; seen end-on from nearby the torso's own bulge
        # hides more (`visibility._COVERED_M`), with the lens of these views as without it
        if rig == "fisheye":
            continue
        assert view.weights.sum() == pytest.approx(own.of(v).weights.sum(), abs=17)


def test_a_skin_made_of_the_parts_has_their_contours(people: list[Person]) -> None:
    dense = CpuSynthesis(step_px=1.5)
    for person in people:
        scenes = [Scene((one,), RIGS["narrow"]) for one in (person, bare(person))]
        for scene, reference in (scenes, scenes[::-1]):
            found, expected = CPU.contours(scene), dense.contours(reference)
            for v in range(found.n_views):
                across, turns = nearest(found.of(v), expected.of(v))
                assert np.median(across) < 0.1
                assert np.median(turns) < 2
                # the rest is where parts run through one another, or near the end of a contour
                assert (across < 1).mean() > 0.8


def depth_picture(person: Person, scene: Scene, v: int) -> Array:
    """Oracle: depth (H, W) of the skin by rasterization, infinite where there is nothing."""
    assert person.body.skin is not None
    points = person.body.skin.world_points(person.body.world_from_part(person.q))
    camera = scene.rig.cameras[v]
    buffers = np.zeros((*camera.size[::-1], 4), dtype=np.float32)
    rasterize(camera.project(points), camera.in_camera(points)[:, 2], person.body.skin.faces, (0, 0), buffers)
    depths: Array = np.where(buffers[..., 0] > 0, 1 / np.maximum(buffers[..., 0], 1e-9), np.inf)
    return depths


def test_silhouettes_and_contours_are_those_of_a_rasterization(people: list[Person]) -> None:
    for person in people:
        scene = Scene((person,), RIGS["narrow"])
        contours, masks = CPU.contours(scene), CPU.silhouettes(scene)
        ids = CPU.part_ids(scene)
        for v, mask in enumerate(masks):
            depths = depth_picture(person, scene, v)
            truth: Mask = np.isfinite(depths)
            assert (mask != truth).sum() < 10
            assert ((ids[v] >= 0) != truth).sum() < 10
            view = contours.of(v)
            outside = np.rint(view.pixels + 1.5 * view.normals).astype(int).clip(0, np.array(mask.shape)[::-1] - 1)
            depth = scene.rig.cameras[v].in_camera(view.points)[:, 2]
            beside = depths[outside[:, 1], outside[:, 0]]
            # nothing in front of a contour, and nothing touching it that is not said to
            assert (beside < depth - 0.06).mean() < 0.02
            assert (beside[~view.between] > depth[~view.between] + 0.01).mean() > 0.93
            # every piece of the silhouette's outline has a sample
            rim = mask & ~cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
            rows, columns = np.nonzero(rim[2:-2, 2:-2])
            gaps = np.linalg.norm(np.stack([columns + 2, rows + 2], axis=1)[:, None] - view.pixels, axis=2).min(axis=1)
            assert (gaps < 12).mean() > 0.97


@pytest.mark.parametrize("blend", [False, True])
def test_the_surface_moves_as_the_twists_say(people: list[Person], blend: bool) -> None:
    """Finite differences of all vertices against the Jacobians of the parts that move them, by their weights."""
    person = people[0]
    body = smooth(person.body) if blend else person.body
    assert body.skin is not None
    q, step = person.q, 1e-6
    points = body.skin.world_points(body.world_from_part(q))
    placed = body.world_from_part(q) @ body.skin.part_from_rest
    expected = np.zeros((len(points), 3, body.dof))
    for p in range(len(body.parts)):
        rigid = body.skin.points @ placed[p, :3, :3].T + placed[p, :3, 3]
        jacobian = body.point_jacobian(q, rigid, np.full(len(rigid), body.part_parameters[p]))
        expected += body.skin.weights[:, p, None, None] * jacobian
    for k in range(body.dof):
        ahead, back = q.copy(), q.copy()
        ahead[k] += step
        back[k] -= step
        moved = body.skin.world_points(body.world_from_part(ahead)) - body.skin.world_points(body.world_from_part(back))
        np.testing.assert_allclose(moved / (2 * step), expected[..., k], atol=2e-7)


@pytest.mark.parametrize("name", ["torso_x", "torso_twist", "left_arm_abduction", "right_leg_elevation"])
def test_contours_move_as_their_points_do(people: list[Person], name: str) -> None:
    """A contour moves along its normal as the surface point does (the reason for point-to-normal residuals)."""
    person, camera = people[1], RIGS["narrow"].cameras[0]
    body, scene, k = person.body, Scene((person,), RIGS["narrow"]), person.body.index(name)
    fine = CpuSynthesis(step_px=1.0)
    one = fine.contours(scene).of(0)
    jacobian = body.point_jacobian(person.q, one.points.astype(float), body.part_parameters[one.parts])
    across = np.einsum("ni,nij->nj", one.normals, camera.project_jacobian(one.points.astype(float)))
    slope = np.einsum("nj,nj->n", across, jacobian[:, :, k])
    step = 2.0 / np.abs(slope).max()
    after = person.q + step * np.eye(body.dof)[k]
    other = fine.contours(scene, 0, after[None]).of(0)
    gaps = np.linalg.norm(one.pixels[:, None] - other.pixels, axis=2)
    gaps = np.where((one.normals @ other.normals.T > 0.97) & (one.parts[:, None] == other.parts), gaps, np.inf)
    nearby = gaps.argmin(axis=1)
    good = (gaps.min(axis=1) < 4) & (np.abs(step * slope) > 0.5) & ~one.between
    assert good.sum() > 40
    measured = ((other.pixels[nearby] - one.pixels) * one.normals).sum(axis=1)
    assert np.median(np.abs(measured - step * slope)[good]) < 0.1


def test_a_batch_is_a_loop(people: list[Person]) -> None:
    scene = Scene(tuple(people), RIGS["narrow"])
    poses = np.stack([people[0].q, people[1].q])
    together = CPU.contours(scene, 0, poses)
    for b, q in enumerate(poses):
        alone = CPU.contours(scene.with_pose(0, q))
        for v in range(together.n_views):
            assert_alike(together.of(v, b).pixels, alone.of(v).pixels)
            np.testing.assert_array_equal(together.of(v, b).parts, alone.of(v).parts)


def test_persons_with_and_without_a_skin_hide_one_another(people: list[Person]) -> None:
    """Contours of the two are those of both without skins, up to the difference of skins and parts."""
    # a thigh raised by 167 degrees lies in the trunk, where a skin has lines that parts have not
    raised, body = people[0].q.copy(), people[0].body
    raised[[body.index(f"{side}_leg_elevation") for side in ("left", "right")]] /= 2
    person, behind = replace(people[0], q=raised), raised.copy()
    behind[1] += 0.35
    other = Person("other", bare(person).body, behind)
    mixed, plain = Scene((person, other), RIGS["narrow"]), Scene((bare(person), other), RIGS["narrow"])
    found, expected = CPU.contours(mixed), CPU.contours(plain)
    n_own = len(other.body.parts)
    for v in range(found.n_views):
        for first in (True, False):
            lengths = [view.weights[(view.parts < n_own) == first].sum() for view in (found.of(v), expected.of(v))]
            assert lengths[0] == pytest.approx(lengths[1], rel=0.12)
        assert np.median(nearest(found.of(v), expected.of(v))[0]) < 0.15
    assert [mask.sum() for mask in CPU.silhouettes(mixed)] == pytest.approx(
        [mask.sum() for mask in CPU.silhouettes(plain)], rel=0.01
    )


def test_searches_live_on_the_parts(people: list[Person]) -> None:
    scene = Scene((people[0],), RIGS["narrow"])
    one, other = (CPU.contours(own, coarse=True) for own in (scene, Scene((bare(people[0]),), RIGS["narrow"])))
    assert_alike(one.positions[0, 0, :10], other.positions[0, 0, :10])


def test_open_borders_are_contours() -> None:
    """A tube without ends, as a scanned sleeve: its rims seen from outside count, its inner side does not."""
    around, along = np.linspace(0, 2 * np.pi, 33)[:-1], np.linspace(0.7, 1.3, 9)
    points = np.array([[0.1 * np.cos(a), 0.1 * np.sin(a), z] for z in along for a in around])
    k, n = np.meshgrid(np.arange(8), np.arange(32), indexing="ij")
    a, b = k * 32 + n, k * 32 + (n + 1) % 32
    faces = np.concatenate([np.stack([a, b, a + 32], axis=-1), np.stack([b, b + 32, a + 32], axis=-1)]).reshape(-1, 3)
    person = thing(solid("sphere", np.random.default_rng(0)))
    skin = Skin(points, faces, np.ones((len(points), 1)), np.linalg.inv(person.body.model_from_parts))
    assert len(skin.borders) == 64
    scene = Scene((replace(person, body=replace(person.body, skin=skin)),), RIGS["narrow"])
    view = CPU.contours(scene).of(0)
    heights = view.points[:, 2]
    rims = (np.abs(heights - 1.3) < 1e-6) | (np.abs(heights - 0.7) < 1e-6)
    assert rims.any()
    assert not rims.all()
    # of the upper rim, seen from above, the nearer half borders on faces seen from outside
    toward = RIGS["narrow"].cameras[0].centre[:2]
    assert (view.points[rims][:, :2] @ toward > -0.03 * np.linalg.norm(toward)).all()
    assert np.linalg.norm(view.normals, axis=1) == pytest.approx(np.ones(len(view.parts)), abs=1e-5)


def test_a_smooth_skin_of_a_bundled_model_is_traced_in_all_views() -> None:
    body = smooth(meshed(load_body(model_path("upper21"))))
    q = body.rest()
    q[2] = 0.9
    found: Contours = CPU.contours(Scene((Person("one", body, q),), RIGS["distorted"]))
    assert (found.counts > 80).all()
