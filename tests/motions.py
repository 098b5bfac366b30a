"""A made-up movement of two persons, one of them lost for a while, and its result folder."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rig_samples import sample_rig

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig_layouts import save_rig
from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array, Mask
from tracker.results.recording import RunContext
from tracker.results.recording.journal import Journal
from tracker.results.recording.run_json import RunJson
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.trajectory import Step

MODELS = Path(__file__).parents[1] / "models"
LOST = slice(4, 7)
N_FRAMES, INTERVAL_S = 12, 0.04
SIGMA = 2.0**-10
"""Of every parameter, rad and m: a variance that a journal keeps to the bit."""


@dataclass(frozen=True)
class Movement:
    """The steps of a run, and the poses in them."""

    scene: Scene
    steps: list[Step]
    poses: list[Array]
    """(T, dof) of each person."""

    def context(self, folder: Path) -> RunContext:
        """The run that recorders are begun with."""
        return RunContext("made_up", folder, self.scene, fps=25.0, interval_s=INTERVAL_S, n_frames=len(self.steps))

    def record(self, recording: object, folder: Path) -> tuple[Path, ...]:
        """What a recording makes of it."""
        recorder = recording.begin(self.context(folder))
        for step in self.steps:
            recorder.write(step)
        return recorder.finish()

    def result(self, folder: Path) -> Path:
        """The result folder of the run, with what exports need."""
        (folder / "models").mkdir(parents=True)
        for recording in (Journal(), RunJson()):
            self.record(recording, folder)
        save_rig(self.scene.rig, folder / "rig.toml")
        for person in self.scene.persons:
            shutil.copy(MODELS / f"{person.body.name}.toml", folder / "models" / f"{person.name}.toml")
        return folder


def performed(body: BodyModel, poses: Array, lost: Mask | None = None) -> Movement:
    """A movement of one person, "anna": poses (T, dof) at `INTERVAL_S`, lost in some frames (T,)."""
    scene = Scene((Person("anna", body, body.rest()),), sample_rig("A", "B"))
    steps = []
    for t, q in enumerate(poses):
        estimate = estimate_of(q, len(body.parts), lost is not None and bool(lost[t]))
        steps.append(Step(Frame(t, INTERVAL_S * t, (None, None)), scene.with_poses((q,)), (estimate,), _blank()))
    return Movement(scene, steps, [poses])


def made_up(*models: str, seed: int = 0) -> Movement:
    """Persons called person1, ..., turning more than once round, all joints moving; the first is lost in `LOST`."""
    rng = np.random.default_rng(seed)
    bodies = [load_body(MODELS / f"{model}.toml") for model in models]
    persons = tuple(Person(f"person{k}", body, body.rest()) for k, body in enumerate(bodies, start=1))
    scene = Scene(persons, sample_rig("A", "B"))
    poses = []
    for body in bodies:
        phase, size = rng.uniform(0, 6, body.dof), np.where(body.rotates, 0.5, 0.3)
        q = size * np.sin(np.arange(N_FRAMES)[:, None] / 4 + phase)
        q[:, body.root.turn] = np.linspace(-3, 3, N_FRAMES)
        poses.append(body.clamped(q))
    steps = []
    for t in range(N_FRAMES):
        lost = [k == 0 and LOST.start <= t < LOST.stop for k in range(len(bodies))]
        estimates = tuple(estimate_of(q[t], len(b.parts), gone) for q, b, gone in zip(poses, bodies, lost, strict=True))
        posed = scene.with_poses(tuple(q[t] for q in poses))
        steps.append(Step(Frame(10 + t, 0.4 + INTERVAL_S * t, (None, None)), posed, estimates, _blank()))
    return Movement(scene, steps, poses)


def _blank() -> Contours:
    return Contours(
        np.zeros((1, 2, 1, 5), np.float32),
        np.zeros((1, 2, 1, 3), np.float32),
        np.zeros((1, 2, 1), np.int64),
        np.zeros((1, 2, 1), np.bool_),
        np.zeros((1, 2), np.int64),
    )


def estimate_of(q: Array, n_parts: int, lost: bool) -> Estimate:
    visible = np.arange(n_parts) * 10.0  # the first part is hidden
    account = Account(1.0, np.ones(2), np.ones(n_parts), visible, 0.75 * visible, np.zeros(n_parts))
    status = Status.LOST if lost else Status.TRACKED
    return Estimate(q, SIGMA**2 * np.eye(len(q)), account, penalty_px=0.0, evaluations=1, status=status)
