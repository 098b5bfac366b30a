"""Skeletons in BVH and GLB, read back with other libraries, to a hundredth of a millimetre."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace

import bvhio
import numpy as np
import pygltflib
import pytest
from doubted import in_doubt
from exported import HUNDREDTH_MM, motion_of
from motions import INTERVAL_S, LOST, N_FRAMES, made_up
from scipy.spatial.transform import Rotation

from tracker.bodies.body.description import load_body
from tracker.bodies.body.surface import surface_of
from tracker.bodies.skin import Skin
from tracker.results.recording._motion import Y_UP, Motion
from tracker.results.recording.bvh import Bvh
from tracker.results.recording.glb import Glb
from tracker.tracking.estimate import Status


def test_bvh_is_read_back(movement, tmp_path):
    """Every joint of every frame, forward kinematics by bvhio."""
    files = movement.record(Bvh(), tmp_path)
    for k, file in enumerate(files):
        motion = motion_of(movement, k)
        joints = motion.segments(motion.filled)[..., :3, 3]
        assert f"Frame Time: {INTERVAL_S:.8f}" in file.read_text()
        root = bvhio.readAsHierarchy(str(file))
        layout = {joint.Name: joint for joint, _, _ in root.layout()}
        assert set(layout) >= {segment.name for segment in motion.body.segments}
        for t in range(N_FRAMES):
            root.loadPose(t)
            found = np.array([list(layout[s.name].PositionWorld) for s in motion.body.segments])
            np.testing.assert_allclose(found / 100 @ Y_UP, joints[t], atol=HUNDREDTH_MM)


@pytest.mark.parametrize("with_post", [True, False])
def test_bvh_of_what_hangs_on_the_world_has_one_root(with_post, tmp_path):
    """Readers such as bvhio and three.js take no second one."""
    file = tmp_path / "crane.toml"
    file.write_text(CRANE + (POST if with_post else "") + "]")
    body, n = load_body(file), 5
    assert sum(segment.parent < 0 for segment in body.segments) == (3 if with_post else 2)
    q = np.random.default_rng(0).uniform(*body.limits.T, (n, body.dof))
    nothing = np.zeros((n, body.dof, body.dof)), np.ones((n, len(body.parts)))
    motion = Motion("crane", body, np.arange(n) / 25, 0.04, q, np.zeros(n, bool), *nothing)
    root = bvhio.readAsHierarchy(str(Bvh()._written(motion, tmp_path)))
    assert root.Name == "world"
    layout, joints = {joint.Name: joint for joint, _, _ in root.layout()}, motion.segments(q)[..., :3, 3]
    for t in range(n):
        root.loadPose(t)
        found = np.array([list(layout[segment.name].PositionWorld) for segment in body.segments])
        np.testing.assert_allclose(found / 100 @ Y_UP, joints[t], atol=HUNDREDTH_MM)


CRANE = """name = "crane"
segments = [
    { name = "arm", joint = [0.3, 0.2, 1.7], parameters = [{ name = "up", axis = [0, 1, 0], limits_deg = [-90, 90] }] },
    { name = "hand", parent = "arm", joint = [0.3, 0.2, 1.2], parameters = [
        { name = "bend", axis = [1, 0, 0], limits_deg = [-90, 90] },
    ] },
    { name = "sledge", joint = [0, -1, 0.4], parameters = [{ name = "x", axis = [1, 0, 0], limits_m = [-0.5, 0.5] }] },
]
parts = [
    { name = "arm", segment = "arm", start = [0.3, 0.2, 1.7], end = [0.3, 0.2, 1.2], radii = [0.05, 0.05] },
    { name = "hand", segment = "hand", start = [0.3, 0.2, 1.2], end = [0.3, 0.2, 0.9], radii = [0.05, 0.05] },
    { name = "sledge", segment = "sledge", start = [0, -1, 0.3], end = [0, -1, 0.5], radii = [0.1, 0.1] },
"""

POST = '{ name = "post", segment = "world", start = [-0.3, 0, 0], end = [-0.3, 0, 1.9], radii = [0.06, 0.06] },'


def test_bvh_angles_go_on_without_jumps(tmp_path):
    movement = made_up("gavrila22", "gavrila22")
    text = movement.record(Bvh(), tmp_path)[1].read_text()
    rows = np.array([line.split() for line in text.split("Frame Time")[1].splitlines()[1:]], dtype=float)
    assert len(rows) == N_FRAMES
    assert np.abs(np.diff(rows[:, 3:], axis=0)).max() < 90


def accessor(gltf, index):
    """An array of a GLB file, by pygltflib's account of where it lies."""
    told = gltf.accessors[index]
    view = gltf.bufferViews[told.bufferView]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[told.type]
    kind = {5126: "<f4", 5121: "u1", 5125: "<u4"}[told.componentType]
    flat = np.frombuffer(gltf.binary_blob(), kind, told.count * width, view.byteOffset)
    return flat.reshape(told.count, width) if width > 1 else flat


def in_world(gltf, keys, n, t):
    """(4, 4) of a node in frame t: its keys over its own placement, on its parent's."""
    node, own = gltf.nodes[n], np.eye(4)
    own[:3, 3] = keys[n, "translation"][t] if (n, "translation") in keys else node.translation or 0
    if (n, "rotation") in keys or node.rotation:
        turn = keys[n, "rotation"][t] if (n, "rotation") in keys else node.rotation
        own[:3, :3] = Rotation.from_quat(turn).as_matrix()
    parent = next((k for k, other in enumerate(gltf.nodes) if n in (other.children or ())), None)
    return own if parent is None else in_world(gltf, keys, parent, t) @ own


def test_glb_is_read_back(movement, tmp_path):
    """Every vertex of every frame, skinned as the specification says, lies where its part's surface does."""
    for k, file in enumerate(movement.record(Glb(), tmp_path)):
        gltf, motion = pygltflib.GLTF2().load(str(file)), motion_of(movement, k)
        primitive, skin = gltf.meshes[0].primitives[0], gltf.skins[0]
        points, bones = (accessor(gltf, getattr(primitive.attributes, name)) for name in ("POSITION", "JOINTS_0"))
        binds = accessor(gltf, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        keys = {}
        for channel in gltf.animations[0].channels:
            sampler = gltf.animations[0].samplers[channel.sampler]
            np.testing.assert_allclose(accessor(gltf, sampler.input), INTERVAL_S * np.arange(N_FRAMES), atol=1e-6)
            keys[channel.target.node, channel.target.path] = accessor(gltf, sampler.output)
        placed = motion.body.world_from_part(motion.filled)
        n_part = len(points) // len(motion.body.parts)
        eta, omega = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, 13), 2 * np.pi * np.arange(16) / 16, indexing="ij")
        for t in range(N_FRAMES):
            moves = np.array([in_world(gltf, keys, joint, t) for joint in skin.joints]) @ binds
            skinned = (moves[bones[:, 0]] @ np.pad(points, ((0, 0), (0, 1)), constant_values=1.0)[..., None])[:, :3, 0]
            for p, part in enumerate(motion.body.parts):
                surface, _ = part.shape.surface(eta, omega)
                wanted = surface.reshape(-1, 3) @ placed[t, p, :3, :3].T + placed[t, p, :3, 3]
                found = skinned[p * n_part : (p + 1) * n_part] @ Y_UP
                np.testing.assert_allclose(found, wanted, atol=HUNDREDTH_MM)
        extras = gltf.animations[0].extras
        lost = [step.frame.index for step in movement.steps[LOST]]
        assert extras.get("interpolated_frames") == (lost if k == 0 else None)


def test_a_skin_is_animated_as_it_moves_here(tmp_path):
    """A skin measured in a bent pose, several parts at a vertex: linear blend skinning as the format has it."""
    movement = with_skin(made_up("gavrila22"))
    (file,) = movement.record(Glb(), tmp_path)
    body, gltf, motion = movement.scene.persons[0].body, pygltflib.GLTF2().load(str(file)), motion_of(movement)
    primitive, skin = gltf.meshes[0].primitives[0], gltf.skins[0]
    points, normals, bones, weights = (
        accessor(gltf, getattr(primitive.attributes, name)) for name in ("POSITION", "NORMAL", "JOINTS_0", "WEIGHTS_0")
    )
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert (weights > 0.01).sum(axis=1).max() > 1
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    binds = accessor(gltf, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    keys = {
        (channel.target.node, channel.target.path): accessor(gltf, gltf.animations[0].samplers[channel.sampler].output)
        for channel in gltf.animations[0].channels
    }
    homogeneous = np.pad(points, ((0, 0), (0, 1)), constant_values=1.0)
    for t in (0, N_FRAMES - 1):
        moves = np.array([in_world(gltf, keys, joint, t) for joint in skin.joints]) @ binds
        found = np.einsum("nk,nkij,nj->ni", weights, moves[bones], homogeneous)[:, :3] @ Y_UP
        wanted = body.skin.world_points(body.world_from_part(motion.filled[t]))
        np.testing.assert_allclose(found, wanted, atol=HUNDREDTH_MM)


def with_skin(movement):
    """The movement of a body whose parts' surfaces, in the pose of a frame, are its skin."""
    person = movement.scene.persons[0]
    body, q = person.body, movement.poses[0][8]
    surface, parts = surface_of(body, 9, 12), body.world_from_part(q)
    numbers = [segment.name for segment in body.segments]
    moves = parts @ np.linalg.inv([part.model_from_part for part in body.parts])
    of_segment = [[numbers.index(part.segment) for part in body.parts].index(k) for k in surface.segments]
    bent = np.einsum("nij,nj->ni", moves[of_segment, :3, :3], surface.points) + moves[of_segment, :3, 3]
    gaps = np.linalg.norm(bent[:, None] - parts[:, :3, 3], axis=2)
    skin = Skin(bent, surface.faces, np.exp(-((gaps / 0.15) ** 2)) + 1e-9, np.linalg.inv(parts))
    scene = replace(movement.scene, persons=(replace(person, body=replace(body, skin=skin)),))
    steps = [
        replace(step, scene=scene.with_poses((q,))) for step, q in zip(movement.steps, movement.poses[0], strict=True)
    ]
    return replace(movement, scene=scene, steps=steps)


def test_glb_faces_look_outwards_and_turns_are_short(movement, tmp_path):
    gltf = pygltflib.GLTF2().load(str(movement.record(Glb(), tmp_path)[1]))
    primitive = gltf.meshes[0].primitives[0]
    points, normals = (accessor(gltf, getattr(primitive.attributes, name)) for name in ("POSITION", "NORMAL"))
    corners = points[accessor(gltf, primitive.indices).reshape(-1, 3)].astype(float)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = (across * normals[accessor(gltf, primitive.indices).reshape(-1, 3)[:, 0]]).sum(axis=1)
    assert (facing > 0).mean() > 0.99
    for channel in gltf.animations[0].channels:
        if channel.target.path == "rotation":
            turns = accessor(gltf, gltf.animations[0].samplers[channel.sampler].output)
            assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0).all()


def test_frames_that_are_not_to_be_relied_on_are_listed(tmp_path):
    movement = made_up("gavrila22")
    steps = list(movement.steps)
    steps[2] = replace(steps[2], estimates=(in_doubt(steps[2].estimates[0], whole=True),))
    steps[9] = replace(steps[9], estimates=(replace(steps[9].estimates[0], status=Status.FILLED),))
    (file,) = replace(movement, steps=steps).record(Glb(), tmp_path)
    (animation,) = pygltflib.GLTF2().load(str(file)).animations
    lost, doubtful = ([step.frame.index for step in chosen] for chosen in (steps[LOST], steps[2::7]))
    assert lost[0] != LOST.start  # numbers in the recording, not places in the animation
    assert animation.extras == {"interpolated_frames": lost, "doubtful_frames": doubtful}


@pytest.mark.parametrize("skinned", [False, True])
def test_the_validator_of_the_format_finds_nothing(movement, tmp_path, skinned):
    """Khronos' gltf-validator, where node and the package are at hand (npm install gltf-validator)."""
    script = (
        "const v = require('gltf-validator'), fs = require('fs');"
        "v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))"
        ".then(r => console.log(JSON.stringify(r.issues)))"
    )
    if shutil.which("node") is None or subprocess.run(["node", "-e", "require('gltf-validator')"], check=False,
                                                      capture_output=True).returncode:  # fmt: skip
        pytest.skip("no gltf-validator for node")
    for file in (with_skin(made_up("human")) if skinned else movement).record(Glb(), tmp_path):
        told = subprocess.run(["node", "-e", script, str(file)], capture_output=True, text=True, check=True)
        issues = json.loads(told.stdout)
        assert issues["messages"] == []
