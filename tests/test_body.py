"""Bodies: matrix exponentials as oracle, derivatives, symmetry, documented signs; a person and an animal alike."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from rounding import assert_alike
from scipy.linalg import expm

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Person, Scene
from tracker.bodies.segments import TaperedSuperquadric
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import ModelError
from tracker.images.sight import Observation, ViewObservation
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective

MODELS = Path(__file__).resolve().parents[1] / "models"
NAMES = ("gavrila22", "quadruped")
both = pytest.mark.parametrize("body", [load_body(MODELS / f"{name}.toml") for name in NAMES], ids=NAMES)


@pytest.fixture(scope="module")
def person() -> BodyModel:
    return load_body(MODELS / "gavrila22.toml")


def poses(body: BodyModel, *batch: int, seed: int = 0) -> Array:
    """Poses (*batch, dof) inside the joint limits, within 2 m and half a turn."""
    low, high = body.limits.T
    reach = np.where(body.rotates, np.pi, 2.0)
    drawn = np.random.default_rng(seed).uniform(np.maximum(low, -reach), np.minimum(high, reach), (*batch, body.dof))
    return np.asarray(drawn, dtype=np.float64)


def motion(body: BodyModel, q: Array, parameter: int) -> Array:
    """Plain twin: the product of matrix exponentials of the twists along a chain."""
    if parameter < 0:
        return np.eye(4)
    twist = np.zeros((4, 4))
    one = body.parameters[parameter]
    if one.rotates:
        x, y, z = one.axis
        twist[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        twist[:3, 3] = -np.cross(one.axis, one.point)
    else:
        twist[:3, 3] = one.axis
    product: Array = motion(body, q, one.parent) @ expm(twist * q[parameter])
    return product


@both
def test_kinematics_is_the_product_of_exponentials(body: BodyModel) -> None:
    for q in poses(body, 4):
        expected = [motion(body, q, part.parameter) @ part.model_from_part for part in body.parts]
        np.testing.assert_allclose(body.world_from_part(q), expected, atol=1e-12)
        marks = [(motion(body, q, mark.parameter) @ [*mark.point, 1])[:3] for mark in body.landmarks]
        np.testing.assert_allclose(body.landmarks_in_world(q), marks, atol=1e-12)


@both
def test_a_batch_is_a_loop(body: BodyModel) -> None:
    batch = poses(body, 2, 3)
    for method in (body.world_from_part, body.landmarks_in_world, body.twists, body.world_from_parameters):
        looped = np.array([[method(q) for q in row] for row in batch])
        assert_alike(method(batch), looped)
        assert method(batch[:0]).shape == (0, *looped.shape[1:])


@both
def test_the_reference_pose_is_the_model_file(body: BodyModel) -> None:
    assert_alike(body.world_from_part(np.zeros(body.dof)), body.model_from_parts)
    expected = [mark.point for mark in body.landmarks]
    assert_alike(body.landmarks_in_world(np.zeros(body.dof)), expected)


@both
def test_the_point_jacobian_equals_finite_differences(body: BodyModel) -> None:
    step = 1e-6
    hung = np.array([mark.parameter for mark in body.landmarks])
    for q in poses(body, 5, seed=1):
        moves = step * np.eye(body.dof)
        differences = (body.landmarks_in_world(q + moves) - body.landmarks_in_world(q - moves)) / (2 * step)
        jacobian = body.point_jacobian(q, body.landmarks_in_world(q), hung)
        np.testing.assert_allclose(jacobian, differences.transpose(1, 2, 0), atol=1e-8)


@both
def test_what_moves_what_is_what_the_jacobian_says(body: BodyModel) -> None:
    """Parameter i moves a point in general position on chain j if and only if `moves[i, j]`."""
    q = poses(body, seed=2)
    motions = body.world_from_parameters(q)
    point = np.array([0.31, -0.47, 0.83, 1.0])
    for i in range(body.dof):
        moved = body.world_from_parameters(q + 0.3 * np.eye(body.dof)[i])
        change = np.linalg.norm((moved - motions) @ point, axis=-1)
        np.testing.assert_array_equal(change > 1e-9, body.moves[i])
    assert not body.moves[:, body.dof].any()


@both
def test_lengths_scale(body: BodyModel) -> None:
    name = body.name
    larger = load_body(MODELS / f"{name}.toml", scale=1.25)
    lengths = np.where(body.rotates, 1.0, 1.25)
    q = poses(body)
    np.testing.assert_allclose(larger.landmarks_in_world(lengths * q), 1.25 * body.landmarks_in_world(q), atol=1e-12)
    np.testing.assert_allclose(larger.limits, lengths[:, None] * body.limits)
    np.testing.assert_allclose(larger.shapes[:, :3], 1.25 * body.shapes[:, :3], atol=1e-12)
    np.testing.assert_array_equal(larger.shapes[:, 3:], body.shapes[:, 3:])
    assert larger.stature_m == pytest.approx(1.25 * body.stature_m)


@both
def test_limits_are_sane_and_hold_the_rest(body: BodyModel) -> None:
    low, high = body.limits.T
    assert (low < high).all()
    assert (low <= 0).all()
    assert (high >= 0).all()
    np.testing.assert_array_equal(body.rest(), np.zeros(body.dof))
    outside = np.stack([low - 1, high + 1])
    np.testing.assert_array_equal(body.clamped(outside), [low, high])
    joints = [not name.startswith(("torso", "trunk")) for name in body.names]
    assert (high - low)[joints].max() <= np.radians(220)


@both
def test_bones_keep_their_lengths_but_where_they_stretch(body: BodyModel) -> None:
    """Every link joins two landmarks of one chain; only the animal's neck changes its length."""
    marks = body.landmarks_in_world(poses(body, 200, seed=3))
    for one, other in body.links:
        a, b = (body.landmark_names.index(end) for end in (one, other))
        length = np.linalg.norm(marks[:, a] - marks[:, b], axis=1)
        stretch = (length.max() - length.min()) / length.mean()
        assert (stretch > 0.1) == ((one, other) == ("withers", "poll")), (one, other)


@both
def test_groups_cover_every_parameter(body: BodyModel) -> None:
    for names in (body.coarse_groups, body.fine_groups):
        together = np.concatenate([body.group(name) for name in names])
        assert len(together) == len(set(together.tolist()))
    covered = np.concatenate([body.group(name) for name in body.coarse_groups])
    assert sorted(covered.tolist()) == list(range(body.dof))


@both
def test_names_that_are_not_there(body: BodyModel) -> None:
    with pytest.raises(ModelError, match=rf'"{body.name}" has no parameter "{body.names[3][:-1]}".*"{body.names[3]}"'):
        body.index(body.names[3][:-1])
    with pytest.raises(ModelError, match=r"has no group \"wings\""):
        body.group("wings")


@both
def test_other_shapes_on_the_same_skeleton(body: BodyModel) -> None:
    ball = TaperedSuperquadric(np.full(3, 0.1), np.ones(2), np.zeros(2))
    round_body = body.with_shapes((ball,) * len(body.parts))
    q = poses(body)
    np.testing.assert_array_equal(round_body.world_from_part(q), body.world_from_part(q))
    np.testing.assert_array_equal(round_body.shapes, [ball.packed] * len(body.parts))


def test_the_person_has_the_parameters_of_the_paper(person: BodyModel) -> None:
    limbs = [f"{side}_{limb}" for side in ("left", "right") for limb in ("arm", "leg")]
    expected = [f"torso_{axis}" for axis in ("x", "y", "z", "abduction", "elevation", "twist")]
    expected += [f"{limb}_{a}" for limb in limbs for a in ("abduction", "elevation", "twist", "extension")]
    assert sorted(person.names) == sorted(expected)
    assert person.dof == 22
    assert person.names[:6] == tuple(expected[:6])
    assert {name: len(person.group(name)) for name in person.coarse_groups} == {"torso_head": 5, "arms": 9, "legs": 8}
    assert person.fine_groups == ("torso_head", "left_arm", "right_arm", "left_leg", "right_leg")
    assert "torso_twist" in person.groups["arms"]
    assert person.parameters[0].column == "torso_x_m"
    assert person.parameters[person.index("left_arm_extension")].column == "left_arm_extension_deg"
    sides = [f"{side}_{joint}" for side in ("left", "right") for joint in
             ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")]  # fmt: skip
    assert sorted(person.landmark_names) == sorted(["head_top", "neck", "pelvis", *sides])


def test_parts_belong_to_the_groups_that_carry_them(person: BodyModel) -> None:
    parts = np.array([part.name for part in person.parts])
    assert set(parts[person.parts_of("torso_head")]) == {"torso", "neck", "head"}
    assert set(parts[person.parts_of("left_arm")]) == {"left_upper_arm", "left_forearm", "left_hand"}
    assert set(parts[person.parts_of("right_leg")]) == {"right_thigh", "right_shin", "right_foot"}
    animal = load_body(MODELS / "quadruped.toml")
    owners = np.sum([animal.parts_of(group) for group in animal.fine_groups], axis=0)
    np.testing.assert_array_equal(owners, 1)


FORWARDS, LEFT, UP = np.eye(3)
SIGNS = {
    "torso_x": ({}, "pelvis", FORWARDS),
    "torso_y": ({}, "pelvis", LEFT),
    "torso_z": ({}, "pelvis", UP),
    "torso_abduction": ({}, "head_top", LEFT),
    "torso_elevation": ({}, "head_top", FORWARDS),
    "torso_twist": ({}, "left_shoulder", -FORWARDS),
    "left_arm_abduction": ({}, "left_wrist", LEFT),
    "right_arm_abduction": ({}, "right_wrist", -LEFT),
    "left_arm_elevation": ({}, "left_wrist", FORWARDS),
    "right_arm_elevation": ({}, "right_wrist", FORWARDS),
    "left_arm_extension": ({}, "left_wrist", FORWARDS),
    "right_arm_extension": ({}, "right_wrist", FORWARDS),
    "left_arm_twist": ({"left_arm_extension": 90}, "left_wrist", -LEFT),
    "right_arm_twist": ({"right_arm_extension": 90}, "right_wrist", LEFT),
    "left_leg_abduction": ({}, "left_ankle", LEFT),
    "right_leg_abduction": ({}, "right_ankle", -LEFT),
    "left_leg_elevation": ({}, "left_ankle", FORWARDS),
    "right_leg_elevation": ({}, "right_ankle", FORWARDS),
    "left_leg_extension": ({}, "left_ankle", -FORWARDS),
    "right_leg_extension": ({}, "right_ankle", -FORWARDS),
    "left_leg_twist": ({"left_leg_extension": 90}, "left_ankle", LEFT),
    "right_leg_twist": ({"right_leg_extension": 90}, "right_ankle", -LEFT),
}


@pytest.mark.parametrize("name", SIGNS)
def test_signs_are_as_documented(person: BodyModel, name: str) -> None:
    """A small positive angle moves a joint in the documented direction; a bent knee's ankle goes out as toes go in."""
    setting, landmark, direction = SIGNS[name]
    q = np.zeros(person.dof)
    for other, angle_deg in setting.items():
        q[person.index(other)] = np.radians(angle_deg)
    mark = person.landmark_names.index(landmark)
    before = person.landmarks_in_world(q)[mark]
    q[person.index(name)] += 0.1
    moved = person.landmarks_in_world(q)[mark] - before
    assert moved @ direction > 0.99 * np.linalg.norm(moved)
    assert np.linalg.norm(moved) > 0.01


@pytest.mark.parametrize("limb", [("shoulder", "elbow", "wrist", "arm"), ("hip", "knee", "ankle", "leg")])
@pytest.mark.parametrize("side", ["left", "right"])
def test_extension_is_the_angle_between_the_segments(person: BodyModel, side: str, limb: tuple[str, ...]) -> None:
    batch = poses(person, 50)
    joints = [person.landmark_names.index(f"{side}_{joint}") for joint in limb[:3]]
    upper, middle, lower = np.moveaxis(person.landmarks_in_world(batch)[:, joints], 1, 0)
    one, other = middle - upper, lower - middle
    angle = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), (one * other).sum(axis=1))
    np.testing.assert_allclose(angle, batch[:, person.index(f"{side}_{limb[3]}_extension")], atol=1e-9)


def test_left_and_right_mirror_each_other(person: BodyModel) -> None:
    def other_side(name: str) -> str:
        return name.replace("left", "\0").replace("right", "left").replace("\0", "right")

    swap = [person.index(other_side(name)) for name in person.names]
    np.testing.assert_array_equal(person.limits[swap], person.limits)
    signs = np.ones(person.dof)
    signs[[person.index(f"torso_{name}") for name in ("y", "abduction", "twist")]] = -1
    batch = poses(person, 20)
    marks = [person.landmark_names.index(other_side(name)) for name in person.landmark_names]
    mirrored = person.landmarks_in_world(batch[:, swap] * signs)
    np.testing.assert_allclose(mirrored, person.landmarks_in_world(batch)[:, marks] * (1, -1, 1), atol=1e-12)
    parts = [part.name for part in person.parts]
    pairs = [parts.index(other_side(name)) for name in parts]
    np.testing.assert_array_equal(person.shapes[pairs], person.shapes)
    centres = person.world_from_part(batch)[:, pairs][..., :3, 3]
    turned = person.world_from_part(batch[:, swap] * signs)[..., :3, 3]
    np.testing.assert_allclose(turned, centres * (1, -1, 1), atol=1e-12)


def test_the_person_is_as_tall_as_stated(person: BodyModel) -> None:
    heights = []
    for part in person.parts:
        points, _ = part.shape.surface(np.linspace(-np.pi / 2, np.pi / 2, 61)[:, None], np.linspace(-3, 3, 60)[None])
        heights.append((points @ part.model_from_part[:3, :3].T + part.model_from_part[:3, 3])[..., 2])
    assert max(map(np.max, heights)) - min(map(np.min, heights)) == pytest.approx(person.stature_m, abs=0.02)


def test_an_animal_is_found_by_the_same_code() -> None:
    """From its own contours in four views, started 3 degrees off, every angle returns to within half a degree."""
    body = load_body(MODELS / "quadruped.toml")
    target = np.array([0, 0, 0.5])
    places = {"a": (2.4, 1.6, 1.2), "b": (-1.8, 2.2, 1.5), "c": (-2.0, -2.2, 1.0), "d": (2.2, -2.0, 1.7)}
    rig = Rig(tuple(Camera.looking_at(name, (640, 480), 600.0, place, target) for name, place in places.items()))
    truth = 0.3 * poses(body, seed=5)
    truth[:3] = 0.1, -0.05, 0.6
    scene = Scene((Person("rex", body, truth),), rig)
    drawn = CpuSynthesis(step_px=6.0, n_eta=17, n_omega=32).contours(scene)
    assert drawn.counts.max() < drawn.positions.shape[2]
    observation = Observation(tuple(observed(drawn.of(v)) for v in range(4)))
    errors = np.random.default_rng(6).choice([-1.0, 1.0], body.dof) * np.where(body.rotates, np.radians(3), 0.02)
    start = body.clamped(truth + errors)
    asked = Comparison(scene.with_pose(0, start), 0, CpuSynthesis(), observation)
    objective = Objective(asked, ContourEvidence())
    found = TwistIcpEstimation().estimate(objective, start[None]).q
    assert np.degrees(np.abs(found - truth)[body.rotates]).max() < 1.0
    assert np.abs(found - truth)[~body.rotates].max() < 0.005


def observed(contours: ViewContours) -> ViewObservation:
    """An image analysis without fault: exactly the outer contours."""
    outer = ~contours.between
    n = int(outer.sum())
    canvas: Image = np.full((480, 640), 255, dtype=np.uint8)
    columns, rows = np.round(contours.pixels[outer]).astype(int).clip(0, (639, 479)).T
    canvas[rows, columns] = 0
    return ViewObservation(
        edges=contours.pixels[outer],
        directions=contours.normals[outer],
        segments=np.zeros(n, dtype=np.int64),
        accepted=np.ones(n, dtype=np.bool_),
        scene=np.arange(n),
        scene_weights=contours.weights[outer],
        origin=(0, 0),
        distance=np.minimum(cv2.distanceTransform(canvas, cv2.DIST_L2, 5), 40).astype(np.float32),
        reach=40.0,
    )
