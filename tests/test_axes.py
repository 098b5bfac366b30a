"""Axes: lines from planes and rays, and the major axis of a person's region in spite of its arms."""

from __future__ import annotations

import numpy as np
import pytest
from observations import four_views

from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.geometry import line_from_planes, nearest_along_line
from tracker.foundation.resources import model_path
from tracker.images.operations.masks import iterated_axes, region_points
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.initialization._visual_hull import region_axes, torso_axis


def unit(vectors: Array) -> Array:
    lengths: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return lengths


def some_line(seed: int) -> tuple[Array, Array, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, 3), unit(rng.normal(size=3)), rng


def distance_to_line(points: Array, point: Array, direction: Array) -> Array:
    gaps: Array = np.linalg.norm(np.cross(points - point, direction), axis=-1)
    return gaps


def planes_through(point: Array, direction: Array, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Normals of planes that contain a line, and a point on each, some metres away."""
    within = rng.normal(size=(n, 3))
    normals = unit(np.cross(direction, within))
    return normals, point + rng.uniform(-2, 2, (n, 1)) * direction + 3 * within


@pytest.mark.parametrize("n_planes", [2, 3, 6])
@pytest.mark.parametrize("seed", range(4))
def test_planes_through_a_line_give_the_line(n_planes: int, seed: int) -> None:
    point, direction, rng = some_line(seed)
    found, along, strength = line_from_planes(*planes_through(point, direction, n_planes, rng))
    assert abs(abs(along @ direction) - 1) < 1e-12
    assert distance_to_line(found, point, direction) < 1e-9
    assert strength > 1e-3


def test_the_line_moves_with_its_planes() -> None:
    # Two rigid motions of the same planes: the lines found differ by the same motion.
    point, direction, rng = some_line(3)
    normals, points = planes_through(point, direction, 4, rng)
    normals = unit(normals + 0.05 * rng.normal(size=normals.shape))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    shift = np.array([40.0, -7.0, 2.0])
    here, along, strength = line_from_planes(normals, points)
    there, turned, same = line_from_planes(normals @ turn.T, points @ turn.T + shift)
    assert abs(abs(turned @ turn @ along) - 1) < 1e-12
    assert distance_to_line(there, turn @ here + shift, turned) < 1e-9
    assert same == pytest.approx(strength, abs=1e-12)


def test_more_planes_make_the_line_more_exact() -> None:
    point, direction, rng = some_line(8)

    def rms(n_planes: int) -> float:
        squares = []
        for _ in range(200):
            normals, points = planes_through(point, direction, n_planes, rng)
            points = points + 0.01 * rng.normal(size=(n_planes, 1)) * normals
            squares.append(distance_to_line(line_from_planes(normals, points)[0], point, direction) ** 2)
        return float(np.sqrt(np.median(squares)))

    # The noise of an offset is 1 cm, that of the line falls with the root of the number of planes.
    assert rms(40) < 0.35 * rms(4) + 1e-3
    assert rms(40) < 0.01


@pytest.mark.parametrize("n_planes", [1, 3])
def test_parallel_planes_determine_no_line(n_planes: int) -> None:
    normals = np.tile(unit(np.array([1.0, 2.0, -1.0])), (n_planes, 1))
    point, direction, strength = line_from_planes(normals, np.random.default_rng(0).normal(size=(n_planes, 3)))
    assert strength < 1e-12
    assert np.isfinite(point).all()
    assert abs(direction @ normals[0]) < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_rays_to_points_of_a_line_meet_it_there(seed: int) -> None:
    point, direction, rng = some_line(seed)
    origin, along = rng.uniform(-5, 5, 3), rng.uniform(-4, 4, 30)
    rays = unit(point + along[:, None] * direction - origin)
    found, gaps = nearest_along_line(point, direction, origin, rays)
    np.testing.assert_allclose(found, along, atol=1e-9)
    np.testing.assert_allclose(gaps, 0, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_place_of_any_ray_is_that_of_least_squares(seed: int) -> None:
    point, direction, rng = some_line(seed)
    origin, rays = rng.uniform(-5, 5, 3), unit(rng.normal(size=(30, 3)))
    found, gaps = nearest_along_line(point, direction, origin, rays)
    for ray, along, gap in zip(rays, found, gaps, strict=True):
        system = np.stack([direction, -ray], axis=1)
        best = np.linalg.lstsq(system, origin - point, rcond=None)[0]
        assert along == pytest.approx(best[0], abs=1e-8)
        assert gap == pytest.approx(float(np.linalg.norm(system @ best - (origin - point))), abs=1e-9)


def test_a_ray_parallel_to_the_line_keeps_its_distance() -> None:
    direction = np.array([0.0, 0.0, 1.0])
    _, gaps = nearest_along_line(np.zeros(3), direction, np.array([3.0, 4.0, 1.0]), np.stack([direction, -direction]))
    np.testing.assert_allclose(gaps, 5.0)


def strip(degrees: float, length: float, width: float, size: int = 240) -> Mask:
    """A strip in the image centre; the angle from straight up, to the right."""
    x, y = np.meshgrid(np.arange(size) - size / 2, np.arange(size) - size / 2)
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    mask: Mask = (np.abs(x * sine - y * cosine) <= length / 2) & (np.abs(x * cosine + y * sine) <= width / 2)
    return mask


@pytest.mark.parametrize("degrees", [-80.0, -30.0, 0.0, 12.0, 45.0, 89.0])
def test_the_axis_of_a_strip_is_its_middle_line_and_points_up(degrees: float) -> None:
    axes = iterated_axes(region_points(strip(degrees, 160, 40)))
    assert len(axes) == 1  # a strip of even width has no lateral points
    up = np.array([np.sin(np.radians(degrees)), -np.cos(np.radians(degrees))])
    assert axes[0].direction @ up > np.cos(np.radians(0.2))
    assert np.linalg.norm(axes[0].centre - 120) < 0.6
    assert abs(axes[0].half_length - 80) < 1.5
    np.testing.assert_allclose(axes[0].ends, axes[0].centre + np.array([[-80], [80]]) * up, atol=2)


def test_points_beside_a_strip_are_removed_turn_by_turn() -> None:
    mask = strip(10.0, 200, 30)
    mask[100:112, 125:225] = True
    axes = iterated_axes(region_points(mask))
    up = np.array([np.sin(np.radians(10)), -np.cos(np.radians(10))])
    off = [np.degrees(np.arccos(min(1.0, float(axis.direction @ up)))) for axis in axes]
    assert len(axes) > 1
    assert off[0] > 3
    assert off[-1] < 0.5


def test_a_big_region_is_thinned_evenly_and_a_small_one_is_kept() -> None:
    mask = strip(0.0, 200, 100)
    everything = region_points(mask, most=10**6)
    assert sorted(map(tuple, everything[:, ::-1].astype(int).tolist())) == sorted(
        map(tuple, np.argwhere(mask).tolist())
    )
    few = region_points(mask, most=1000)
    assert len(few) == 1000
    assert len(region_points(mask, most=len(everything) - 1)) == len(everything) - 1
    np.testing.assert_allclose(few.mean(axis=0), everything.mean(axis=0), atol=1.0)
    assert region_points(np.zeros((5, 5), dtype=np.bool_)).shape == (0, 2)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("raised_deg", [60.0, 90.0, 120.0])
def test_the_axis_of_a_person_is_not_disturbed_by_an_arm(side: str, raised_deg: float) -> None:
    body = load_body(model_path("gavrila22"))
    rig = Rig((Camera.looking_at("front", (384, 288), 480.0, (4.0, 0.0, 0.1), np.array([0.0, 0.0, 0.0])),))
    q = body.rest()
    q[body.index(f"{side}_arm_abduction")] = np.radians(raised_deg)
    scene = Scene((Person("one", body, body.clamped(q)),), rig)
    marks = body.landmarks_in_world(scene.persons[0].q)
    head, pelvis = (rig.cameras[0].project(marks[body.landmark_names.index(name)]) for name in ("head_top", "pelvis"))
    axes = iterated_axes(region_points(CpuSynthesis().silhouettes(scene)[0]))
    up = unit(head - pelvis)
    off = [np.degrees(np.arccos(min(1.0, float(axis.direction @ up)))) for axis in axes]
    lateral = [abs(float(np.cross([*up, 0], [*(axis.centre - pelvis), 0])[2])) for axis in axes]
    assert max(off[0], lateral[0] / 4) > 2
    assert off[-1] < 2
    assert lateral[-1] < 4
    assert np.linalg.norm(axes[-1].ends[1] - head) < 15


def test_a_view_with_a_speck_of_the_person_has_no_say_in_the_axis() -> None:
    body = load_body(model_path("human"))
    scene = Scene((Person("one", body, body.rest()),), four_views())
    regions = CpuSynthesis().silhouettes(scene)[:3]
    speck = np.zeros_like(regions[2])
    speck[100, :2] = True
    told, without = (
        torso_axis(scene.rig, (*regions[:2], third), region_axes((*regions[:2], third), 0.0)) for third in (speck, None)
    )
    np.testing.assert_allclose(told.head_top, without.head_top)
    np.testing.assert_allclose(told.direction, without.direction)


def test_a_region_counts_by_its_share_of_its_own_view() -> None:
    small, large = strip(0, 40, 10), np.zeros((1000, 1000), np.bool_)
    large[: small.shape[0], : small.shape[1]] = small
    share = np.count_nonzero(small) / small.size
    assert [len(found) > 0 for found in region_axes((small, large, None), 0.5 * share)] == [True, False, False]
