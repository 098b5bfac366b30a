"""Renderers of part numbers: held against the z-buffer, against each other and against the contour tracer."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from observations import bent, four_views, ideal
from renderers import working
from rig_samples import FISHEYE
from scipy.spatial import cKDTree

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Person, Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.errors import RenderError
from tracker.images.sight import Observation
from tracker.kernels.contours import directed_distances
from tracker.kernels.pictures import id_contours
from tracker.synthesis import _atlas
from tracker.synthesis._pictures import rasterized_ids
from tracker.synthesis.cpu import FINEST, CpuSynthesis
from tracker.synthesis.egl import EglSynthesis
from tracker.synthesis.osmesa import OsmesaSynthesis

LENS = np.array([-0.2, 0.08, 0.001, -0.002, 0.0])
THETA = 40.0
RENDERERS = ("egl", "osmesa")
KINDS = ("plain", "distorted", "two persons")


@pytest.fixture
def renderer(request: pytest.FixtureRequest, truth: Scene) -> Any:
    """The renderer that a test is run for."""
    return working(request.param, truth)


@pytest.fixture
def egl(truth: Scene) -> EglSynthesis:
    found: EglSynthesis = working("egl", truth)
    return found


@pytest.fixture
def osmesa(truth: Scene) -> OsmesaSynthesis:
    found: OsmesaSynthesis = working("osmesa", truth)
    return found


each_renderer = pytest.mark.parametrize("renderer", RENDERERS, indirect=True)


@pytest.fixture(scope="module")
def scenes(truth: Scene) -> dict[str, Scene]:
    """One person, one before distorting, fisheye and shearing lenses of images of several sizes, two who overlap."""
    first, second, third, *others = truth.rig.cameras
    sheared = second.matrix + 5.0 * np.outer((1, 0, 0), (0, 1, 0))
    bowed = replace(first, distortion=LENS), replace(second, distortion=-0.5 * LENS, matrix=sheared, size=(340, 300))
    q = np.array(truth.persons[0].q)
    q[:2] += -0.4, 0.2
    return {
        "plain": truth,
        "distorted": Scene(truth.persons, Rig((*bowed, replace(third, distortion=np.array(FISHEYE)), *others))),
        "two persons": Scene((*truth.persons, Person("two", truth.persons[0].body, q)), truth.rig),
    }


def near_boundary(ids: Integers) -> Mask:
    """Pixels with another part within a pixel."""
    numbers = ids.astype(np.float32)
    square = np.ones((3, 3), np.uint8)
    changes: Mask = cv2.dilate(numbers, square) != cv2.erode(numbers, square)
    return changes


@each_renderer
@pytest.mark.parametrize("kind", KINDS)
def test_part_numbers_are_those_of_the_z_buffer(kind: str, renderer: Any, scenes: dict[str, Scene]) -> None:
    scene = scenes[kind]
    wanted = rasterized_ids(scene, renderer.n_eta, renderer.n_omega)
    masks = renderer.silhouettes(scene)
    # pyrender's distorted views are looked up in undistorted ones, to the nearest of four pixels
    allowed = 0.03 if kind == "distorted" else 0.002
    for ids, reference, mask, camera in zip(renderer.part_ids(scene), wanted, masks, scene.rig.cameras, strict=True):
        assert ids.shape == reference.shape == camera.size[::-1]
        assert set(np.unique(reference)) <= {-1, *range(len(scene.shapes))}
        wrong = ids != reference
        assert not wrong[~near_boundary(reference)].any()
        assert wrong.sum() <= allowed * (reference >= 0).sum()
        np.testing.assert_array_equal(mask, ids >= 0)


@pytest.mark.parametrize("kind", KINDS)
def test_parts_drawn_row_by_row_are_those_of_the_z_buffer(kind: str, scenes: dict[str, Scene]) -> None:
    """Of every distance, lens and body, and of who is behind cameras or beside their images."""
    scene = scenes[kind]
    first = scene.persons[0].q
    for shift in (np.zeros(2), np.array([5.0, 5.0]), np.array([60.0, 0.0])):
        q = first.copy()
        q[:2] += shift
        moved = scene.with_pose(0, q)
        for ids, reference in zip(CpuSynthesis().part_ids(moved), rasterized_ids(moved, *FINEST), strict=True):
            assert ids.shape == reference.shape
            wrong = ids != reference
            assert not wrong[~near_boundary(reference)].any()
            assert wrong.sum() <= 0.0005 * (reference >= 0).sum()


def test_two_renderers_that_share_no_code_see_the_same(
    egl: EglSynthesis, osmesa: OsmesaSynthesis, truth: Scene
) -> None:
    for one, reference in zip(egl.part_ids(truth), osmesa.part_ids(truth), strict=True):
        assert (one != reference).sum() <= 0.001 * (reference >= 0).sum()


def test_who_is_not_in_the_picture_is_not_drawn(
    egl: EglSynthesis, osmesa: OsmesaSynthesis, truth: Scene, observation: Observation
) -> None:
    """A person behind two cameras and before two, and one beside all images."""
    q = np.array([truth.persons[0].q] * 3)
    q[1:, :2] = (5.0, 5.0), (60.0, 0.0)
    for renderer in (egl, osmesa):
        for pose in q[1:]:
            scene = truth.with_pose(0, pose)
            for ids, reference in zip(renderer.part_ids(scene), rasterized_ids(scene, 17, 32), strict=True):
                assert abs(int((ids >= 0).sum()) - int((reference >= 0).sum())) < 5
        assert (renderer.contours(truth, 0, q).counts[2] == 0).all()
    np.testing.assert_allclose(egl.directed_distances(truth, 0, q, observation, THETA, False)[2], THETA)
    assert egl.directed_distances(truth, 0, q[:0], observation, THETA, False).shape == (0, 4, 2)
    assert egl.contours(truth, 0, q[:0]).counts.shape == (0, 4)


def boundaries(ids: Integers) -> tuple[Array, Mask]:
    """Middles (N, 2) px of the sides of pixels at which the part changes, and whether one side is background."""
    found, outer = [], []
    for axis in range(2):
        one, other = (ids[:, :-1], ids[:, 1:]) if axis == 0 else (ids[:-1], ids[1:])
        rows, columns = np.nonzero(one != other)
        found.append(np.stack([columns + 0.5 * (axis == 0), rows + 0.5 * (axis == 1)], axis=-1))
        outer.append(np.minimum(one, other)[rows, columns] < 0)
    return np.concatenate(found), np.concatenate(outer)


@each_renderer
@pytest.mark.parametrize("kind", KINDS)
def test_traced_contours_lie_where_part_numbers_change(kind: str, renderer: Any, scenes: dict[str, Scene]) -> None:
    scene = scenes[kind]
    traced = CpuSynthesis(step_px=2.0).contours(scene)
    for v, ids in enumerate(renderer.part_ids(scene)):
        view, (sides, outer) = traced.of(v), boundaries(ids)
        gaps = cKDTree(sides).query(view.pixels[~view.between])[0]
        assert np.quantile(gaps, 0.99) < 1
        assert gaps.max() < 1.5
        # where touching parts meet, the tracer draws nothing
        assert cKDTree(view.pixels).query(sides[outer])[0].max() < 2.5


@each_renderer
@pytest.mark.parametrize("kind", KINDS)
def test_contours_of_pictures_are_those_of_the_tracer(kind: str, renderer: Any, scenes: dict[str, Scene]) -> None:
    scene = scenes[kind]
    found, traced = renderer.contours(scene), CpuSynthesis(step_px=1.0, n_eta=17, n_omega=32).contours(scene)
    for v, camera in enumerate(scene.rig.cameras):
        mine, theirs = found.of(v), traced.of(v)
        np.testing.assert_allclose(camera.project(mine.points.astype(np.float64)), mine.pixels, atol=1e-3)
        off, turn, share = deviation(mine, theirs)
        assert share > 0.97
        assert abs(off.mean()) < 0.2
        assert np.abs(off).max() < 1.5
        assert off.std() < 0.35
        assert turn.mean() < 9
        assert mine.weights.sum() == pytest.approx(theirs.weights.sum(), rel=0.1)


def deviation(view: ViewContours, reference: ViewContours) -> tuple[Array, Array, float]:
    """How far outwards (N,) px and how much turned (N,) degrees matched samples are; the share that has a partner."""
    nearest = np.full(len(view.parts), -1)
    for part in np.unique(view.parts):
        own, theirs = view.parts == part, np.flatnonzero(reference.parts == part)
        if len(theirs):
            gaps, rows = cKDTree(reference.pixels[theirs]).query(view.pixels[own])
            nearest[own] = np.where(np.asarray(gaps) < 2, theirs[rows], -1)
    matched = ~view.between
    share = float((nearest[matched] >= 0).mean())
    rows = np.flatnonzero(matched & (nearest >= 0))
    gaps, normals = view.pixels[rows] - reference.pixels[nearest[rows]], reference.normals[nearest[rows]]
    turn = np.degrees(np.arccos((view.normals[rows] * normals).sum(axis=1).clip(-1, 1)))
    return (gaps * normals).sum(axis=1), turn, share


@pytest.mark.parametrize("radius", [6.0, 20.3])
def test_a_disc_has_a_round_contour(radius: float) -> None:
    centre, size = np.array([30.4, 33.7]), (70, 64)
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    gap = np.hypot(columns - centre[0], rows - centre[1])
    ids, depths = np.where(gap < radius, 0, -1), np.full(gap.shape, 3.0, dtype=np.float32)
    view = traced_picture(ids, depths, size)
    out = view.pixels - centre
    distance = np.linalg.norm(out, axis=1)
    # where the contour follows a row of pixels, only the row is known
    np.testing.assert_allclose(distance, radius, atol=0.55)
    assert np.sqrt(((distance - radius) ** 2).mean()) < 0.2
    assert ((out / distance[:, None] * view.normals).sum(axis=1) > 0.98).all()
    assert view.weights.sum() == pytest.approx(2 * np.pi * radius, rel=0.05)
    assert not view.between.any()


def test_what_is_nearer_owns_the_contour() -> None:
    """Part 1 before part 0, its upper edge far before it, its lower edge flush; the image's edge is no contour."""
    ids, depths = np.zeros((40, 40), dtype=np.int64), np.full((40, 40), 5.0, dtype=np.float32)
    ids[10:25] = 1
    depths[10:25] = np.linspace(4.0, 4.995, 15)[:, None]
    view = traced_picture(ids, depths, (40, 40))
    assert (view.parts == 1).all()
    np.testing.assert_array_equal(view.between, view.pixels[:, 1] > 20)
    np.testing.assert_allclose(view.pixels[:, 1], np.where(view.between, 24.5, 9.5), atol=0.3)
    np.testing.assert_allclose(view.normals[:, 1], np.where(view.between, 1, -1), atol=1e-3)


def traced_picture(ids: Integers, depths: Array, size: tuple[int, int]) -> ViewContours:
    """Contours in a picture of a camera at the origin, its parts far from all others."""
    camera = np.array([1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 500, 500, 20, 20, *[0] * 9, np.inf])
    solids = np.tile([1.0, 0, 0, 99, 0, 1, 0, 99, 0, 0, 1, 99, 0, 0, 2, 1, 2], (2, 1))
    positions, points = np.zeros((500, 5), dtype=np.float32), np.zeros((500, 3), dtype=np.float32)
    parts, between = np.zeros(500, dtype=np.int64), np.zeros(500, dtype=np.bool_)
    n = id_contours(ids, depths, (0, 0, *size), camera, solids, 0.02, positions, points, parts, between)
    assert n == id_contours(
        ids, depths, (0, 0, *size), camera, solids, 0.02, positions[:3], points[:3], parts[:3], between[:3]
    )
    positions, points, parts, between = positions[:n], points[:n], parts[:n], between[:n]
    return ViewContours(positions[:, :2], positions[:, 2:4], positions[:, 4], parts, points, between)


def scattered(body: BodyModel, n: int, seed: int = 0) -> Array:
    """Poses (n, dof) about 8 degrees and 4 cm off."""
    spread = np.where(body.rotates, np.radians(8.0), 0.04)
    return body.clamped(bent(body) + spread * np.random.default_rng(seed).normal(size=(n, body.dof)))


def scored(synthesis: Any, scene: Scene, poses: Array, observation: Observation, reject: bool = False) -> Array:
    """Directed distances by contours and the kernel."""
    flat, layout, points, first, _ = observation.packed
    found = synthesis.contours(scene, 0, poses)
    return directed_distances(found.positions, found.counts, flat, layout, points, first, THETA, reject)


@pytest.mark.parametrize("kind", KINDS)
def test_scores_of_the_card_are_those_of_the_tracer(
    kind: str, egl: EglSynthesis, scenes: dict[str, Scene], body: BodyModel
) -> None:
    scene, poses = scenes[kind], scattered(body, 40)
    observation = ideal(scene, noise_px=0.5)
    on_card = egl.directed_distances(scene, 0, poses, observation, THETA, False)
    traced = scored(CpuSynthesis(step_px=2.0), scene, poses, observation)
    assert on_card.shape == (40, 4, 2)
    for direction in range(2):
        one, other = on_card[..., direction].mean(axis=1), traced[..., direction].mean(axis=1)
        assert np.corrcoef(one, other)[0, 1] > 0.998
        assert abs((one - other).mean()) < 0.3


def test_scores_of_the_card_are_those_of_the_kernel(
    egl: EglSynthesis, truth: Scene, observation: Observation, body: BodyModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alone, in a batch, in many small pictures and where there is too little room for all edges at first."""
    poses = scattered(body, 6)
    together = egl.directed_distances(truth, 0, poses, observation, THETA, False)
    alone = [egl.directed_distances(truth, 0, q[None], observation, THETA, False)[0] for q in poses]
    in_parts = replace(egl, atlas_px=512).directed_distances(truth, 0, poses, observation, THETA, False)
    for others in (scored(egl, truth, poses, observation), np.array(alone), in_parts):
        # a pixel where parts meet may change sides with the pose's place in the picture
        assert np.abs(together - others).max() < 0.1
        assert np.abs(together - others).mean() < 0.005
    monkeypatch.setattr(_atlas, "_EDGES_PER_TILE", 16)
    np.testing.assert_array_equal(egl.directed_distances(truth, 0, poses, observation, THETA, False), together)
    rejected = egl.directed_distances(truth, 0, poses, observation, THETA, reject=True)
    np.testing.assert_allclose(rejected, scored(egl, truth, poses, observation, reject=True))


def test_what_something_hides_is_not_measured_on_the_card(
    egl: EglSynthesis, truth: Scene, observation: Observation, body: BodyModel
) -> None:
    occluder = np.zeros((288, 360), dtype=np.bool_)
    occluder[150:] = True
    hidden = Observation(tuple(None if view is None else view.hidden_by(occluder) for view in observation.views))
    poses = scattered(body, 6)
    found = egl.directed_distances(truth, 0, poses, hidden, THETA, False)
    assert found.min() >= 0
    np.testing.assert_allclose(found, scored(egl, truth, poses, hidden), atol=0.1)
    assert np.abs(found - egl.directed_distances(truth, 0, poses, observation, THETA, False)).max() > 0.5


@pytest.mark.parametrize("use", ["egl", "osmesa", "auto"])
@pytest.mark.parametrize("missing", [(0,), (1, 3), (0, 1, 2, 3)])
def test_a_missing_view_has_no_distance(
    use: str, missing: tuple[int, ...], egl: EglSynthesis, truth: Scene, observation: Observation
) -> None:
    views = tuple(None if v in missing else view for v, view in enumerate(observation.views))
    synthesis, poses = working(use, truth), truth.persons[0].q[None]
    found = synthesis.directed_distances(truth, 0, poses, Observation(views), THETA, False)
    whole = synthesis.directed_distances(truth, 0, poses, observation, THETA, False)
    np.testing.assert_array_equal(np.isnan(found[0, :, 0]), [v in missing for v in range(4)])
    present = [v for v in range(4) if v not in missing]
    np.testing.assert_allclose(found[:, present], whole[:, present], atol=0.02)


def test_a_picture_shows_the_parts_in_colours(osmesa: OsmesaSynthesis, scenes: dict[str, Scene]) -> None:
    scene = scenes["distorted"]
    for view, ids in enumerate(osmesa.part_ids(scene)):
        picture = osmesa.picture(scene, view)
        assert picture.shape == (*ids.shape, 3)
        assert picture.dtype == np.uint8
        wrong = (picture < 250).any(axis=-1) != (ids >= 0)
        assert not wrong[~near_boundary(ids)].any()
        colours = {tuple(np.median(picture[ids == part], axis=0)) for part in np.unique(ids)}
        assert len(colours) == len(np.unique(ids))


def test_the_context_is_known_again(osmesa: OsmesaSynthesis, truth: Scene) -> None:
    """If not, shaders are compiled anew for each part, and what was handed to OpenGL is kept for ever."""
    osmesa.part_ids(truth)
    kept = sys.modules["OpenGL.contextdata"].storedPointers
    before = len(kept)
    osmesa.part_ids(truth)
    assert len(kept) == before


def test_a_picture_that_is_too_small_is_one_clear_line(egl: EglSynthesis, truth: Scene) -> None:
    large = Scene(truth.persons, four_views((1440, 1152)))
    with pytest.raises(RenderError, match=r"4 views of \d+x\d+ px do not fit into a picture of 256x256 px"):
        replace(egl, atlas_px=256).part_ids(large)


ELSEWHERE = """
import sys
import numpy as np
from observations import bent, four_views
from tracker.bodies.body.description import load_body
from tracker.foundation.resources import model_path
from tracker.bodies.scene import Person, Scene
from tracker.synthesis.osmesa import OsmesaSynthesis

body = load_body(model_path("gavrila22"))
scene = Scene((Person("one", body, bent(body)),), four_views())
np.save(sys.argv[1], OsmesaSynthesis(platform="egl").part_ids(scene))
"""


def test_the_other_platform_sees_the_same_in_another_process(
    osmesa: OsmesaSynthesis, egl: EglSynthesis, truth: Scene, tmp_path: Path
) -> None:
    with pytest.raises(RenderError, match=r'platform = "egl" was asked for, .* works through osmesa in this process'):
        replace(osmesa, platform="egl").part_ids(truth)
    tests = Path(__file__).parent
    surroundings = {**os.environ, "PYTHONPATH": f"{tests}{os.pathsep}{tests.parent}"}
    surroundings.pop("PYOPENGL_PLATFORM", None)
    subprocess.run(
        [sys.executable, "-W", "error", "-c", ELSEWHERE, str(tmp_path / "ids.npy")], env=surroundings, check=True
    )
    elsewhere, here = np.load(tmp_path / "ids.npy"), np.array(osmesa.part_ids(truth))
    assert (elsewhere != here).sum() <= 0.001 * (here >= 0).sum()


@each_renderer
def test_a_used_renderer_travels(renderer: Any, truth: Scene) -> None:
    before = renderer.part_ids(truth)
    arrived = pickle.loads(pickle.dumps(renderer))
    assert arrived == renderer
    for one, other in zip(before, arrived.part_ids(truth), strict=True):
        np.testing.assert_array_equal(one, other)


def test_every_thread_has_a_context_of_its_own(egl: EglSynthesis, osmesa: OsmesaSynthesis, truth: Scene) -> None:
    for synthesis in (egl, osmesa):
        with ThreadPoolExecutor(1) as pool:
            there = pool.submit(synthesis.part_ids, truth).result()
        for one, other in zip(there, synthesis.part_ids(truth), strict=True):
            np.testing.assert_array_equal(one, other)
