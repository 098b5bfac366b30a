"""Persons in space: what the foreground of all views has in common, and who of several is who."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.observations import four_views
from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import InitializationError
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.initialization._persons import find_persons, in_order, person_pieces, size_of
from tracker.tracking.initialization._visual_hull import STEP_M, Hull, connected, hull_axis, shadow, visual_hull

RIG = four_views()


def standing(body: BodyModel, name: str, x: float, y: float, twist: float = 0.3) -> Person:
    q = body.rest()
    q[:3] = x, y, 1.24
    q[body.index("torso_twist")] = twist
    for side in ("left", "right"):
        q[body.index(f"{side}_arm_abduction")] = 0.4
    return Person(name, body, q)


def silhouettes(*persons: Person, rig: Rig = RIG) -> tuple[Mask, ...]:
    return CpuSynthesis().silhouettes(Scene(persons, rig))


def body_of(hull: Hull) -> Hull:
    """The voxels that all views see: where only two do, ghosts stand in the corners of the room."""
    return hull.part(hull.seen == 1)


def distance_to(points: Array, place: Array) -> float:
    return float(np.linalg.norm(points - place, axis=1).min())


def test_the_hull_holds_the_person_and_little_else(body: BodyModel) -> None:
    person = standing(body, "one", 0.1, -0.2)
    hull = body_of(visual_hull(RIG, silhouettes(person), 0))
    marks = body.landmarks_in_world(person.q)
    for name, place in zip(body.landmark_names, marks, strict=True):
        if name != "head_top":  # on the surface
            assert distance_to(hull.points, place) < STEP_M, name
    # A point of the hull projects into every silhouette, and a body has 0.07 cubic metres.
    assert (hull.lacking == 0).all()
    assert 0.05 < len(hull.points) * STEP_M**3 < 0.25


def test_the_hulls_axis_is_the_persons(body: BodyModel) -> None:
    person = standing(body, "one", -0.3, 0.2)
    axis = hull_axis(body_of(visual_hull(RIG, silhouettes(person), 0)).points)
    marks = dict(zip(body.landmark_names, body.landmarks_in_world(person.q), strict=True))
    assert axis.direction[2] > np.cos(np.radians(4))
    assert np.linalg.norm(axis.head_top - marks["head_top"]) < 2 * STEP_M


def test_an_object_in_one_view_is_nowhere_in_space(body: BodyModel) -> None:
    person = standing(body, "one", 0.0, 0.0)
    masks = list(silhouettes(person))
    clean = body_of(visual_hull(RIG, tuple(masks), 0))
    masks[0] = masks[0].copy()
    masks[0][:, : masks[0].shape[1] // 5] = True
    assert len(body_of(visual_hull(RIG, tuple(masks), 0)).points) == len(clean.points)


def test_a_hole_in_one_view_is_forgiven(body: BodyModel) -> None:
    person = standing(body, "one", 0.0, 0.0)
    masks = list(silhouettes(person))
    rows = np.flatnonzero(masks[1].any(axis=1))
    masks[1] = masks[1].copy()
    masks[1][rows[0] : rows[len(rows) // 2]] = False
    (found,) = find_persons(tuple(masks), RIG, (person,), ())
    assert np.ptp(found.points[:, 2]) > 0.85 * body.stature_m


@pytest.mark.parametrize("gap_m", [0.7, 1.2])
def test_two_persons_are_told_apart_by_who_is_taller(body: BodyModel, gap_m: float) -> None:
    small = standing(body, "small", gap_m / 2, gap_m / 2)
    tall = standing(body, "tall", -gap_m / 2, -gap_m / 2)
    q = small.q.copy()
    q[2] -= 0.25
    low = Person("small", body, q)  # stands in a hole: only the height of the head is looked at
    asked = (Person("small", _shorter(body), body.rest()), Person("tall", body, body.rest()))
    found = find_persons(silhouettes(low, tall), RIG, asked, ())
    first, second = in_order(found, asked, RIG, seen_before=False)
    assert np.linalg.norm(first.points.mean(axis=0)[:2] - low.q[:2]) < 0.15
    assert np.linalg.norm(second.points.mean(axis=0)[:2] - tall.q[:2]) < 0.15


def test_a_lost_person_is_looked_for_beside_the_known_one(body: BodyModel) -> None:
    known, lost = standing(body, "known", 0.5, 0.5), standing(body, "lost", -0.5, -0.4)
    (found,) = find_persons(silhouettes(known, lost), RIG, (lost,), (known,))
    assert np.linalg.norm(found.points.mean(axis=0)[:2] - lost.q[:2]) < 0.15


def test_too_few_persons_are_named(body: BodyModel) -> None:
    person = standing(body, "one", 0.0, 0.0)
    with pytest.raises(InitializationError, match=r"shows 1 person\(s\), expected 2"):
        find_persons(silhouettes(person), RIG, (person, person), ())
    empty = tuple(np.zeros_like(mask) for mask in silhouettes(person))
    with pytest.raises(InitializationError, match=r"shows 0 person\(s\), expected 1"):
        find_persons(empty, RIG, (person,), ())


def test_touching_boxes_are_parted_by_erosion() -> None:
    axes = np.stack(np.meshgrid(np.arange(10), np.arange(22), np.arange(20), indexing="ij"), axis=-1).reshape(-1, 3)
    bridge = (axes[:, 1] >= 10) & (axes[:, 1] < 12) & (axes[:, 2] != 5)
    cells = axes[~bridge]
    person = visual_hull(RIG, tuple(np.zeros(camera.size[::-1], dtype=np.bool_) for camera in RIG.cameras), 0)
    zeros = np.zeros(len(cells), dtype=np.int64)
    hull = type(person)(cells, cells * STEP_M, zeros, zeros.astype(np.float64))
    assert len(connected(hull)) == 1
    parts = connected(hull, 2)
    assert len(parts) == 2
    assert sum(len(part.points) for part in parts) == len(cells)


def test_a_shadow_covers_its_points_by_the_margin(body: BodyModel) -> None:
    person = standing(body, "one", 0.0, 0.0)
    hull = body_of(visual_hull(RIG, silhouettes(person), 0))
    for v, mask in enumerate(silhouettes(person)):
        covered = shadow(RIG, v, hull.points, 0.03)
        assert (mask & ~covered).sum() < 0.03 * mask.sum()
        assert covered.sum() < 1.9 * mask.sum()


def _shorter(body: BodyModel) -> BodyModel:
    return replace(body, stature_m=body.stature_m - 0.25)


def ring(radius_m: float, height_m: float = 1.8, thick_m: float = 0.3) -> Hull:
    """Voxels around an upright axis, none of them near it."""
    n = round(2 * (radius_m + thick_m) / STEP_M)
    cells = np.argwhere(np.ones((n, n, round(height_m / STEP_M)), np.bool_))
    points = STEP_M * (cells - [n / 2, n / 2, 0])
    kept = np.abs(np.linalg.norm(points[:, :2], axis=1) - radius_m) < thick_m / 2
    n_kept = int(kept.sum())
    return Hull(cells[kept], points[kept], np.zeros(n_kept, np.int64), np.ones(n_kept))


@pytest.mark.parametrize("radius_m", [0.5, 0.9, 1.4])
def test_a_ring_around_somebody_is_nobody(body: BodyModel, radius_m: float) -> None:
    """Of a lost woman, hull around the man who was known ended runs with a fault."""
    assert person_pieces(ring(radius_m), 0, [size_of(standing(body, "one", 0.0, 0.0))], 1.05) == []


def test_what_has_nothing_around_its_axis_has_none() -> None:
    with pytest.raises(InitializationError, match="around its own axis"):
        hull_axis(ring(0.5).points)


def test_what_hangs_on_a_known_person_is_nobody_else(body: BodyModel) -> None:
    """Shadows, and hands that are farther from the bones than a body is thick."""
    known = standing(body, "known", 0.0, 0.0)
    grown = tuple(cv2.dilate(mask.astype(np.uint8), np.ones((21, 21))) > 0 for mask in silhouettes(known))
    assert len(find_persons(grown, RIG, (known,), ())) == 1
    with pytest.raises(InitializationError, match="shows 0 person"):
        find_persons(grown, RIG, (standing(body, "lost", 0.0, 0.0),), (known,))
    beside = standing(body, "beside", 1.7, 0.4)
    both = tuple(one | other for one, other in zip(grown, silhouettes(beside), strict=True))
    (found,) = find_persons(both, RIG, (beside,), (known,))
    assert np.linalg.norm(found.points.mean(axis=0)[:2] - [1.7, 0.4]) < 0.15
