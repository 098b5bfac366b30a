"""What changes nothing: the order of views and of persons, the side of a mirror, the direction of time."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest
from recordings import SMALL, TrueStart, cycle_for, small_simulation

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array
from tracker.images.plate import Plate
from tracker.images.sight import Observation
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.objective import Objective
from tracker.tracking.sequence import track
from tracker.tracking.trajectory import Step
from tracker.tracking.verdict import likelier, weighed

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))

from benchmarks.meaningless import flipped, mirrored_camera, other_side

# What other last digits of sums make of joints in some frames: 3e-9 mm were found.
ROUNDING_MM = 1e-6
# Half a pixel: which pixels are edges, and where contours are sampled, is another matter in a mirror.
HALF_PX_MM = 0.5 * 12.5


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("walking_on_the_spot", n_frames=4)


@pytest.fixture(scope="module")
def pair() -> Simulation:
    """Two persons who hide each other in two of four views."""
    middle = np.array([0.0, 0.0, 1.0])
    places = {"a": (4, 0.3, 1.6), "b": (-4, -0.3, 1.6), "c": (0.3, 4, 1.6), "d": (-0.3, -4, 1.6)}
    rig = Rig(tuple(Camera.looking_at(name, SMALL, 330.0, place, middle) for name, place in places.items()))
    return small_simulation("walking_on_the_spot", n_frames=4, persons=2, rig=rig)


def tracked(simulation: Simulation, found: bool = False) -> list[Step]:
    """All frames, by the usual evidence, from the truth or from where a start finds persons."""
    start = None if found else TrueStart(simulation, 0.0, 0.0)
    cycle = cycle_for(simulation, start, evidence=AutoEvidence())
    return list(track(simulation.frames(), simulation.scene, cycle))


def joints(simulation: Simulation, steps: list[Step], person: int = 0) -> Array:
    """(T, L, 3) metres."""
    return simulation.scene.persons[person].body.landmarks_in_world(
        np.array([step.estimates[person].q for step in steps])
    )


def apart_mm(one: Array, other: Array) -> Array:
    """(T, L) distances of the same joint."""
    found: Array = 1000 * np.linalg.norm(one - other, axis=-1)
    return found


def with_views(simulation: Simulation, order: list[int]) -> Simulation:
    """The same recording, its views in another order."""
    frames = tuple(replace(one, images=tuple(one.images[v] for v in order)) for one in simulation.frames())
    rig = replace(simulation.scene.rig, cameras=tuple(simulation.scene.rig.cameras[v] for v in order))
    scene, plates = replace(simulation.scene, rig=rig), tuple(simulation.plates[v] for v in order)
    return _filmed(replace(simulation, scene=scene, plates=plates), frames)


@dataclass(frozen=True)
class Filmed(Simulation):
    """A simulation with pictures of its own."""

    shown: tuple[Frame, ...] = ()

    def frames(self) -> Iterator[Frame]:
        return iter(self.shown)


def _filmed(simulation: Simulation, frames: tuple[Frame, ...]) -> Simulation:
    return Filmed(**{field.name: getattr(simulation, field.name) for field in fields(simulation)}, shown=frames)


def test_the_order_of_the_views_changes_nothing(simulation: Simulation) -> None:
    one = joints(simulation, tracked(simulation, found=True))
    other = joints(simulation, tracked(with_views(simulation, [3, 1, 0, 2]), found=True))
    assert apart_mm(other, one).max() < ROUNDING_MM


def test_the_order_of_the_persons_changes_nothing(pair: Simulation) -> None:
    scene = replace(pair.scene, persons=pair.scene.persons[::-1])
    swapped = _filmed(replace(pair, scene=scene, poses=pair.poses[::-1]), tuple(pair.frames()))
    steps, others = tracked(pair), tracked(swapped)
    for k in range(2):
        assert apart_mm(joints(pair, steps, k), joints(swapped, others, 1 - k)).max() < ROUNDING_MM


def mirrored(simulation: Simulation) -> Simulation:
    """The recording in a mirror: images left for right, cameras and poses beyond the plane y = 0."""
    rig = Rig(tuple(mirrored_camera(camera) for camera in simulation.scene.rig.cameras))
    (person,) = simulation.scene.persons
    poses = (mirrored_poses(person.body, simulation.poses[0]),)
    plates = tuple(None if plate is None else Plate(flipped(plate.picture)) for plate in simulation.plates)
    frames = tuple(
        replace(one, images=tuple(None if image is None else flipped(image) for image in one.images))
        for one in simulation.frames()
    )
    scene = Scene((replace(person, q=mirrored_poses(person.body, person.q)),), rig)
    return _filmed(replace(simulation, scene=scene, poses=poses, plates=plates), frames)


def mirrored_poses(body: BodyModel, poses: Array) -> Array:
    swap = [body.index(other_side(name)) for name in body.names]
    signs = np.ones(body.dof)
    signs[[body.index(f"torso_{name}") for name in ("y", "abduction", "twist")]] = -1
    return poses[..., swap] * signs


def test_in_a_mirror_everybody_is_mirrored(simulation: Simulation) -> None:
    body = simulation.scene.persons[0].body
    glass = mirrored(simulation)
    marks = [body.landmark_names.index(other_side(name)) for name in body.landmark_names]
    there = joints(glass, tracked(glass))[:, marks] * (1, -1, 1)
    assert apart_mm(there, joints(simulation, tracked(simulation))).mean() < HALF_PX_MM


def test_time_that_runs_back_shows_the_same_path(simulation: Simulation) -> None:
    frames = tuple(simulation.frames())
    end_s = frames[-1].time_s
    turned = tuple(replace(one, index=n, time_s=end_s - one.time_s) for n, one in enumerate(reversed(frames)))
    backwards = _filmed(replace(simulation, poses=(simulation.poses[0][::-1],)), turned)
    there, back = joints(simulation, tracked(simulation)), joints(backwards, tracked(backwards))[::-1]
    assert apart_mm(there, back).mean() < HALF_PX_MM


@pytest.fixture(scope="module")
def objective(truth: Scene, observation: Observation) -> Objective:
    return Objective(Comparison(truth, 0, CpuSynthesis(), observation), ContourEvidence())


@pytest.mark.parametrize("seed", range(4))
def test_one_more_pose_never_leaves_a_worse_one(objective: Objective, truth: Scene, seed: int) -> None:
    body, q = truth.persons[0].body, truth.persons[0].q
    poses = body.clamped(q + np.random.default_rng(seed).normal(size=(4, body.dof)) * np.where(body.rotates, 0.4, 0.05))
    found = [objective.estimate(pose, np.eye(body.dof), 1) for pose in poses]
    for choose, (mine, rival) in itertools.product((likelier, weighed), itertools.permutations(found, 2)):
        assert choose(objective, mine, rival).distance_px <= mine.distance_px + 1e-9


@pytest.mark.parametrize(("name", "other"), [("left_hip", "right_hip"), ("r_toe", "l_toe"), ("collar", "collar")])
def test_joints_of_the_other_side_have_its_names(name: str, other: str) -> None:
    assert other_side(name) == other
    assert other_side(other) == name
