"""The body of 36 parameters: a person like the 22-parameter one, whose trunk and extremities move too."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.keypoints import meant
from tracker.foundation.resources import model_path
from tracker.tracking.initialization._inverse_kinematics import fitted_pose


@pytest.fixture(scope="module")
def human() -> BodyModel:
    return load_body(model_path("human"))


def test_every_parameter_is_in_one_coarse_and_one_fine_group(human: BodyModel) -> None:
    assert human.coarse_groups == ("torso_head", "arms", "legs")
    coarse = [name for group in human.coarse_groups for name in human.groups[group]]
    assert sorted(coarse) == sorted(human.names)
    fine = [name for group in human.fine_groups for name in human.groups[group]]
    # The turn of the whole body is searched with the arms, as in the paper.
    assert sorted([*fine, "torso_twist"]) == sorted(human.names)
    seen = np.sum([human.parts_of(group) for group in human.fine_groups], axis=0)
    assert (seen == 1).all()


def test_it_is_as_high_as_it_says_and_clear_of_itself(human: BodyModel) -> None:
    eta, omega = np.meshgrid(np.linspace(-1.57, 1.57, 17), np.linspace(-np.pi, np.pi, 17))
    surface = np.concatenate(
        [
            part.shape.surface(eta, omega)[0].reshape(-1, 3) @ part.model_from_part[:3, :3].T
            + part.model_from_part[:3, 3]
            for part in human.parts
        ]
    )
    assert np.ptp(surface[:, 2]) == pytest.approx(human.stature_m, abs=0.02)
    assert human.collisions(human.rest()[None])[0] == 0


def test_left_and_right_are_mirror_images(human: BodyModel) -> None:
    rng = np.random.default_rng(3)
    q = human.clamped(rng.uniform(-0.6, 0.6, human.dof))
    mirrored = q.copy()
    for k, name in enumerate(human.names):
        other = name.replace("left", "#").replace("right", "left").replace("#", "right")
        sign = -1 if other == name and name.endswith(("_y", "abduction", "twist")) else 1
        mirrored[human.index(other)] = sign * q[k]
    marks = dict(zip(human.landmark_names, human.landmarks_in_world(q), strict=True))
    others = dict(zip(human.landmark_names, human.landmarks_in_world(mirrored), strict=True))
    for name, place in marks.items():
        other = name.replace("left", "#").replace("right", "left").replace("#", "right")
        np.testing.assert_allclose(others[other], place * (1, -1, 1), atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("parameter", "landmark", "axis", "sign"),
    [
        ("spine_elevation", "neck", 0, 1),
        ("spine_abduction", "neck", 1, 1),
        ("spine_twist", "left_shoulder", 0, -1),
        ("neck_elevation", "head_top", 0, 1),
        ("left_collar_elevation", "left_shoulder", 2, 1),
        ("right_collar_elevation", "right_shoulder", 2, 1),
        ("left_collar_protraction", "left_shoulder", 0, 1),
        ("left_wrist_flexion", "left_hand", 1, -1),
        ("right_wrist_flexion", "right_hand", 1, 1),
        ("left_ankle_elevation", "left_toe", 2, 1),
    ],
)
def test_parameters_move_what_the_file_says(
    human: BodyModel, parameter: str, landmark: str, axis: int, sign: int
) -> None:
    q = human.rest()
    before = human.landmarks_in_world(q)
    q[human.index(parameter)] += 0.2
    moved = human.landmarks_in_world(q) - before
    assert sign * moved[human.landmark_names.index(landmark), axis] > 0.01
    # What is nearer to the root stays where it is.
    assert np.abs(moved[human.landmark_names.index("pelvis")]).max() == 0


def test_a_body_whose_trunk_is_one_piece_reaches_a_crouch(human: BodyModel) -> None:
    """Its hips bend by what the spine of this one does, too; those of a hip alone leave ankles 0.27 m off."""
    crouching = human.rest()
    for name, angle_deg in (("torso_elevation", 20), ("spine_elevation", 50)):
        crouching[human.index(name)] = np.radians(angle_deg)
    for side in ("left", "right"):
        for name, angle_deg in (("leg_elevation", 125), ("leg_extension", 100), ("arm_elevation", 60)):
            crouching[human.index(f"{side}_{name}")] = np.radians(angle_deg)
    stiff = load_body(model_path("gavrila22"))
    marks = meant(human.landmark_names, stiff)
    points = human.landmarks_in_world(crouching)[marks.rows]
    _, gaps = fitted_pose(stiff, marks, points, np.ones(len(points)))
    assert gaps.max() < 0.06
