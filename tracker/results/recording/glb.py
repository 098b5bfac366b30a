"""The body with its bones and its movement for Blender, browsers and game engines: binary glTF 2.0."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tracker.bodies.body.surface import Skinned, skinned_of
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.files import write_whole
from tracker.results.recording import RunContext
from tracker.results.recording._motion import Motion, MotionRecorder

_TYPES = {"<f4": 5126, "|u1": 5121, "<u4": 5125}
"""Component types of the format, by numpy's."""

_VERTICES, _INDICES = 34962, 34963
"""Purpose of a buffer view for a graphics card."""

_Z_UP_TO_Y_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
"""Quaternion x y z w of a quarter turn about x: the format's y points up."""


@component
class Glb:
    """`NAME.glb` for each person: its skin, or the parts' surfaces, on a skeleton of the segments, animated; m, y up.

    Frames keep their times. Poses of lost frames are interpolated; lost and doubtful frames are listed under `extras`
    of the animation.
    """

    n_eta: int = pydantic.Field(default=13, ge=5, le=65)
    """Latitudes of the parts' meshes."""

    n_omega: int = pydantic.Field(default=16, ge=6, le=128)
    """Longitudes of the parts' meshes."""

    def begin(self, run: RunContext) -> MotionRecorder:
        """Collects the poses; the files are written at the end."""
        return MotionRecorder(run, self._written, "glb")

    def _written(self, motion: Motion, folder: Path) -> Path:
        path = folder / f"{motion.name}.glb"
        motion.told_filled(path)
        buffer = _Buffer()
        surface = skinned_of(motion.body, self.n_eta, self.n_omega)
        mesh, skin = _mesh(surface, buffer), _inverse_binds(surface, buffer)
        n_bones = len(motion.body.segments)
        document = {
            "asset": {"version": "2.0", "generator": "bodytrack"},
            "scene": 0,
            "scenes": [{"nodes": [n_bones, n_bones + 1]}],
            "nodes": _nodes(motion),
            "meshes": [{"name": motion.body.name, "primitives": [mesh]}],
            "skins": [{"joints": list(range(n_bones)), "inverseBindMatrices": skin, "skeleton": n_bones}],
            "materials": [
                {
                    "name": "body",
                    "pbrMetallicRoughness": {
                        "baseColorFactor": [0.55, 0.68, 0.8, 1.0],
                        "metallicFactor": 0.0,
                        "roughnessFactor": 0.7,
                    },
                }
            ],
            "animations": [_animation(motion, buffer)],
            **buffer.described(),
        }
        write_whole(path, _packed(document, bytes(buffer.content)))
        return path


def _mesh(surface: Skinned, buffer: _Buffer) -> dict[str, Any]:
    """The surface in its rest pose; each vertex hangs on up to four segments."""
    attributes = {
        "POSITION": buffer.add(surface.points, "VEC3", _VERTICES, bounded=True),
        "NORMAL": buffer.add(surface.normals, "VEC3", _VERTICES),
        "JOINTS_0": buffer.add(surface.segments.astype("u1"), "VEC4", _VERTICES),
        "WEIGHTS_0": buffer.add(surface.weights, "VEC4", _VERTICES),
    }
    indices = buffer.add(surface.faces.ravel().astype("<u4"), "SCALAR", _INDICES)
    return {"attributes": attributes, "indices": indices, "material": 0}


class _Buffer:
    """The binary part of the file, and the index of its arrays."""

    def __init__(self) -> None:
        self.content = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def add(self, values: NDArray[Any], kind: str, target: int | None = None, bounded: bool = False) -> int:
        """Adds an array, numbers as float32; the index of its accessor."""
        array = np.ascontiguousarray(values.astype("<f4") if values.dtype.kind == "f" else values)
        view = {"buffer": 0, "byteOffset": len(self.content), "byteLength": array.nbytes}
        self._views.append(view | ({"target": target} if target else {}))
        self.content += array.tobytes() + b"\0" * (-array.nbytes % 4)
        accessor: dict[str, Any] = {"bufferView": len(self._views) - 1, "componentType": _TYPES[array.dtype.str]}
        accessor |= {"count": len(array), "type": kind}
        if bounded:
            rows = array.reshape(len(array), -1).astype(float)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def described(self) -> dict[str, Any]:
        """The entries of the document that describe the buffer."""
        buffers = [{"byteLength": len(self.content)}]
        return {"accessors": self._accessors, "bufferViews": self._views, "buffers": buffers}


def _inverse_binds(surface: Skinned, buffer: _Buffer) -> int:
    """Matrices, column by column, from the surface's rest pose into each segment's frame."""
    return buffer.add(surface.segment_from_given.transpose(0, 2, 1).reshape(-1, 16), "MAT4")


def _nodes(motion: Motion) -> list[dict[str, Any]]:
    """A node for each segment in the reference pose, one above them that turns z up to y up, and the skinned mesh."""
    segments = motion.body.segments
    nodes: list[dict[str, Any]] = []
    for k, segment in enumerate(segments):
        origin = segments[segment.parent].joint if segment.parent >= 0 else np.zeros(3)
        nodes.append({"name": segment.name, "translation": (segment.joint - origin).tolist()})
        if children := [j for j, other in enumerate(segments) if other.parent == k]:
            nodes[-1]["children"] = children
    roots = [k for k, segment in enumerate(segments) if segment.parent < 0]
    nodes.append({"name": f"{motion.name}_armature", "rotation": _Z_UP_TO_Y_UP, "children": roots})
    nodes.append({"name": motion.name, "mesh": 0, "skin": 0})
    return nodes


def _animation(motion: Motion, buffer: _Buffer) -> dict[str, Any]:
    times = buffer.add(motion.times_s - motion.times_s[0], "SCALAR", bounded=True)
    local = motion.local(motion.filled)
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []

    def drive(node: int, path: str, values: Array, kind: str) -> None:
        samplers.append({"input": times, "output": buffer.add(values, kind), "interpolation": "LINEAR"})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

    for k, segment in enumerate(motion.body.segments):
        turns = Rotation.from_matrix(local[:, k, :3, :3]).as_quat()
        # A quaternion and its negative are one turn; between neighbours of opposite sign lies a full circle.
        signs = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0, -1.0, 1.0))
        turns[1:] *= signs[:, None]
        drive(k, "rotation", turns, "VEC4")
        if segment.parent < 0 or motion.slides(k):
            drive(k, "translation", local[:, k, :3, 3], "VEC3")
    marked = {"interpolated_frames": motion.lost, "doubtful_frames": motion.doubted}
    numbers = np.array(motion.frames)
    extras = {name: numbers[mask].tolist() for name, mask in marked.items() if mask.any()}
    told = {"extras": extras} if extras else {}
    return {"name": "tracked", "samplers": samplers, "channels": channels, **told}


def _packed(document: dict[str, Any], content: bytes) -> bytes:
    """The container: a header, the document padded by spaces, the buffer."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(content))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(content), b"BIN\0") + content
    return header + chunks
