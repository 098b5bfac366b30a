"""Alignment with a marker system while one limb of the track is wrong: the law that it counts for nothing."""

from __future__ import annotations

import csv
import itertools
import json
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.results.evaluation.marker_fit import Placement, placed
from tracker.results.evaluation.marker_set import MarkerJoints, MarkerSet, joints_of, load_marker_set
from tracker.results.evaluation.time_correlation import Clocked
from tracker.results.marker_layouts import read_markers
from tracker.results.markers import Markers

LIMBS = {
    f"{side}_{limb}": tuple(f"{side}_{joint}" for joint in joints)
    for side in ("left", "right")
    for limb, joints in (("arm", ("shoulder", "elbow", "wrist")), ("leg", ("hip", "knee", "ankle")))
}
ROOT = Path(__file__).parents[1]
JOINTS = tuple(name for chain in LIMBS.values() for name in chain)
HINGES = [(first, first + 1, first + 2) for first in range(0, len(JOINTS), 3)]
TIMES_S = np.arange(80) / 25
OFFSET_S = 0.29
SIDES_M = 0.03
Wrong = Callable[[np.ndarray, int, np.random.Generator], np.ndarray]
RATE_HZ = 250.0
"""Linear interpolation between samples is right to 50 m/s^2 / 250^2 / 8 = 0.1 mm."""


def poses(body: BodyModel, seed: int, times_s: np.ndarray) -> np.ndarray:
    """(T, dof): the person turns about herself by 80 degrees; every joint swings by up to 35 degrees, none repeats."""
    rng = np.random.default_rng(seed)
    q = np.tile(body.rest(), (len(times_s), 1))
    for k, parameter in enumerate(body.parameters):
        if not parameter.rotates:
            continue
        swing, turn = np.radians(rng.uniform(15, 35)), rng.uniform(1.2, 3)
        wave = np.sin(turn * times_s + 0.3 * times_s**2 + rng.uniform(0, 6))
        bends = any(joint in parameter.name for joint in ("extension", "flexion"))
        q[:, k] += (np.radians(45) if bends else 0.0) + (0.3 if "torso" in parameter.name else 1.0) * swing * wave
    q[:, body.names.index("torso_twist")] += np.radians(80) * times_s / TIMES_S[-1]
    return q


def joints_at(body: BodyModel, seed: int, times_s: np.ndarray) -> np.ndarray:
    """(T, 12, 3) m."""
    columns = [body.landmark_names.index(name) for name in JOINTS]
    return body.landmarks_in_world(poses(body, seed, times_s))[:, columns]


def markers_of(body: BodyModel, seed: int, rotation: np.ndarray, translation: np.ndarray) -> MarkerJoints:
    """Pairs without noise on both sides of every joint, in a world and by a clock of their own."""
    times_s = np.arange(0.0, TIMES_S[-1] + 0.6, 1 / RATE_HZ)
    joints = joints_at(body, seed, times_s - OFFSET_S)
    pairs = []
    for k in range(len(JOINTS)):
        first = 3 * (k // 3)
        hinge = np.cross(joints[:, first + 1] - joints[:, first], joints[:, first + 2] - joints[:, first + 1])
        across = SIDES_M * hinge / np.linalg.norm(hinge, axis=1, keepdims=True)
        pairs += [joints[:, k] + across, joints[:, k] - across]
    points = np.stack(pairs, axis=1) @ rotation.T + translation
    chosen = MarkerSet(joints={name: (f"M{2 * k}", f"M{2 * k + 1}") for k, name in enumerate(JOINTS)})
    names = tuple(f"M{k}" for k in range(2 * len(JOINTS)))
    return joints_of(chosen, Path("set.toml"), Markers(names, times_s, points), HINGES)


def turned(joints: np.ndarray, limb: int, rng: np.random.Generator) -> np.ndarray:
    """A limb turned about where it hangs, by 3 to 170 degrees."""
    wrong, first = joints.copy(), 3 * limb
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(np.exp(rng.uniform(np.log(3), np.log(170)))))
    arms = joints[:, first + 1 : first + 3] - joints[:, [first]]
    wrong[:, first + 1 : first + 3] = joints[:, [first]] + turn.apply(arms.reshape(-1, 3)).reshape(arms.shape)
    return wrong


def carried(joints: np.ndarray, limb: int, rng: np.random.Generator) -> np.ndarray:
    """All three joints of a limb elsewhere, by 5 mm to half a metre."""
    wrong, way = joints.copy(), rng.normal(size=3)
    wrong[:, 3 * limb : 3 * limb + 3] += way / np.linalg.norm(way) * np.exp(rng.uniform(np.log(0.005), np.log(0.5)))
    return wrong


def far_turned(joints: np.ndarray, limb: int, rng: np.random.Generator) -> np.ndarray:
    """A limb turned about where it hangs, by 30 to 170 degrees."""
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(rng.uniform(30, 170)))
    wrong, first = joints.copy(), 3 * limb
    arms = joints[:, first + 1 : first + 3] - joints[:, [first]]
    wrong[:, first + 1 : first + 3] = joints[:, [first]] + turn.apply(arms.reshape(-1, 3)).reshape(arms.shape)
    return wrong


def bent(joints: np.ndarray, limb: int, rng: np.random.Generator) -> np.ndarray:
    """A forearm bent to the other side of the upper arm."""
    wrong, (hung, hinge, end) = joints.copy(), joints[:, 3 * limb : 3 * limb + 3].transpose(1, 0, 2)
    along = (hinge - hung) / np.linalg.norm(hinge - hung, axis=1, keepdims=True)
    wrong[:, 3 * limb + 2] = hinge + 2 * along * ((end - hinge) * along).sum(axis=1, keepdims=True) - (end - hinge)
    return wrong


def exchanged(joints: np.ndarray, limb: int, rng: np.random.Generator) -> np.ndarray:
    """Elbow and wrist are those of the other arm."""
    wrong = joints.copy()
    wrong[:, 3 * limb + 1 : 3 * limb + 3] = joints[:, 4 - 3 * limb : 6 - 3 * limb]
    return wrong


def late(joints: np.ndarray, limb: int, rng: np.random.Generator) -> np.ndarray:
    """Elbow and wrist follow by 80 to 500 ms."""
    wrong, behind = joints.copy(), rng.integers(2, 13)
    earlier = np.maximum(np.arange(len(joints)) - behind, 0)
    wrong[:, 3 * limb + 1 : 3 * limb + 3] = joints[earlier, 3 * limb + 1 : 3 * limb + 3]
    return wrong


def held(joints: np.ndarray, limb: int, rng: np.random.Generator) -> np.ndarray:
    """A limb that stays where it was in one frame, from some frame on."""
    wrong, since = joints.copy(), rng.integers(len(joints) // 2)
    wrong[since:, 3 * limb + 1 : 3 * limb + 3] = joints[since, 3 * limb + 1 : 3 * limb + 3]
    return wrong


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("limb", range(4))
@pytest.mark.parametrize("wrong", [turned, carried, held])
def test_one_wrong_limb_counts_for_nothing_however_wrong_it_is(body, wrong, limb, seed):
    """Markers without noise, nine right joints of twelve: what is asked for, though the fit assumes 3 mm of noise."""
    rng = np.random.default_rng([seed, limb])
    rotation, translation = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    joints = joints_at(body, seed, TIMES_S)
    markers = markers_of(body, seed, rotation, translation)
    found = placed(Clocked(TIMES_S, wrong(joints, limb, rng)), markers, OFFSET_S + rng.uniform(-0.2, 0.2))
    assert found is not None
    assert (np.array(errors(found, joints, OFFSET_S, rotation, translation)) < (0.002, 0.3, 0.005)).all()


@pytest.mark.parametrize(
    ("name", "wrong", "within"),
    [
        ("R-UpperBody", turned, (0.001, 1.2, 0.006)),
        ("R-UpperBody", carried, (0.001, 0.8, 0.018)),
        ("R-UpperBody", held, (0.001, 0.3, 0.002)),
        ("R-Turn", turned, (0.002, 0.7, 0.004)),
        ("R-Turn", carried, (0.003, 0.7, 0.006)),
        ("R-Turn", held, (0.001, 0.3, 0.004)),
    ],
)
def test_one_wrong_arm_of_the_truth_leaves_what_the_markers_err(data, name, wrong, within):
    """Eight joints whose markers slide by 2 mm and lie up to 80 mm beside them; five are right where an arm is carried.

    Seconds, degrees and metres at worst of twelve, about a third above what was measured. Most of what exceeds 2 ms,
    0.3 deg and 5 mm are arms wrong by 5 to 30 mm, as far as a right joint may lie beside its markers, and
    R-UpperBody's with their shoulders off (0.34 and 0.30 deg without one). With one scale for all it was 12 deg.
    """
    recording = Aligned(data(f"room/{name}"))
    for limb, seed in itertools.product(range(2), range(6)):
        assert (recording.errors_with(wrong, limb, seed) < within).all()


@pytest.mark.parametrize(
    ("name", "wrong", "n_seeds"),
    [
        *itertools.product(("R-UpperBody", "R-Turn"), (bent, exchanged), (1,)),
        *itertools.product(("R-UpperBody", "R-Turn"), (held, late), (2,)),
        *itertools.product(("R-UpperBody", "R-Turn"), (far_turned,), (4,)),
    ],
)
@pytest.mark.parametrize("share", [1.0, 0.4])
def test_an_arm_that_is_far_wrong_leaves_what_is_asked_for(data, name, wrong, n_seeds, share):
    """2 ms, 0.3 deg, 5 mm, whether the arm is wrong all the time or for a while; at worst 0.8 ms, 0.29 deg, 2.7 mm."""
    recording = Aligned(data(f"room/{name}"))
    for limb, seed in itertools.product(range(2), range(n_seeds)):
        assert (recording.errors_with(wrong, limb, seed, share) < (0.002, 0.3, 0.005)).all()


class Aligned:
    """A recording of the room, the truth of which is aligned with its markers."""

    def __init__(self, folder: Path) -> None:
        truth = json.loads((folder / "markers" / "truth.json").read_text())
        path = ROOT / "configs" / "markers" / "upper_body.toml"
        chosen = load_marker_set(path)
        of = list(chosen.joints).index
        hinges = [(of(f"{side}_shoulder"), of(f"{side}_elbow"), of(f"{side}_wrist")) for side in ("left", "right")]
        self.joints = recorded(folder / "gt_joints.csv", chosen.joints)
        self.markers = joints_of(chosen, path, read_markers(folder / "markers" / "markers.trc"), hinges)
        self.offset_s = truth["marker_time_minus_video_time_s"]
        self.rotation = np.array(truth["rotation_marker_from_world"])
        self.shift = np.array(truth["translation_m"])

    def errors_with(self, wrong: Wrong, limb: int, seed: int, share: float = 1.0) -> np.ndarray:
        """Seconds, degrees and metres, an arm wrong in a share of the frames."""
        rng = np.random.default_rng(seed)
        # limbs are three joints each from the third on here, from the first on above
        spoilt = self.joints.copy()
        n = round(share * len(spoilt))
        first = rng.integers(0, len(spoilt) - n + 1)
        spoilt[first : first + n, 2:] = wrong(self.joints[:, 2:], limb, np.random.default_rng(seed))[first : first + n]
        found = placed(Clocked(np.arange(len(spoilt)) / 25, spoilt), self.markers, self.offset_s + 0.05)
        assert found is not None
        return np.array(errors(found, self.joints, self.offset_s, self.rotation, self.shift))


def recorded(path: Path, names: Iterable[str]) -> np.ndarray:
    """(T, J, 3) of a table of true joints."""
    rows: dict[str, list[list[float]]] = {}
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            name = row["joint"].replace("l_", "left_", 1).replace("r_", "right_", 1)
            rows.setdefault(name, []).append([float(row[axis]) for axis in "xyz"])
    return np.stack([np.array(rows[name]) for name in names], axis=1)


def errors(
    found: Placement, joints: np.ndarray, offset_s: float, rotation: np.ndarray, shift: np.ndarray
) -> tuple[float, float, float]:
    """Seconds, degrees, and metres at the middle of the person."""
    middle = joints.mean(axis=(0, 1))
    turn_deg = float(np.degrees(Rotation.from_matrix(found.rotation @ rotation.T).magnitude()))
    apart = found.in_their_world(middle) - (rotation @ middle + shift)
    return abs(found.offset_s - offset_s), turn_deg, float(np.linalg.norm(apart))
