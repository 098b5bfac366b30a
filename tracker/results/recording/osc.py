"""Sends poses during the run, in the form that add-ons of Unity, Blender, Unreal and Godot read: VMC protocol over OSC.

VMC protocol: https://protocol.vmc.info/english. OSC 1.0: https://opensoundcontrol.stanford.edu/spec-1_0.html.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pydantic
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.bodies.body.surface import segments_in_world
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError
from tracker.foundation.files import write_json
from tracker.results.recording import RunContext
from tracker.tracking.trajectory import Step

_UNITY = np.array([[0.0, -1, 0], [0, 0, 1], [1, 0, 0]])
"""From our axes (x to the front, y to the left, z up) to Unity's: x to the right, y up, z to the front, left-handed."""

_BONES = {
    **{"pelvis": "Hips", "chest": "Spine", "head": "Head"},
    **{
        f"{side}_{segment}": f"{side.title()}{bone}"
        for side in ("left", "right")
        for segment, bone in (
            *(("shoulder", "Shoulder"), ("upper_arm", "UpperArm"), ("forearm", "LowerArm"), ("hand", "Hand")),
            *(("thigh", "UpperLeg"), ("shin", "LowerLeg"), ("foot", "Foot")),
        )
    },
}
"""Segment of the bundled persons -> bone of Unity's `HumanBodyBones`."""

_ARMS = "upper_arm", "forearm", "hand"
"""Segments that hang in our reference pose, and are held sideways in the protocol's T-pose."""


@component
class Osc:
    """Sends each frame by UDP as soon as it is tracked, in the VMC protocol; `osc.json` describes the data.

    The turn of every bone is against its parent, from a T-pose on. A lost person is sent as absent. With `passes = 2`
    frames are sent when their window is done.
    """

    host: str = "127.0.0.1"
    """Name or address of the receiver."""

    port: int = pydantic.Field(default=39539, ge=1, le=65535)
    """Port for the first person; the second person has the next one, and so on. Receivers of the protocol listen to
    39539."""

    def begin(self, run: RunContext) -> OscRecorder:
        """Opens the socket."""
        last = self.port + len(run.scene.persons) - 1
        try:
            places = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise ConfigError(f'osc: host = "{self.host}": {error.strerror}; expected a name or an address') from error
        if last > 65535:
            raise ConfigError(f"osc: port = {self.port}: the last person's would be {last}, expected at most 65535")
        return OscRecorder(run, self, places[0])


class OscRecorder:
    """The socket, and the number of frames sent."""

    def __init__(self, run: RunContext, settings: Osc, place: tuple) -> None:  # type: ignore[type-arg]
        """Nothing is sent yet; `place` is from `socket.getaddrinfo`."""
        self._run, self._settings, self._place = run, settings, place
        self._socket = socket.socket(place[0], socket.SOCK_DGRAM)
        self._n_sent = 0

    def write(self, step: Step) -> None:
        """Sends a frame; nobody checks that it arrives."""
        for k, (person, estimate) in enumerate(zip(step.scene.persons, step.estimates, strict=True)):
            poses = {} if estimate.lost else bones_of(person.body, estimate.q)
            host, _, *rest = self._place[4]
            self._socket.sendto(bundle_of(step.frame.time_s, poses), (host, self._settings.port + k, *rest))
        self._n_sent += 1

    def finish(self) -> tuple[Path, ...]:
        """Closes the socket, and writes the description."""
        self._socket.close()
        path = self._run.folder / "osc.json"
        persons = [
            {"name": one.name, "port": self._settings.port + k, "bones": sorted(bones_of(one.body, one.body.rest()))}
            for k, one in enumerate(self._run.scene.persons)
        ]
        write_json(path, {"host": self._settings.host, "frames": self._n_sent, "persons": persons})
        return (path,)


def bones_of(body: BodyModel, q: Array) -> dict[str, tuple[Array, Array]]:
    """Bone -> place (3,) in its parent's frame, metres, and turn (4,) against it from a T-pose on, x y z w.

    Axes are Unity's. The parent of the first bones is the world.
    """
    placed = segments_in_world(body, q[None])[0]
    motions = [_from_t_pose(segment.name, placed[k]) for k, segment in enumerate(body.segments)]
    found = {}
    for k, segment in enumerate(body.segments):
        if segment.name in _BONES:
            parent = segment.parent
            while parent >= 0 and body.segments[parent].name not in _BONES:
                parent = body.segments[parent].parent
            local = motions[k] if parent < 0 else np.linalg.inv(motions[parent]) @ motions[k]
            turn = Rotation.from_matrix(_UNITY @ local[:3, :3] @ _UNITY.T).as_quat()
            found[_BONES[segment.name]] = _UNITY @ local[:3, 3], turn
    return found


def _from_t_pose(name: str, placed: Array) -> Array:
    """(4, 4) a segment's placement, of which the T-pose has no turn."""
    side, _, segment = name.partition("_")
    if segment not in _ARMS:
        return placed
    lowered = np.eye(4)
    lowered[:3, :3] = Rotation.from_euler("x", -90 if side == "left" else 90, degrees=True).as_matrix()
    return placed @ lowered


def bundle_of(time_s: float, bones: dict[str, tuple[Array, Array]]) -> bytes:
    """An OSC bundle of a person's bones; for a lost person, that no person is there."""
    return (
        b"#bundle\0" + struct.pack(">Q", 1) + b"".join(struct.pack(">i", len(one)) + one for one in _all(time_s, bones))
    )


def _all(time_s: float, bones: dict[str, tuple[Array, Array]]) -> Iterator[bytes]:
    yield _message("/VMC/Ext/OK", int(bool(bones)))
    yield _message("/VMC/Ext/T", time_s)
    if bones:
        yield _message("/VMC/Ext/Root/Pos", "root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    for name, (place, turn) in bones.items():
        yield _message("/VMC/Ext/Bone/Pos", name, *place.tolist(), *turn.tolist())


def _message(address: str, *values: str | float) -> bytes:
    """An OSC message: strings end with zeros up to a multiple of four, numbers are big-endian."""
    tags = "".join("s" if isinstance(one, str) else "i" if isinstance(one, int) else "f" for one in values)
    told = [
        _padded(one) if isinstance(one, str) else struct.pack(f">{tag}", one)
        for one, tag in zip(values, tags, strict=True)
    ]
    return _padded(address) + _padded(f",{tags}") + b"".join(told)


def _padded(text: str) -> bytes:
    content = text.encode() + b"\0"
    return content + b"\0" * (-len(content) % 4)
