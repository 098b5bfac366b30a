"""What a model file says beyond the shape: sections checked, sides spelt out, defaults derived from the shape."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body, read_description, save_description
from tracker.bodies.segments import Mirror
from tracker.foundation.errors import ModelError
from tracker.foundation.resources import model_path
from tracker.synthesis.simulation.movements import course, poses_of
from tracker.tracking.initialization._placement import axis_marks

MODELS = ("gavrila22", "human", "quadruped")
SECTIONS = ("start", "joints", "clothes", "movements")


def changed(folder: Path, model: str, change: Callable[[dict[str, Any]], Any]) -> Path:
    """A model file with something changed."""
    table = tomllib.loads(model_path(model).read_text())
    change(table)
    path = folder / "changed.toml"
    path.write_text(tomli_w.dumps(table))
    return path


def without(*sections: str) -> Callable[[dict[str, Any]], Any]:
    return lambda table: [table.pop(section, None) for section in sections]


@pytest.mark.parametrize("model", MODELS)
def test_the_tree_holds_every_parameter_once_and_leads_to_every_part(model: str) -> None:
    body = load_body(model_path(model))
    assert sorted(column for segment in body.segments for column in segment.parameters) == list(range(body.dof))
    for k, segment in enumerate(body.segments):
        assert segment.parent < k
        above = body.segments[segment.parent].end if segment.parent >= 0 else -1
        chain = (above, *segment.parameters)
        assert [body.parameters[column].parent for column in segment.parameters] == list(chain[:-1])
        assert segment.end == chain[-1]
        for column in segment.parameters:
            np.testing.assert_array_equal(body.parameters[column].point, segment.joint)
    ends = {segment.name: segment.end for segment in body.segments}
    assert all(part.parameter == ends[part.segment] for part in body.parts)
    assert all(mark.parameter == ends[mark.segment] for mark in body.landmarks)


@pytest.mark.parametrize("model", MODELS)
def test_what_the_bundled_files_say_of_the_start_is_what_their_shape_tells(model: str, tmp_path: Path) -> None:
    body, bare = load_body(model_path(model)), load_body(changed(tmp_path, model, without(*SECTIONS, "groups")))
    assert bare.start.model_dump(exclude={"stances_deg"}) == body.start.model_dump(exclude={"stances_deg"})
    assert set(body.joints.hinges.items()) <= set(bare.joints.hinges.items())
    assert set(bare.joints.evaluated) >= set(body.joints.evaluated)
    assert {part.name for part in body.parts} == {name for worn in bare.clothes.garments.values() for name in worn}


@pytest.mark.parametrize("model", MODELS)
def test_derived_groups_part_the_tree_where_it_branches(model: str, tmp_path: Path) -> None:
    bare = load_body(changed(tmp_path, model, without("groups")))
    assert sorted(name for names in bare.groups.values() for name in names) == sorted(bare.names)
    paired = [group for group in bare.groups if bare.partner_of(group)]
    assert len(paired) >= 4
    assert all(bare.partner_of(str(bare.partner_of(group))) == group for group in paired)


@pytest.mark.parametrize("model", MODELS)
def test_a_derived_movement_moves_every_joint_within_its_limits(model: str, tmp_path: Path) -> None:
    bare = load_body(changed(tmp_path, model, without("movements")))
    assert list(bare.movements) == ["sway"]
    times = np.arange(0, 2, 0.04)
    poses = poses_of("", bare, times)
    np.testing.assert_array_equal(poses, bare.clamped(poses))
    joints = np.setdiff1d(np.arange(bare.dof), bare.root.columns)
    assert (np.ptp(poses[:, joints], axis=0) > 0.005).all()


def test_sides_are_called_as_the_file_calls_them(tmp_path: Path) -> None:
    text = model_path("gavrila22").read_text().replace("left", "links").replace("right", "rechts")
    (tmp_path / "mensch.toml").write_text(text)
    body, known = load_body(tmp_path / "mensch.toml"), load_body(model_path("gavrila22"))
    assert body.partner_of("links_arm") == "rechts_arm"
    assert known.partner_of("left_arm") == "right_arm"
    assert known.partner_of("torso_head") is None
    assert body.columns("arm_abduction") == known.columns("arm_abduction")
    assert [body.index(name) for name in body.start.coarse_deg] == [known.index(n) for n in known.start.coarse_deg]
    np.testing.assert_array_equal(poses_of("squat", body, np.arange(5) / 5), poses_of("squat", known, np.arange(5) / 5))


def test_a_name_without_its_side_means_both() -> None:
    mirror = Mirror(("left", "right"))
    names = ("right_arm_twist", "left_arm_twist", "torso_twist", "front_left_bend", "front_right_bend")
    assert mirror.meant("arm_twist", names) == ["left_arm_twist", "right_arm_twist"]
    assert mirror.meant("front_bend", names) == ["front_left_bend", "front_right_bend"]
    assert mirror.meant("torso_twist", names) == ["torso_twist"]
    assert mirror.meant("twist", names) == []
    assert mirror.meant("arm_twist", ("arm_twist", *names)) == ["arm_twist"], "what is called so is meant alone"
    assert mirror.of("front_left_bend") == "front_right_bend"


def test_a_parameter_that_is_not_there_is_refused_with_the_nearest_name() -> None:
    body = load_body(model_path("gavrila22"))
    assert body.columns("torso_twist") == [body.index("torso_twist")]
    with pytest.raises(ModelError, match=r'no parameter "arm_abdction"; did you mean'):
        body.columns("arm_abdction")


def test_joints_to_report_are_all_landmarks_or_those_named_in_their_order(tmp_path: Path) -> None:
    body = load_body(model_path("gavrila22"))
    assert body.reported == tuple(range(len(body.landmarks)))
    path = changed(tmp_path, "gavrila22", lambda m: m["joints"].update(reported=["wrist", "neck"]))
    few = load_body(path)
    assert [few.landmark_names[k] for k in few.reported] == ["left_wrist", "right_wrist", "neck"]


def test_lengths_of_movements_scale_with_the_body_and_angles_do_not(tmp_path: Path) -> None:
    path = model_path("quadruped")
    small, large = load_body(path), load_body(path, 2.0)
    times = np.arange(0, 1, 0.1)
    for name, factor in (("neck_stretch", 2.0), ("neck_pitch", 1.0)):
        ours, theirs = (course(body.movements["trot"].curves[name], times) for body in (small, large))
        np.testing.assert_allclose(theirs, factor * ours, atol=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_a_saved_model_says_the_same(model: str, tmp_path: Path) -> None:
    save_description(read_description(model_path(model)), tmp_path / "saved.toml")
    one, other = load_body(model_path(model)), load_body(tmp_path / "saved.toml")
    for section in SECTIONS:
        assert getattr(one, section) == getattr(other, section)
    assert one.mirror == other.mirror


CURVES = "two_elbow_rotation"
FAULTS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "unknown section": (lambda m: m.update(strat={}), r'unknown key "strat"; did you mean "start"'),
    "unknown key": (lambda m: m["start"].update(haed="neck"), r'start: unknown key "haed"; did you mean "head"'),
    "no landmark": (lambda m: m["start"].update(head="hed_top"), r'start\.head: no landmark "hed_top".*"head_top"'),
    "no parameter": (lambda m: m["start"].update(turn="torso_twst"), r'start\.turn: no parameter.*"torso_twist"'),
    "no limb": (lambda m: m["start"].update(coarse_deg={"arm_abdction": [1]}), r"start\.coarse_deg: no parameter"),
    "no stance": (lambda m: m["start"].update(stances_deg=[{"leg": 1}]), r"start\.stances_deg: no parameter"),
    "no stances": (lambda m: m["start"].update(stances_deg=[]), r"start\.stances_deg: .*at least 1 item"),
    "name of a path": (
        lambda m: m.update(name="../../x"),
        r"name: '../../x': '/' in the name, expected a name that files can have",
    ),
    "movement of a path": (
        lambda m: m["movements"].update({"../x": m["movements"][CURVES]}),
        r"movements: '../x': '/' in the name, expected a name that files can have",
    ),
    "no joint": (lambda m: m["joints"].update(evaluated=["elbw"]), r'joints\.evaluated: no landmark "elbw"'),
    "no alias": (lambda m: m["joints"].update(aliases={"hed": ["x"]}), r'joints\.aliases: no landmark "hed"'),
    "no hinge": (lambda m: m["joints"].update(hinges={"elbow": ["shoulder", "wrst"]}), r"joints\.hinges: no landmark"),
    "sides of a hinge": (
        lambda m: m["joints"].update(hinges={"pelvis": ["hip", "neck"]}),
        r"joints\.hinges: pelvis, hip, neck do not have the same sides",
    ),
    "no part": (lambda m: m["clothes"].update(garments={"hat": ["haed"]}), r'clothes\.garments\.hat: no part "haed"'),
    "no rigid part": (
        lambda m: m["rigid_ends"]["head"].update(parts=["haed"]),
        r'rigid_ends\.head\.parts: no part "haed".*"head"',
    ),
    "no rigid landmark": (
        lambda m: m["rigid_ends"]["head"].update(landmarks=["hed_top"]),
        r'rigid_ends\.head\.landmarks: no landmark "hed_top".*"head_top"',
    ),
    "nothing rigid": (lambda m: m["rigid_ends"]["head"].pop("parts"), r"rigid_ends\.head\.parts: Field required"),
    "rigid limb": (
        lambda m: m["rigid_ends"].update(left_arm={"parts": ["left_hand"]}),
        r"rigid_ends\.left_arm: a group has this name",
    ),
    "no curve": (lambda m: m["movements"][CURVES].pop("curves"), r"movements\.two_elbow_rotation\.curves: Field req"),
    "no such curve": (
        lambda m: m["movements"][CURVES]["curves"].update(arm_twst=1),
        r'movements\.two_elbow_rotation\.curves: no parameter "arm_twst"',
    ),
    "unknown term": (
        lambda m: m["movements"][CURVES]["curves"].update(arm_twist=[{"swng": 1}]),
        r'arm_twist\.0: unknown key "swng"; did you mean "swing"',
    ),
    "two amounts": (
        lambda m: m["movements"][CURVES]["curves"].update(arm_twist=[{"swing": 1, "dip": 2, "period_s": 1}]),
        r"a term needs one of at, .*found swing, dip",
    ),
    "no period": (
        lambda m: m["movements"][CURVES]["curves"].update(arm_twist=[{"swing": 1}]),
        r"arm_twist\.0: swing needs period_s",
    ),
    "a key of another term": (
        lambda m: m["movements"][CURVES]["curves"].update(arm_twist=[{"dip": 1, "period_s": 1, "phase": 0.5}]),
        r'"phase" has no meaning for dip',
    ),
    "an ease back in time": (
        lambda m: m["movements"][CURVES]["curves"].update(arm_twist=[{"ease": 1, "from_s": 2, "to_s": 1}]),
        r"ease needs to_s after from_s",
    ),
}


def test_a_rigid_end_has_its_own_parts_and_landmarks_and_is_no_limb(tmp_path: Path) -> None:
    def stumps(table: dict[str, Any]) -> None:
        table["rigid_ends"]["fists"] = {"parts": ["hand"], "landmarks": ["wrist"]}

    path = tmp_path / "kept.toml"
    save_description(read_description(changed(tmp_path, "gavrila22", stumps)), path)
    body = load_body(path)
    assert body.doubted_ends == (*body.limbs, "head", "fists")
    assert len(body.limbs) == 4
    for end, parts, marks in (
        ("head", {"head"}, {"head_top"}),
        ("fists", {"left_hand", "right_hand"}, {"left_wrist", "right_wrist"}),
    ):
        assert {part.name for part, own in zip(body.parts, body.parts_of(end), strict=True) if own} == parts
        assert {name for name, own in zip(body.landmark_names, body.landmarks_of(end), strict=True) if own} == marks
    with pytest.raises(ModelError, match=r'no group "hed".*"head"'):
        body.parts_of("hed")
    with pytest.raises(ModelError, match='no group "head"'):
        body.group("head")


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_entry_is_one_line_that_names_it(fault: str, tmp_path: Path) -> None:
    change, reason = FAULTS[fault]
    with pytest.raises(ModelError, match=reason) as refusal:
        load_body(changed(tmp_path, "gavrila22", change))
    assert "\n" not in str(refusal.value)


def test_a_body_without_a_long_axis_loads_and_says_so_where_it_is_looked_for(tmp_path: Path) -> None:
    def without_axis(table: dict[str, Any]) -> None:
        without(*SECTIONS, "links", "keypoints", "rigid_ends")(table)
        table["landmarks"] = {name: mark for name, mark in table["landmarks"].items() if "_wrist" in name}

    body: BodyModel = load_body(changed(tmp_path, "gavrila22", without_axis))
    assert body.start.head == ""
    with pytest.raises(ModelError, match=r'model "gavrila22": bootstrapping needs two landmarks.*\[start\]'):
        axis_marks(body)


def _flipped(table: dict[str, Any]) -> None:
    table["segments"][0]["parameters"][1]["axis"] = [0, -1, 0]


def _turned_first(table: dict[str, Any]) -> None:
    parameters = table["segments"][0]["parameters"]
    table["segments"][0]["parameters"] = parameters[3:] + parameters[:3]


@pytest.mark.parametrize("change", [_flipped, _turned_first])
def test_a_root_that_does_not_move_along_the_axes_of_the_world_is_refused(
    change: Callable[[dict[str, Any]], Any], tmp_path: Path
) -> None:
    body = load_body(changed(tmp_path, "gavrila22", change))
    with pytest.raises(ModelError, match="expected a root segment that moves along x, y and z") as refusal:
        axis_marks(body)
    assert "\n" not in str(refusal.value)
