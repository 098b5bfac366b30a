"""What is found of points in a frame: only what was accepted becomes their own."""

from __future__ import annotations

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.points.following.following import Following
from tracker.points.following.keys import Keys, Sighting
from tracker.points.following.points import NewPoints, born
from tracker.points.following.sightings import NewKeys, Prepared, Sightings
from tracker.points.trajectories import PointStatus

HALF = 6
UNIT, TURNED = np.eye(2)[None], np.array([[[0.8, 0.1], [-0.1, 1.2]]])
POINT = np.array([0])


def key(grey: float) -> Keys:
    keys = Keys.empty(1, HALF)
    keys.patches[:], keys.usable[:] = grey, True
    return keys


def found(x: float, affine: np.ndarray) -> Sighting:
    return Sighting(np.array([[x, 60.0]]), affine, np.zeros((1, 3)))


def test_a_key_that_failed_is_not_the_one_that_a_point_was_found_by() -> None:
    """Looked for by its key of birth, where its rays missed one another, then found by the latest one."""
    unknown = np.full((1, 3), np.nan), np.full((1, 3, 3), np.nan)
    new = NewPoints(np.array([[[50.0, 50.0]]]), UNIT[None], np.zeros((1, 1, 3)), *unknown)
    points = born(new, (key(1),), None, 40.0, 0)
    points.keys[0].put(POINT, key(2))
    points.key_from_birth[0], points.keys_in[0], points.drift[0] = TURNED, 5, (0.04, 0.04, 0)
    points.status[:] = PointStatus.HIDDEN
    rig = Rig((Camera.looking_at("one", (100, 100), 100, (0, -1, 0), np.zeros(3)),))
    present = Prepared(9, (None,), (None,))
    sightings = Sightings(Following(), rig, points, present, present)
    sightings.put(0, POINT, found(60, UNIT))
    birth = points.birth_keys[0].select(POINT), points.birth_drift[0, POINT], UNIT, points.born[POINT], np.zeros((1, 2))
    sightings.new_keys.append(NewKeys(0, POINT, *birth))
    sightings.hide(POINT)
    sightings.put(0, POINT, found(61, TURNED))
    sightings.status[POINT] = PointStatus.FOUND_AGAIN
    np.testing.assert_array_equal(sightings.key_from_birth[0], TURNED)
    sightings.commit()
    assert (points.keys[0].patches == 2).all()
    assert points.keys_in[0] == 5
    np.testing.assert_array_equal(points.key_from_birth[0], TURNED)
    np.testing.assert_array_equal(points.drift[0], [(0.04, 0.04, 0)])
    np.testing.assert_array_equal(points.pixels[0], [(61, 60)])
