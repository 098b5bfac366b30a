"""Poses sent by UDP: what a receiver of the VMC protocol gets."""

from __future__ import annotations

import json
import socket
import struct
from pathlib import Path

import numpy as np
import pytest
from motions import MODELS, made_up, performed
from scipy.spatial.transform import Rotation

from tracker.bodies.body.description import load_body
from tracker.bodies.body.surface import segments_in_world
from tracker.foundation.errors import ConfigError
from tracker.results.recording.osc import Osc, bones_of, bundle_of

HUMAN = load_body(MODELS / "human.toml")


def text_in(message: bytes, at: int) -> tuple[str, int]:
    """A string of a message, and where the next thing begins."""
    end = message.index(b"\0", at)
    return message[at:end].decode(), end + 4 - end % 4


def read(packet: bytes) -> list[tuple[str, list[object]]]:
    """An OSC bundle as the specification has it, read by nothing of ours."""
    assert packet[:16] == b"#bundle\0" + struct.pack(">Q", 1)
    found, place = [], 16
    while place < len(packet):
        (size,) = struct.unpack_from(">i", packet, place)
        message = packet[place + 4 : place + 4 + size]
        assert size % 4 == 0
        address, at = text_in(message, 0)
        tags, at = text_in(message, at)
        values: list[object] = []
        for tag in tags[1:]:
            if tag == "s":
                told, at = text_in(message, at)
                values.append(told)
            else:
                values.append(struct.unpack_from(f">{tag}", message, at)[0])
                at += 4
        assert at == size
        found.append((address, values))
        place += 4 + size
    return found


def test_a_t_pose_has_no_turns() -> None:
    """Arms that are raised sideways from where they hang."""
    q = HUMAN.rest()
    q[HUMAN.index("left_arm_abduction")] = q[HUMAN.index("right_arm_abduction")] = np.pi / 2
    bones = bones_of(HUMAN, q)
    assert len(bones) == 17
    for name, (_, turn) in bones.items():
        np.testing.assert_allclose(np.abs(turn), [0, 0, 0, 1], atol=1e-6, err_msg=name)
    assert bones["LeftLowerArm"][0][0] < -0.2, "the left arm points to Unity's -x"
    assert bones["RightLowerArm"][0][0] > 0.2
    assert bones["LeftLowerLeg"][0][1] < -0.3, "and shins lie below"


def test_bones_put_together_stand_where_the_segments_are() -> None:
    """Whoever chains places and turns from the hips on, as a receiver does, finds every joint, in Unity's axes."""
    q = HUMAN.clamped(HUMAN.rest() + 0.3 * np.random.default_rng(1).normal(size=HUMAN.dof))
    bones, placed = bones_of(HUMAN, q), segments_in_world(HUMAN, q[None])[0]
    chain = ["pelvis", "chest", "left_shoulder", "left_upper_arm", "left_forearm", "left_hand"]
    names = ["Hips", "Spine", "LeftShoulder", "LeftUpperArm", "LeftLowerArm", "LeftHand"]
    turn, place = Rotation.identity(), np.zeros(3)
    for segment, bone in zip(chain, names, strict=True):
        place = place + turn.apply(bones[bone][0])
        turn = turn * Rotation.from_quat(bones[bone][1])
        x, y, z = placed[[one.name for one in HUMAN.segments].index(segment), :3, 3]
        np.testing.assert_allclose(place, [-y, z, x], atol=1e-9)


def test_who_faces_our_x_faces_unitys_z_and_turns_to_the_left_the_same_way() -> None:
    q = HUMAN.rest()
    q[HUMAN.index("torso_twist")] = 0.4
    turn = Rotation.from_quat(bones_of(HUMAN, q)["Hips"][1])
    np.testing.assert_allclose(turn.apply([0, 0, 1]), [-np.sin(0.4), 0, np.cos(0.4)], atol=1e-9)


def test_frames_are_sent_as_they_come(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        lost = np.array([False, True])
        movement = performed(HUMAN, np.tile(HUMAN.rest(), (2, 1)), lost)
        movement.record(Osc(port=receiver.getsockname()[1]), tmp_path)
        here, gone = (dict(read(receiver.recv(65536))[:2]) for _ in range(2))
        assert here["/VMC/Ext/OK"] == [1]
        assert gone == {"/VMC/Ext/OK": [0], "/VMC/Ext/T": [pytest.approx(0.04)]}
    told = json.loads((tmp_path / "osc.json").read_text())
    assert told["frames"] == 2
    assert "LeftUpperArm" in told["persons"][0]["bones"]


def test_a_bundle_holds_every_bone() -> None:
    bones = bones_of(HUMAN, HUMAN.rest())
    told = read(bundle_of(1.5, bones))
    assert told[:3] == [
        ("/VMC/Ext/OK", [1]),
        ("/VMC/Ext/T", [1.5]),
        ("/VMC/Ext/Root/Pos", ["root", 0, 0, 0, 0, 0, 0, 1]),
    ]
    assert {address for address, _ in told[3:]} == {"/VMC/Ext/Bone/Pos"}
    assert {values[0] for _, values in told[3:]} == set(bones)
    assert all(len(values) == 8 for _, values in told[3:])


def test_an_address_that_is_none_is_refused_before_the_first_frame(tmp_path: Path) -> None:
    movement = made_up("human", "gavrila22")
    with pytest.raises(ConfigError, match="expected a name or an address"):
        Osc(host="no such machine.invalid").begin(movement.context(tmp_path))
    with pytest.raises(ConfigError, match="the last person's would be 65536"):
        Osc(port=65535).begin(movement.context(tmp_path))
