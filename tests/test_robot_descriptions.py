"""Robots' descriptions, URDF and MJCF: a quadruped and an arm of our own in the form of public ones."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trimesh.creation import icosphere
from typer.testing import CliRunner

from tracker.acquisition.robot import body_of, stands_at
from tracker.bodies.body.description import load_body
from tracker.bodies.body.surface import segments_in_world
from tracker.bodies.robots.mjcf import read_mjcf
from tracker.bodies.robots.urdf import read_urdf
from tracker.bodies.skin import ScannedSurface, write_surface
from tracker.foundation.errors import ConfigError, ModelError
from tracker.running.cli import app

LEGS = {f"{front}{side}": (x, y) for front, x in (("F", 0.2), ("H", -0.2)) for side, y in (("L", 0.11), ("R", -0.11))}


def leg(name, x, y):
    """Three joints, as of most quadrupeds: the first about x, two about y."""
    return f"""
    <link name="{name}_hip"><visual><geometry><sphere radius="0.045"/></geometry></visual></link>
    <link name="{name}_thigh"><visual><origin xyz="0 0 -0.1"/>
      <geometry><box size="0.04 0.03 0.24"/></geometry></visual></link>
    <link name="{name}_calf"><visual><origin xyz="0 0 -0.1"/>
      <geometry><cylinder radius="0.015" length="0.2"/></geometry></visual></link>
    <link name="{name}_foot"><visual><geometry><sphere radius="0.02"/></geometry></visual></link>
    <joint name="{name}_abduction" type="revolute"><parent link="trunk"/><child link="{name}_hip"/>
      <origin xyz="{x} {y / 2} 0"/><axis xyz="1 0 0"/><limit lower="-0.8" upper="0.8" effort="1" velocity="1"/></joint>
    <joint name="{name}_swing" type="revolute"><parent link="{name}_hip"/><child link="{name}_thigh"/>
      <origin xyz="0 {y / 2} 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="3" effort="1" velocity="1"/></joint>
    <joint name="{name}_bend" type="revolute"><parent link="{name}_thigh"/><child link="{name}_calf"/>
      <origin xyz="0 0 -0.22"/><axis xyz="0 1 0"/><limit lower="-2.7" upper="-0.5" effort="1" velocity="1"/></joint>
    <joint name="{name}_sole" type="fixed"><parent link="{name}_calf"/><child link="{name}_foot"/>
      <origin xyz="0 0 -0.21"/></joint>"""


QUADRUPED = f"""<?xml version="1.0"?>
<robot name="dog">
  <link name="trunk">
    <visual><geometry><box size="0.45 0.16 0.11"/></geometry></visual>
    <visual><origin xyz="0.25 0 0.05" rpy="0 1.5708 0"/>
      <geometry><cylinder radius="0.05" length="0.1"/></geometry></visual>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
  </link>{"".join(leg(name, *at) for name, at in LEGS.items())}
</robot>"""

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"><visual><origin xyz="0 0 0.06"/>
    <geometry><cylinder radius="0.08" length="0.12"/></geometry></visual></link>
  <link name="shoulder"><visual><origin xyz="0 0 0.12"/><geometry><mesh filename="package://arm/meshes/bar.ply"
    scale="0.001 0.001 0.001"/></geometry></visual></link>
  <link name="upper"><visual><origin xyz="0 0 0.2"/><geometry><box size="0.09 0.07 0.44"/></geometry></visual></link>
  <link name="fore"><visual><origin xyz="0 0 0.16"/><geometry><box size="0.06 0.05 0.36"/></geometry></visual></link>
  <link name="hand"><visual><origin xyz="0 0 0.05"/><geometry><box size="0.1 0.03 0.1"/></geometry></visual></link>
  <joint name="pan" type="continuous"><parent link="base"/><child link="shoulder"/><origin xyz="0 0 0.12"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="lift" type="revolute"><parent link="shoulder"/><child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0 0 1.5707963"/><axis xyz="1 0 0"/>
    <limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.42"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="2.4" effort="1" velocity="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="fore"/><child link="hand"/>
    <origin xyz="0 0 0.33"/><axis xyz="0 0 1"/><limit lower="0" upper="0.1" effort="1" velocity="1"/>
    <mimic joint="elbow"/></joint>
</robot>"""

ARM_MJCF = """<mujoco model="arm">
  <compiler angle="radian" meshdir="meshes"/>
  <default>
    <geom group="3"/>
    <default class="seen"><geom group="2" contype="0" conaffinity="0"/></default>
    <default class="bending"><joint axis="1 0 0"/></default>
  </default>
  <asset><mesh name="bar" file="bar.ply" scale="0.001 0.001 0.001"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="base" childclass="seen">
      <geom type="cylinder" size="0.08 0.06" pos="0 0 0.06"/>
      <geom class="main" type="box" size="1 1 1"/>
      <body name="shoulder" pos="0 0 0.12">
        <joint name="pan"/>
        <geom type="mesh" mesh="bar" pos="0 0 0.12"/>
        <frame pos="0 0 0.1" euler="0 0 1.5707963">
          <body name="upper">
            <joint name="lift" class="bending" range="-1.5 1.5"/>
            <geom type="box" size="0.045 0.035 0.22" pos="0 0 0.2"/>
            <body name="fore" pos="0 0 0.42">
              <joint name="elbow" class="bending" range="0 2.4"/>
              <geom type="box" fromto="0 0 -0.02 0 0 0.34" size="0.03 0.025"/>
              <body name="hand" pos="0 0 0.33">
                <joint name="slide" type="slide" range="0.05 0.15" ref="0.05" axis="0 0 1"/>
                <geom type="box" size="0.05 0.015 0.05" pos="0 0 0.05"/>
              </body>
            </body>
          </body>
        </frame>
      </body>
    </body>
  </worldbody>
</mujoco>"""


@pytest.fixture
def arm(tmp_path):
    """Where an arm's description lies, with its mesh of millimetres beside it."""
    folder = tmp_path / "arm"
    (folder / "meshes").mkdir(parents=True)
    (folder / "urdf").mkdir()
    corners = np.array([[x, y, z] for x in (-40, 40) for y in (-40, 40) for z in (-120, 0)], dtype=np.float64)
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
    ]
    faces += [[1, 5, 7], [1, 7, 3]]
    write_surface(ScannedSurface(corners, np.array(faces)), folder / "meshes" / "bar.ply")
    (folder / "urdf" / "arm.urdf").write_text(ARM)
    (folder / "arm.xml").write_text(ARM_MJCF)
    return folder


def written(folder, text, name="robot.urdf"):
    path = folder / name
    path.write_text(text)
    return path


def hand_at(pan, lift, elbow, slide):
    """Where the hand's frame is by the description, worked out by hand: bends are about y, the axis turned by 90."""
    upper = Rotation.from_euler("ZYX", [pan, lift, 0])
    fore = Rotation.from_euler("ZYX", [pan, lift + elbow, 0])
    return np.array([0, 0, 0.22]) + upper.apply([0, 0, 0.42]) + fore.apply([0, 0, 0.33 + slide])


@pytest.mark.parametrize(("read", "name"), [(read_urdf, "urdf/arm.urdf"), (read_mjcf, "arm.xml")])
def test_an_arm_moves_as_it_is_described(arm, read, name):
    robot = read(arm / name)
    made = body_of(robot, "arm", robot.free, stands_at((0.5, -0.2, 0.8), 90))
    body = made.description.build()
    assert body.names == ("pan", "lift", "elbow", "slide")
    limits = [(-200 * np.pi, 200 * np.pi), (-1.5, 1.5), (0, 2.4), (0, 0.1)]
    np.testing.assert_allclose(body.limits, limits, atol=1e-6)
    assert [part.segment for part in body.parts] == ["world", "shoulder", "upper", "fore", "hand"]
    q = np.array([0.7, -0.4, 1.1, 0.06])
    hand = [segment.name for segment in body.segments].index("hand")
    found = segments_in_world(body, q[None])[0, hand, :3, 3]
    turned = Rotation.from_euler("z", 90, degrees=True).apply(hand_at(*q))
    np.testing.assert_allclose(found, turned + np.array([0.5, -0.2, 0.8]), atol=1e-6)
    # what is seen of it is there too, where all joints are zero: from the floor of its base to the tip of its hand
    np.testing.assert_allclose(made.surface.points[:, 2].min(), 0.8, atol=1e-6)
    np.testing.assert_allclose(made.surface.points[:, 2].max(), 0.8 + 0.22 + 0.42 + 0.33 + 0.1, atol=1e-6)


def test_both_descriptions_of_an_arm_make_the_same_body(arm):
    made = [
        body_of(robot, "arm", False, np.eye(4))
        for robot in (read_urdf(arm / "urdf/arm.urdf"), read_mjcf(arm / "arm.xml"))
    ]
    q = np.array([[0.7, -0.4, 1.1, 0.06]])
    placed = [segments_in_world(one.description.build(), q) for one in made]
    np.testing.assert_allclose(placed[0], placed[1], atol=1e-6)
    sizes = [[part.radii for part in one.description.parts] for one in made]
    np.testing.assert_allclose(sizes[0], sizes[1], atol=0.004)


def test_a_quadruped_moves_about_and_stands_on_its_feet(tmp_path):
    robot = read_urdf(written(tmp_path, QUADRUPED))
    made = body_of(robot, "dog", True, np.eye(4))
    body = made.description.build()
    assert body.dof == 6 + 12
    assert len(body.parts) == 13  # feet are part of calves
    assert (body.root.turn, list(body.root.shifts)) == (5, [0, 1, 2])
    assert body.limits[body.index("FL_bend")] == pytest.approx((-2.7, -0.5))
    assert len(body.ends) == 4
    q = np.zeros(body.dof)
    q[:6] = 1.0, 2.0, 0.5, 0.0, 0.0, np.pi / 2
    q[body.index("FL_swing")], q[body.index("FL_bend")] = 0.6, -1.2
    (calf,) = (k for k, segment in enumerate(body.segments) if segment.name == "FL_calf")
    placed = segments_in_world(body, q[None])[0, calf]
    # ahead is y now; the thigh leans back by 0.6, the calf forwards by as much
    thigh = Rotation.from_euler("y", 0.6).apply([0, 0, -0.22])
    knee = np.array([1.0, 2.0, 0.5]) + Rotation.from_euler("z", np.pi / 2).apply([0.2 + thigh[0], 0.11, thigh[2]])
    np.testing.assert_allclose(placed[:3, 3], knee, atol=1e-6)


def test_parts_are_about_as_large_as_what_they_stand_for(tmp_path):
    made = body_of(read_urdf(written(tmp_path, QUADRUPED)), "dog", True, np.eye(4))
    sizes = {
        part.name: sorted([*part.radii, np.linalg.norm(np.subtract(part.end, part.start)) / 2])
        for part in made.description.parts
    }
    np.testing.assert_allclose(sizes["FL_hip"], 0.045, atol=0.005)
    np.testing.assert_allclose(sizes["FL_thigh"], [0.015, 0.02, 0.12], atol=0.01)
    assert max(fit.rms_m for name, fit in made.fits.items() if name != "trunk") < 0.01  # whose head stands out of it


def test_what_is_not_read_is_named(arm):
    text = ARM.replace("package://arm/meshes/bar", "package://arm/meshes/rod").replace(
        'type="continuous"', 'type="revolute"'
    )
    robot = read_urdf(written(arm / "urdf", text))
    told = "\n".join(robot.unread)
    assert "package://arm/meshes/rod.ply: no folder arm with it lies around" in told
    assert 'joint "slide" follows "elbow" there, here it moves by itself' in told
    assert 'joint "pan" has no limits, here it goes from -3.14159 to 3.14159' in told
    assert robot.links[0].surface is None


def test_a_shape_for_collisions_stands_for_a_mesh_that_cannot_be_read(tmp_path):
    seen = '<visual><geometry><mesh filename="none.dae"/></geometry></visual>'
    text = ARM.replace('<link name="hand">', f'<link name="hand">{seen}').replace(
        '<visual><origin xyz="0 0 0.05"/><geometry><box size="0.1 0.03 0.1"/></geometry></visual>',
        '<collision><geometry><sphere radius="0.07"/></geometry></collision>',
    )
    robot = read_urdf(written(tmp_path, text))
    assert 'link "hand" has its shape for collisions here' in robot.unread
    assert np.ptp(robot.links[-1].surface.points, axis=0) == pytest.approx([0.14] * 3, abs=0.003)


@pytest.mark.parametrize(
    ("found", "instead", "words"),
    [
        ("<robot", "<sdf", "not an XML file"),
        ('name="dog"', 'xmlns:xacro="http://x"><xacro:leg/></robot><!--', "not an XML file|a xacro file"),
        ('type="fixed"', 'type="hinge"', 'type "hinge"; valid'),
        ('<child link="FL_hip"/>', '<child link="FL_hop"/>', 'no link "FL_hop"; did you mean "FL_hip"'),
        ('<child link="HR_foot"/>', '<child link="HL_foot"/>', 'link "HL_foot" hangs on two joints'),
        ('<axis xyz="1 0 0"/>', '<axis xyz="0 0 0"/>', "its axis has no length"),
        ('<axis xyz="1 0 0"/>', '<axis xyz="1 0"/>', "expected 3 numbers"),
        ('<link name="trunk">', '<link name="lid"/><link name="trunk">', "2 links hang on no joint"),
    ],
)
def test_what_is_no_robot_is_one_clear_line(tmp_path, found, instead, words):
    assert found in QUADRUPED
    with pytest.raises(ModelError, match=words) as caught:
        read_urdf(written(tmp_path, QUADRUPED.replace(found, instead, 1)))
    assert "\n" not in str(caught.value)


def test_a_xacro_file_is_named_for_what_it_is(tmp_path):
    text = ARM.replace("0.12", "${height}", 1)
    with pytest.raises(ModelError, match=r"a xacro file.*xacro robot\.urdf > robot\.urdf"):
        read_urdf(written(tmp_path, text))


@pytest.mark.parametrize(
    ("found", "instead", "words"),
    [
        ('class="bending" range="-1.5', 'class="bendin" range="-1.5', 'class "bendin"; did you mean "bending"'),
        ("<compiler", '<compiler coordinate="global"', 'coordinate="global"'),
        ('type="slide"', 'type="screw"', 'type "screw", expected hinge'),
        ("worldbody", "world", "no body in it"),
        ('<light pos="0 0 3"/>', '<include file="none.xml"/>', "cannot read an included file"),
    ],
)
def test_what_is_no_mjcf_is_one_clear_line(arm, found, instead, words):
    with pytest.raises(ModelError, match=words):
        read_mjcf(written(arm, ARM_MJCF.replace(found, instead), "robot.xml"))


def test_files_that_an_mjcf_includes_and_a_free_base_are_read(arm):
    body = ARM_MJCF[ARM_MJCF.index('<body name="base"') : ARM_MJCF.rindex("</worldbody>")]
    (arm / "body.xml").write_text(f"<mujocoinclude>{body}</mujocoinclude>")
    text = ARM_MJCF.replace(body, '<include file="body.xml"/>')
    assert [link.name for link in read_mjcf(written(arm, text, "a.xml")).links] == ["shoulder", "upper", "fore", "hand"]
    free = ARM_MJCF.replace('<body name="base" childclass="seen">', '<body name="base" childclass="seen"><freejoint/>')
    robot = read_mjcf(written(arm, free, "b.xml"))
    assert robot.free
    assert body_of(robot, "arm", True, np.eye(4)).description.build().names[:3] == ("base_x", "base_y", "base_z")
    ball = ARM_MJCF.replace('type="slide" range="0.05 0.15" ref="0.05"', 'type="ball" range="0 0.5"')
    limits = [joint.limits for joint in read_mjcf(written(arm, ball, "c.xml")).links[-1].joints]
    assert limits == [(-0.5, 0.5)] * 3


def test_the_command_makes_a_model_with_its_skin(tmp_path):
    path = written(tmp_path, QUADRUPED.replace("</robot>", '<link name="tail"><visual/></link></robot>'))
    arguments = ["acquire", str(path), "--set", "robot.base=free", "--output", str(tmp_path / "out" / "dog.toml")]
    told = CliRunner().invoke(app, arguments)
    assert isinstance(told.exception, ModelError)
    assert "2 links hang on no joint (trunk, tail)" in str(told.exception)
    path.write_text(QUADRUPED.replace('<sphere radius="0.045"/>', '<mesh filename="none.stl"/>', 1))
    told = CliRunner().invoke(app, arguments)
    assert told.exit_code == 0, told.output
    body = load_body(tmp_path / "out" / "dog.toml")
    assert body.root.turn == 5
    assert body.skin is not None
    assert len(body.parts) == 12  # nothing of one link is seen
    outcome = json.loads((tmp_path / "out" / "dog.json").read_text())
    assert outcome["overlaps"]["side"] > 0.8
    assert "none.stl: cannot read the mesh: No such file" in " ".join(told.output.split())


@pytest.mark.parametrize(("changes", "words"), [("base=loose", "base = 'loose'"), ("bas=free", 'did you mean "base"')])
def test_settings_of_a_robot_are_checked(tmp_path, changes, words):
    told = CliRunner().invoke(app, ["acquire", str(written(tmp_path, QUADRUPED)), "--set", f"robot.{changes}"])
    assert isinstance(told.exception, ConfigError), told.output
    assert words in str(told.exception)


def test_a_mesh_of_many_triangles_is_thinned(tmp_path):
    mesh = icosphere(subdivisions=5, radius=0.1)
    write_surface(ScannedSurface(np.array(mesh.vertices), np.array(mesh.faces)), tmp_path / "ball.ply")
    ball = '<mesh filename="ball.ply"/>'
    robot = read_urdf(written(tmp_path, QUADRUPED.replace('<sphere radius="0.045"/>', ball, 1)))
    surface = robot.links[0].surface
    assert len(mesh.faces) > 20000
    assert len(surface.faces) < 5000
    distances = np.linalg.norm(surface.points - [0.2, 0.055, 0], axis=1)
    assert np.abs(distances - 0.1).max() < 0.001
