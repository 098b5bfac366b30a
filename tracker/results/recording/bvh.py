"""The skeleton and its movement for Blender, Maya, MotionBuilder and others that read BVH."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.segments import Segment
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.files import write_whole
from tracker.results.recording import RunContext
from tracker.results.recording._motion import Y_UP, Motion, MotionRecorder, euler_angles, exported_name

# A metre in the unit that programs expect of BVH.
_CM = 100.0
_ORDER: Final = "ZXY"
"""Order of the rotation channels: R = Rz Rx Ry, the usual one; the sides of X = 90 degrees lie far from any spine."""

_WORLD = "world"
"""Name of the segment that never moves; no other segment has it."""


@component
class Bvh:
    """`NAME.bvh` for each person: the segments as joints, centimetres, y up; lost frames are interpolated.

    The rest pose is the model's reference pose. Only the root, and segments that slide along their parent, move in
    space. If several segments hang on the world, as beside a pedestal, the root is the world, which stays.
    """

    def begin(self, run: RunContext) -> MotionRecorder:
        """Collects the poses; the files are written at the end."""
        return MotionRecorder(run, self._written, "bvh")

    def _written(self, motion: Motion, folder: Path) -> Path:
        motion, path = _on_one_root(motion.even()), folder / f"{motion.name}.bvh"
        motion.told_filled(path)
        rows = np.concatenate(list(_columns(motion)), axis=1)
        lines = ["HIERARCHY", *_hierarchy(motion)]
        lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {motion.interval_s:.8f}"]
        lines += [" ".join(f"{value:.6f}" for value in row) for row in rows]
        write_whole(path, ("\n".join(lines) + "\n").encode())
        return path


def _on_one_root(motion: Motion) -> Motion:
    """The movement with a segment for the world, if more than one segment hangs on it.

    The format allows several ROOTs and Blender reads them; three.js, bvhio and others accept only one.
    """
    body = motion.body
    if sum(segment.parent < 0 for segment in body.segments) < 2:
        return motion
    world = Segment(_WORLD, -1, frozen(np.zeros(3)), (), -1)
    # a body fixed to the room has such a segment itself, its last one
    hung = (replace(one, parent=one.parent + 1) for one in body.segments if one.name != _WORLD)
    return replace(motion, body=replace(body, segments=(world, *hung)))


def _in_order(body: BodyModel) -> list[tuple[int, int]]:
    """Segments as BVH lists them, depth first, each with its depth."""
    listed: list[tuple[int, int]] = []
    waiting = [(k, 0) for k, segment in enumerate(body.segments) if segment.parent < 0][::-1]
    while waiting:
        k, depth = waiting.pop()
        listed.append((k, depth))
        waiting += [(j, depth + 1) for j, other in enumerate(body.segments) if other.parent == k][::-1]
    return listed


def _hierarchy(motion: Motion) -> Iterator[str]:
    body, open_to = motion.body, 0
    for k, depth in _in_order(body):
        segment = body.segments[k]
        for level in range(open_to - 1, depth - 1, -1):
            yield "\t" * level + "}"
        open_to = depth + 1
        indent, root = "\t" * depth, segment.parent < 0
        moves = root or motion.slides(k)
        # some readers add positions to the offset, others put them in its place
        free = root or (moves and body.segments[segment.parent].name == _WORLD)
        offset = np.zeros(3) if free else Y_UP @ (segment.joint - body.segments[segment.parent].joint)
        yield f"{indent}{'ROOT' if root else 'JOINT'} {exported_name(segment.name)}"
        yield indent + "{"
        yield f"{indent}\tOFFSET {_centimetres(offset)}"
        rotations = " ".join(f"{axis}rotation" for axis in _ORDER)
        yield f"{indent}\tCHANNELS " + (f"6 Xposition Yposition Zposition {rotations}" if moves else f"3 {rotations}")
        if not any(other.parent == k for other in body.segments):
            yield f"{indent}\tEnd Site"
            yield indent + "\t{"
            yield f"{indent}\t\tOFFSET {_centimetres(Y_UP @ (_tip(body, k) - segment.joint))}"
            yield indent + "\t}"
    for level in range(open_to - 1, -1, -1):
        yield "\t" * level + "}"


def _centimetres(vector: Array) -> str:
    return " ".join(f"{value:.6f}" for value in _CM * vector)


def _tip(body: BodyModel, k: int) -> Array:
    """The farthest end of a segment's parts from its joint, in the reference pose."""
    segment = body.segments[k]
    ends = [
        part.model_from_part[:3, 3] + side * part.shape.size[2] * part.model_from_part[:3, 2]
        for part in body.parts
        if part.segment == segment.name
        for side in (-1, 1)
    ]
    tip: Array = max(ends, key=lambda end: float(np.linalg.norm(end - segment.joint)), default=segment.joint)
    return tip


def _columns(motion: Motion) -> Iterator[Array]:
    """For each segment in order: rotation (T, 3) in degrees, before it position (T, 3) in cm if it moves in space."""
    local = motion.local(motion.filled)
    for k, _ in _in_order(motion.body):
        if motion.body.segments[k].parent < 0 or motion.slides(k):
            yield _CM * local[:, k, :3, 3] @ Y_UP.T
        angles = euler_angles(Y_UP @ local[:, k, :3, :3] @ Y_UP.T, _ORDER)
        yield np.degrees(np.unwrap(angles, axis=0))
