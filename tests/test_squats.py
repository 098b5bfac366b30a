"""A movement is itself however deep and quick it is done, and whatever other limbs do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from known_movements import LIBRARY

from tracker.bodies.body.description import load_body
from tracker.foundation.resources import model_path
from tracker.results.recognition import RATE_HZ, course_of
from tracker.results.recognition.matching import recognize, table_rows, timeline


def squatting(depth, seconds, arms):
    """Somebody with another body squats once, the arms hanging, crossed or raised."""
    body = load_body(model_path("human"))
    times = np.arange(0, seconds + 0.2, 1 / RATE_HZ)
    down = depth * (0.5 - 0.5 * np.cos(2 * np.pi * np.minimum(times / seconds, 1.0)))
    poses = np.tile(body.rest(), (len(times), 1))
    bends = {
        "torso_elevation": 28 * down,
        "leg_abduction": 10,
        "leg_elevation": 103 * down,
        "leg_extension": 3 + 105 * down,
    }
    held = {"hanging": (0, 10, 0), "crossed": (45, 90, 85), "raised": (85, 5, 0)}[arms]
    bends |= dict(zip(("arm_elevation", "arm_extension", "arm_twist"), held, strict=True))
    for name, angles in bends.items():
        poses[:, body.columns(name)] = np.radians(np.broadcast_to(angles, times.shape))[:, None]
    return course_of(body, times, body.clamped(poses))


@pytest.mark.parametrize("arms", ["hanging", "crossed", "raised"])
@pytest.mark.parametrize(("depth", "seconds"), [(0.5, 1.2), (0.5, 5.0), (0.7, 2.6), (1.0, 1.0), (1.0, 7.0), (1.2, 4.0)])
def test_squats_are_squats_however_deep_and_quick_and_whatever_the_arms_do(depth, seconds, arms):
    squats = [one for one in recognize(squatting(depth, seconds, arms), LIBRARY) if one.movement != "standing"]
    assert [one.movement for one in squats] == ["squat"]
    assert squats[0].size == pytest.approx(depth, rel=0.1)
    assert squats[0].tempo == pytest.approx(2.64 / seconds, rel=0.25)
    rows = list(table_rows({"anna": timeline(squatting(depth, seconds, arms), squats)}))
    (told,) = [dict(zip(rows[0], row, strict=True)) for row in rows[1:] if "squat" in row]
    assert float(told["size"]) == pytest.approx(depth, rel=0.1)


@pytest.mark.parametrize("arms", ["hanging", "crossed", "raised"])
def test_who_stands_squats_by_no_small_amount(arms):
    found = recognize(squatting(0.1, 4.0, arms), LIBRARY)
    assert {one.movement for one in found} <= {"standing"}
    assert all(math.isnan(one.size) and math.isnan(one.tempo) for one in found)


def test_a_lunge_is_no_squat():
    body = load_body(model_path("human"))
    times = np.arange(0, 2.4, 1 / RATE_HZ)
    down = 0.5 - 0.5 * np.cos(2 * np.pi * times / 2.4)
    poses = np.tile(body.rest(), (len(times), 1))
    bends = {"left_leg_elevation": 78, "left_leg_extension": 84, "right_leg_elevation": -24, "right_leg_extension": 66}
    for name, angle in bends.items():
        poses[:, body.index(name)] = np.radians(angle * down)
    assert "squat" not in {one.movement for one in recognize(course_of(body, times, body.clamped(poses)), LIBRARY)}
