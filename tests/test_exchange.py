"""Limbs taken for each other change places in the world, not only in their angles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from observations import bent
from rounding import assert_alike

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.limbs import exchanged, mirrored
from tracker.foundation.resources import model_path

PAIRS = [("gavrila22", "leg"), ("gavrila22", "arm"), ("human", "leg")]


def crossed(body: BodyModel) -> np.ndarray:
    """The left leg before the right one, both bent."""
    q = body.rest()
    q[2] = 1.0
    for name, angle_deg in {
        "left_leg_abduction": -15, "left_leg_elevation": 35, "left_leg_extension": 40,
        "right_leg_abduction": -12, "right_leg_elevation": -10, "right_leg_extension": 15,
    }.items():  # fmt: skip
        q[body.index(name)] = np.radians(angle_deg)
    return body.clamped(q)


@pytest.mark.parametrize("model", ["gavrila22", "human"])
def test_crossed_legs_change_places(model: str) -> None:
    body = load_body(model_path(model))
    q = crossed(body)
    places = dict(zip(body.landmark_names, body.landmarks_in_world(q), strict=True))
    gaps = {}
    for way in (mirrored, exchanged):
        found = dict(
            zip(body.landmark_names, body.landmarks_in_world(way(body, q, "left_leg", "right_leg")), strict=True)
        )
        joints = [f"{side}_{joint}" for side in ("left", "right") for joint in ("knee", "ankle")]
        gaps[way] = np.mean([np.linalg.norm(found[name] - places[body.mirror.of(name)]) for name in joints])
    # hips are 0.2 m apart, so that legs of the same length reach each other's knees but for some centimetres
    assert gaps[exchanged] < 0.09
    assert gaps[exchanged] < 0.6 * gaps[mirrored]


def test_what_one_limb_alone_has_draws_none_of_them(tmp_path: Path) -> None:
    """A watch, called after its side or not: the other arm has no place for it."""
    told = '[landmarks]\nleft_watch = { segment = "left_forearm", at = [0, 0.2, 0.1] }\n'
    told += 'watch = { segment = "left_forearm", at = [0, 0.2, 0.1] }\n'
    file = tmp_path / "model.toml"
    file.write_text(model_path("gavrila22").read_text().replace("[landmarks]\n", told, 1))
    plain, watched = load_body(model_path("gavrila22")), load_body(file)
    q = bent(plain)
    found = exchanged(watched, q, "left_arm", "right_arm")
    assert_alike(found, exchanged(plain, q, "left_arm", "right_arm"))


@pytest.mark.parametrize(("model", "limb"), PAIRS)
def test_an_exchange_stays_within_the_limits_and_moves_nothing_else(model: str, limb: str) -> None:
    body = load_body(model_path(model))
    q = bent(body) if model == "gavrila22" else crossed(body)
    pose = exchanged(body, q, f"left_{limb}", f"right_{limb}")
    np.testing.assert_array_equal(pose, body.clamped(pose))
    others = np.setdiff1d(np.arange(body.dof), [*body.group(f"left_{limb}"), *body.group(f"right_{limb}")])
    np.testing.assert_array_equal(pose[others], q[others])
