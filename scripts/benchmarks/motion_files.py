"""Motion files of other laboratories as joint centres: CMU's skeletons and movements, DeepMimic's clips."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.foundation.arrays import Array
from tracker.results.recognition import JOINTS

# Frames a second of CMU's cameras.
_CMU_HZ = 120.0
# Bones whose far end is the joint.
_CMU_BONES = {
    "shoulder": "clavicle",
    "elbow": "humerus",
    "wrist": "radius",
    "hip": "hipjoint",
    "knee": "femur",
    "ankle": "tibia",
}
# Parent and place in it, metres, of the humanoid of DeepMimic (y up, z to the right); values in a frame.
_DEEPMIMIC = {
    "chest": ("root", (0, 0.236151, 0), 4),
    "neck": ("chest", (0, 0.223894, 0), 4),
    "right_hip": ("root", (0, 0, 0.084887), 4),
    "right_knee": ("right_hip", (0, -0.421546, 0), 1),
    "right_ankle": ("right_knee", (0, -0.40987, 0), 4),
    "right_shoulder": ("chest", (-0.02405, 0.24350, 0.18311), 4),
    "right_elbow": ("right_shoulder", (0, -0.274788, 0), 1),
    "left_hip": ("root", (0, 0, -0.084887), 4),
    "left_knee": ("left_hip", (0, -0.421546, 0), 1),
    "left_ankle": ("left_knee", (0, -0.40987, 0), 4),
    "left_shoulder": ("chest", (-0.02405, 0.24350, -0.18311), 4),
    "left_elbow": ("left_shoulder", (0, -0.274788, 0), 1),
    "right_wrist": ("right_elbow", (0, -0.258947, 0), 0),
    "left_wrist": ("left_elbow", (0, -0.258947, 0), 0),
}
# x stays, z goes up.
_WORLD_FROM_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


@dataclass(frozen=True)
class MotionFile:
    """Joint centres of one recording."""

    times_s: Array
    """(T,) seconds."""

    joints: Array
    """(T, 12, 3) in the order of `JOINTS`, z up."""

    def part(self, from_s: float, to_s: float) -> MotionFile:
        """What lies between two times, seconds."""
        kept = (self.times_s >= from_s) & (self.times_s <= to_s)
        return MotionFile(self.times_s[kept], self.joints[kept])


def read_deepmimic(path: Path) -> MotionFile:
    """A clip of DeepMimic."""
    frames = np.array(json.loads(path.read_text())["Frames"], dtype=np.float64)
    places, turns = {"root": frames[:, 1:4]}, {"root": _quaternions(frames[:, 4:8])}
    column = 8
    for name, (parent, offset, n_values) in _DEEPMIMIC.items():
        values = frames[:, column : column + n_values]
        column += n_values
        places[name] = places[parent] + turns[parent].apply(np.array(offset, dtype=np.float64))
        if n_values:
            own = _quaternions(values) if n_values == 4 else Rotation.from_euler("z", values)
            turns[name] = turns[parent] * own
    times = np.concatenate([[0.0], np.cumsum(frames[:-1, 0])])
    return MotionFile(times, np.stack([places[name] for name in JOINTS], axis=1) @ _WORLD_FROM_Y_UP.T)


def _quaternions(values: Array) -> Rotation:
    return Rotation.from_quat(values[:, [1, 2, 3, 0]])


def read_cmu(path: Path) -> MotionFile:
    """A movement (AMC) of CMU's motion capture database, with the skeleton (ASF) of its subject beside it."""
    subject = path.name.partition("_")[0]
    bones, parents = _skeleton(next(path.parent.glob(f"{subject}-*.asf")))
    frames = _movement(path)
    root = np.array([frame["root"] for frame in frames])
    places, turns = {"root": root[:, :3]}, {"root": Rotation.from_euler("xyz", root[:, 3:], degrees=True)}
    for name, parent in parents.items():
        axis, direction, length, moved = bones[name]
        angles = np.zeros((len(frames), 3))
        # toes, which move no joint that counts, are missing in some frames of 07_12
        for k, letter in enumerate(moved if all(name in frame for frame in frames) else ""):
            angles[:, "xyz".index(letter)] = [frame[name][k] for frame in frames]
        turns[name] = turns[parent] * axis * Rotation.from_euler("xyz", angles, degrees=True) * axis.inv()
        places[name] = places[parent] + turns[name].apply(length * direction)
    names = [joint.replace("left_", "l").replace("right_", "r") for joint in JOINTS]
    joints = np.stack([places[name[0] + _CMU_BONES[name[1:]]] for name in names], axis=1)
    return MotionFile(np.arange(len(frames)) / _CMU_HZ, joints @ _WORLD_FROM_Y_UP.T)


_Bone = tuple[Rotation, Array, float, str]


def _skeleton(path: Path) -> tuple[dict[str, _Bone], dict[str, str]]:
    """Axis, direction, length and axes of rotation of every bone; bone -> parent, parents first."""
    text = path.read_text()
    bones = {}
    for block in re.findall(r"begin(.*?)end", text.split(":bonedata")[1].split(":hierarchy")[0], re.DOTALL):
        words = {line.split()[0]: line.split()[1:] for line in block.strip().splitlines() if line.split()}
        axis = Rotation.from_euler("xyz", np.array(words["axis"][:3], dtype=np.float64), degrees=True)
        moved = "".join(word[1] for word in words.get("dof", []))
        bones[words["name"][0]] = (axis, np.array(words["direction"], float), float(words["length"][0]), moved)
    parents = {}
    for line in text.split(":hierarchy")[1].split("begin")[1].split("end")[0].strip().splitlines():
        parent, *children = line.split()
        parents.update(dict.fromkeys(children, parent))
    return bones, parents


def _movement(path: Path) -> list[dict[str, Array]]:
    frames: list[dict[str, Array]] = []
    for line in path.read_text().splitlines():
        words = line.split()
        if not words or line[0] in "#:":
            continue
        if len(words) == 1:
            frames.append({})
        else:
            frames[-1][words[0]] = np.array(words[1:], dtype=np.float64)
    return frames
