"""Performances to be recognized: of other persons than the library's, of another body, and the library's disturbed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.everyday import everyday
from benchmarks.motion_files import read_cmu
from tracker.bodies.body.description import load_body
from tracker.foundation.arrays import Array
from tracker.foundation.resources import model_path
from tracker.results.recognition import Course, course, course_of
from tracker.results.recognition.library import Library, load_library
from tracker.synthesis.simulation.movements import poses_of

EVERYDAY = "everyday movements of persons of another body model, each with a posture of his own"
DISTURBED = "the library's performances, disturbed: posture 6 deg, extent, tempo, 3 deg of noise"

_PERSONS = (0.8, 0.8), (0.8, 1.25), (1.0, 1.0), (1.0, 0.8), (1.25, 0.8), (1.25, 1.25)
"""How many times as fast, and as far."""

_SEED = 1000
"""Of the postures of everyday persons; the rule was chosen with others (docs/lab/everyday_movements.md)."""


@dataclass(frozen=True)
class Performance:
    """A movement to be recognized."""

    group: str
    movement: str
    course: Course


def other_persons(folder: Path) -> Iterator[Performance]:
    """Persons of CMU's database, who are not in the library."""
    group = "persons of CMU's database, nobody of whom is in the library"
    for path in sorted(folder.glob("07_*-walk.amc")):
        motion = read_cmu(path)
        yield Performance(group, "walk", course(motion.times_s, motion.joints))
    motion = read_cmu(folder / "09_06-run.amc")
    yield Performance(group, "run", course(motion.times_s, motion.joints))
    # both begin with a person who stands: looked at
    for name, seconds in (("131_04-dance", 0.8), ("135_06-martialArts", 1.6)):
        motion = read_cmu(folder / f"{name}.amc").part(0.0, seconds)
        yield Performance(group, "standing", course(motion.times_s, motion.joints))


def other_bodies(quick: bool) -> Iterator[Performance]:
    """The simulated movements with another body model, other tempo, and arms and legs that swing more or less."""
    body = load_body(model_path("human"))
    group = "simulated with another body model, 0.8 to 1.25 times as fast, 0.8 to 1.2 times as far"
    for name in list(body.movements)[: 2 if quick else None]:
        if name not in load_library(()).movements:
            continue
        for tempo in (0.8, 1.0, 1.25):
            for size in (0.8, 1.2):
                times = np.arange(0.0, 5.2, 0.04)
                poses = poses_of(name, body, times * tempo)
                usual = poses.mean(axis=0)
                larger = body.clamped(np.where(body.rotates, usual + size * (poses - usual), poses))
                # the turn about the vertical is not to be made larger
                larger[:, body.root.turn] = poses[:, body.root.turn]
                end = 4.0 / tempo if name == "two_elbow_rotation" else 2.64 / tempo if name == "squat" else 5.2
                kept = times < end
                yield Performance(group, name, course_of(body, times[kept], larger[kept]))


def everyday_persons(quick: bool) -> Iterator[Performance]:
    """Everyday movements by persons of another body model, each of whom holds every joint a little otherwise.

    Each movement 0.8, 1 and 1.25 times as fast and 0.8, 1 and 1.25 times as far, every joint off by an angle of its
    own, 5 degrees standard deviation. The angles are of no seed that a rule was chosen with.
    """
    body = load_body(model_path("human"))
    for name, one in everyday().items():
        for k, (tempo, size) in enumerate(_PERSONS[: 1 if quick else None]):
            rng = np.random.default_rng([_SEED, k, *name.encode()])
            seconds = (max(2 * one.seconds, 1.5) if one.repeats else one.seconds) / tempo
            times = np.arange(0.0, seconds + 0.02, 0.04)
            poses = one.poses(body, times * tempo)
            usual = poses.mean(axis=0) if one.repeats else poses[0]
            posture = np.radians(5.0) * rng.standard_normal(body.dof) * body.rotates
            posture[body.root.turn] = 0
            larger = np.where(body.rotates, usual + size * (poses - usual), poses)
            yield Performance(EVERYDAY, name, course_of(body, times, body.clamped(larger + posture)))


def performers(library: Library, n: int) -> Iterator[Performance]:
    """The library's movements as others might do them.

    A posture of one's own (every limb turned by 6 degrees standard deviation), limbs that swing 0.8 to 1.2 times as
    far, a tempo that wanders between 0.75 and 1.3, and 3 degrees of noise in every frame, which is what tracking adds.
    """
    for name, movement in library.movements.items():
        for key, directions in movement.performances.items():
            for k in range(n):
                rng = np.random.default_rng([k, *key.encode(), *name.encode()])
                rounds = 2 if movement.description.repeats else 1
                yield Performance(
                    DISTURBED,
                    name,
                    _disturbed(np.tile(directions, (rounds, 1, 1)).astype(np.float64), rng),
                )


def _disturbed(directions: Array, rng: np.random.Generator) -> Course:
    n_frames = len(directions)
    knots = np.cumsum(1 / rng.uniform(0.75, 1.3, max(n_frames // 12, 2)))
    times = np.interp(np.arange(n_frames), np.linspace(0, n_frames - 1, len(knots)), knots)
    times = (times - times[0]) / (times[-1] - times[0]) * (n_frames - 1) / rng.uniform(0.75, 1.3)
    even = np.arange(0, times[-1])
    warped = np.stack([np.interp(even, times, column) for column in directions.reshape(n_frames, -1).T], axis=1)
    warped = warped.reshape(len(even), -1, 3)
    usual = warped.mean(axis=0)
    larger = usual + rng.uniform(0.8, 1.2) * (warped - usual)
    for limb in range(larger.shape[1]):
        posture = Rotation.from_rotvec(np.radians(6.0) * rng.standard_normal(3))
        noise = Rotation.from_rotvec(np.radians(3.0) * rng.standard_normal((len(even), 3)))
        larger[:, limb] = noise.apply(posture.apply(larger[:, limb]))
    larger /= np.linalg.norm(larger, axis=-1, keepdims=True)
    return Course(0.0, larger.astype(np.float32), np.ones(len(even), dtype=np.bool_))
