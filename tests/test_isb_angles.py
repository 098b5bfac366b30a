"""ISB joint angles: named movements have their sign and size, and rotations are put together again from them."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from motions import LOST, MODELS, N_FRAMES, made_up
from scipy.spatial.transform import Rotation

from tracker.bodies.body.description import load_body
from tracker.foundation.errors import ConfigError
from tracker.results.recording._anatomical import joints_of, leaning_limb
from tracker.results.recording._motion import Y_UP
from tracker.results.recording.isb_angles import IsbAngles

HUMAN, GAVRILA = (load_body(MODELS / f"{name}.toml") for name in ("human", "gavrila22"))


def angles(body, **degrees):
    """ISB angles in degrees by their names at a pose that is zero but for some parameters."""
    q = np.zeros(body.dof)
    for name, value in degrees.items():
        q[body.index(name)] = np.radians(value)
    turns = body.world_from_parameters(q[None])[:, [segment.end for segment in body.segments], :3, :3]
    return {
        f"{joint.name}_{angle}": value
        for joint in joints_of(body)
        for angle, value in zip(joint.angles, np.degrees(joint.of(turns)[0]), strict=True)
    }


def test_the_joints_are_those_of_the_body():
    both = [f"{side}_{joint}" for joint in ("shoulder", "elbow", "hip", "knee") for side in ("left", "right")]
    assert [joint.name for joint in joints_of(GAVRILA)] == both
    assert [joint.name for joint in joints_of(HUMAN)] == ["trunk", "neck", *both, "left_ankle", "right_ankle"]
    assert joints_of(load_body(MODELS / "quadruped.toml")) == []


def test_angles_that_a_body_cannot_have_are_left_out():
    """Of a trunk that only leans forwards, and of thighs that only rise; shoulders have all of theirs."""
    upper21, upper32 = (load_body(MODELS / f"{name}.toml") for name in ("upper21", "upper32"))
    assert {name for name in angles(upper21) if "shoulder" not in name} == {
        *("trunk_flexion", "left_elbow_flexion", "right_elbow_flexion")
    }
    assert [name for name in angles(upper32) if "hip" in name] == ["left_hip_flexion", "right_hip_flexion"]
    assert sum("trunk" in name or "neck" in name for name in angles(upper32)) == 6
    for body in (upper21, upper32):
        assert sum("shoulder" in name for name in angles(body)) == 6
    assert angles(upper21, spine_elevation=30)["trunk_flexion"] == pytest.approx(30)


@pytest.mark.parametrize("body", [HUMAN, GAVRILA], ids=lambda body: body.name)
def test_everything_is_zero_in_the_reference_pose(body):
    found = angles(body)
    empty = {name for name, value in found.items() if np.isnan(value)}
    assert empty == {f"{s}_shoulder_{a}" for s in ("left", "right") for a in ("plane_of_elevation", "axial_rotation")}
    assert all(abs(value) < 1e-9 for name, value in found.items() if name not in empty)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("body", [HUMAN, GAVRILA], ids=lambda body: body.name)
def test_movements_of_a_limb_have_the_sign_of_the_standard(body, side):
    """On both sides alike. Ours: elevation forwards, abduction sideways, twist inwards, extension bends."""
    found = angles(body, **{f"{side}_leg_elevation": 40, f"{side}_leg_extension": 60, f"{side}_arm_extension": 80})
    assert found[f"{side}_hip_flexion"] == pytest.approx(40)
    assert found[f"{side}_knee_flexion"] == pytest.approx(60)
    assert found[f"{side}_elbow_flexion"] == pytest.approx(80)
    found = angles(body, **{f"{side}_leg_abduction": 20})
    assert found[f"{side}_hip_adduction"] == pytest.approx(-20)
    found = angles(body, **{f"{side}_leg_twist": 15})
    assert found[f"{side}_hip_internal_rotation"] == pytest.approx(15)
    # an arm raised sideways lies in the plane of 0 degrees, forwards in that of 90
    found = angles(body, **{f"{side}_arm_abduction": 70})
    assert found[f"{side}_shoulder_elevation"] == pytest.approx(70)
    assert found[f"{side}_shoulder_plane_of_elevation"] == pytest.approx(0, abs=1e-9)
    found = angles(body, **{f"{side}_arm_elevation": 50, f"{side}_arm_twist": 25})
    assert found[f"{side}_shoulder_elevation"] == pytest.approx(50)
    assert found[f"{side}_shoulder_plane_of_elevation"] == pytest.approx(90)
    assert found[f"{side}_shoulder_axial_rotation"] == pytest.approx(25 - 90)
    other = "right" if side == "left" else "left"
    assert found[f"{other}_hip_flexion"] == pytest.approx(0, abs=1e-9)


def test_movements_of_spine_neck_and_ankle_have_the_sign_of_the_standard():
    """Ours: abduction to the left, elevation forwards, twist to the left, ankle elevation raises the toes."""
    for joint, ours in (("trunk", "spine"), ("neck", "neck")):
        assert angles(HUMAN, **{f"{ours}_elevation": 30})[f"{joint}_flexion"] == pytest.approx(30)
        assert angles(HUMAN, **{f"{ours}_abduction": 20})[f"{joint}_lateral_bending"] == pytest.approx(-20)
        assert angles(HUMAN, **{f"{ours}_twist": 25})[f"{joint}_axial_rotation"] == pytest.approx(25)
    found = angles(HUMAN, left_ankle_elevation=10, right_ankle_elevation=-20)
    assert (found["left_ankle_dorsiflexion"], found["right_ankle_dorsiflexion"]) == (
        pytest.approx(10),
        pytest.approx(-20),
    )


def test_where_the_body_stands_and_what_the_collar_does_is_no_joint_angle():
    still, turned = (
        angles(HUMAN, left_leg_elevation=30, torso_twist=turn, torso_elevation=turn / 2) for turn in (0, 130)
    )
    for name, value in still.items():
        np.testing.assert_allclose(turned[name], value, atol=1e-9)
    found = angles(HUMAN, left_collar_elevation=20, left_arm_abduction=40)
    assert found["left_shoulder_elevation"] == pytest.approx(60)  # of the thorax: collar and arm together


def test_rotations_are_put_together_again_from_the_angles():
    """By the standard's own sequences, mirrored on the left; seven joints of random poses."""
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(HUMAN.limits[:, 0], -3), np.minimum(HUMAN.limits[:, 1], 3), (50, HUMAN.dof))
    turns = HUMAN.world_from_parameters(q)[:, [segment.end for segment in HUMAN.segments], :3, :3]
    mirror = np.diag([1.0, 1, -1])
    for joint in joints_of(HUMAN):
        relative = Y_UP @ turns[:, joint.proximal].transpose(0, 2, 1) @ turns[:, joint.distal] @ Y_UP.T
        if joint.mirrored:
            relative = mirror @ relative @ mirror
        found = joint.of(turns)
        if "shoulder" in joint.name:
            plain = np.isfinite(found).all(axis=1)
            signed = found[plain] * [1, -1, 1]
            again = Rotation.from_euler("YXY", signed).as_matrix()
            np.testing.assert_allclose(again, relative[plain], atol=1e-9)
            assert plain.sum() > 30
        else:
            signs = {"trunk": [-1, 1, 1], "neck": [-1, 1, 1], "left_knee": [-1], "right_knee": [-1]}
            full = np.zeros((50, 3))
            full[:, : found.shape[1]] = found * signs.get(joint.name, 1.0)
            again = Rotation.from_euler("ZXY", full).as_matrix()
            np.testing.assert_allclose(again, relative, atol=1e-9)


def test_the_table_holds_a_row_a_frame(tmp_path):
    movement = made_up("human", "gavrila22")
    files = movement.record(IsbAngles(), tmp_path)
    assert [file.name for file in files] == ["person1_isb.csv", "person2_isb.csv"]
    for k, file in enumerate(files):
        with file.open(newline="") as opened:
            rows = list(csv.DictReader(opened))
        assert [row["frame"] for row in rows] == [str(10 + t) for t in range(N_FRAMES)]
        body = movement.scene.persons[k].body
        for t, row in enumerate(rows):
            value = row["left_elbow_flexion_deg"]
            if k == 0 and LOST.start <= t < LOST.stop:
                assert {text for name, text in row.items() if name.endswith("_deg")} == {""}
            else:
                bent = np.degrees(movement.poses[k][t][body.index("left_arm_extension")])
                assert float(value) == pytest.approx(bent, abs=1e-3)


def test_bodies_without_such_angles_are_refused(tmp_path):
    with pytest.raises(ConfigError, match='"quadruped" of "person1" has no joints of a person'):
        made_up("quadruped").record(IsbAngles(), tmp_path)
    marks = tuple(
        replace(mark, point=np.add(mark.point, [0, 0.3, 0])) if mark.name == "left_elbow" else mark
        for mark in HUMAN.landmarks
    )
    assert leaning_limb(HUMAN) == leaning_limb(GAVRILA) == ""
    assert leaning_limb(replace(HUMAN, landmarks=marks)) == "left_shoulder to left_elbow"
