"""Small simulated recordings and the components to track them with."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator
from dataclasses import fields, replace
from functools import cached_property

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.contours import ContourEvidence
from tracker.foundation.arrays import Array, Image
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, Simulation, simulate
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.initialization import Initialization, Stages
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.loss import LossRule
from tracker.tracking.objective import Objective
from tracker.tracking.prediction.polynomial import PolynomialPrediction
from tracker.tracking.start import Start

SMALL = (360, 288)
"""Image size of quick tests; a pixel is 12.5 mm at the person."""


class TrueStart:
    """Starts at the simulation's true poses, a little off."""

    def __init__(self, simulation: Simulation, off_deg: float = 1.0, off_m: float = 0.01) -> None:
        self.simulation, self.off_deg, self.off_m = simulation, off_deg, off_m
        self.asked: list[int] = []

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        self.asked.append(frame.index)
        rng = np.random.default_rng(frame.index)
        poses = []
        for person, truth in zip(self.simulation.scene.persons, self.simulation.poses, strict=True):
            off = np.where(person.body.rotates, np.radians(self.off_deg), self.off_m)
            poses.append(person.body.clamped(truth[frame.index] + off * rng.normal(size=person.body.dof)))
        return Start(tuple(poses))


class Rendered(Simulation):
    """A simulation that keeps its images, which are drawn when they are asked for.

    Many tests go through the same ones, most of them several times, and some look at the first one alone.
    """

    @cached_property
    def _drawn(self) -> tuple[list[Frame], Generator[Frame]]:
        return [], super().frames()  # type: ignore[return-value]

    def frames(self) -> Iterator[Frame]:
        drawn, more = self._drawn
        for t in range(len(self.recipe.times)):
            with _DRAWING:
                if t == len(drawn):
                    drawn.append(next(more))
                    for image in drawn[-1].images:
                        if image is not None:
                            image.setflags(write=False)
                if len(drawn) == len(self.recipe.times):
                    more.close()
            yield drawn[t]


_DRAWING = threading.Lock()
"""Some tests read frames in another thread."""


def small_simulation(movement: str = "arm_swing", n_frames: int = 8, **changes: object) -> Simulation:
    recipe = Recipe(movement, seconds=n_frames / 25, size=SMALL)
    made = simulate(replace(recipe, **changes))  # type: ignore[arg-type]
    return Rendered(**{field.name: getattr(made, field.name) for field in fields(made)})


class Staying:
    """An estimation that leaves persons where they are predicted."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        return objective.estimate(starts[0], 1e-6 * np.eye(objective.body.dof), 1)


def cycle_for(simulation: Simulation, start: Initialization | None = None, **changes: object) -> Cycle:
    cycle = Cycle(
        synthesis=CpuSynthesis(),
        evidence=ContourEvidence(),
        prediction=PolynomialPrediction(),
        estimation=HybridEstimation(),
        initialization=start or PcaInitialization(),
        loss=LossRule(),
        plates=simulation.plates,
    )
    return replace(cycle, **changes)  # type: ignore[arg-type]


def with_images(simulation: Simulation, change: Callable[[int, int, Image | None], Image | None]) -> Iterator[Frame]:
    """The simulation's frames with every image replaced by `change(frame, view, image)`."""
    for frame in simulation.frames():
        images = tuple(change(frame.index, v, image) for v, image in enumerate(frame.images))
        yield replace(frame, images=images)


def joint_errors_mm(simulation: Simulation, person: int, frame: int, q: Array) -> Array:
    """(L,) distances of the landmarks to the truth."""
    body = simulation.scene.persons[person].body
    gap = body.landmarks_in_world(q) - body.landmarks_in_world(simulation.poses[person][frame])
    return 1000 * np.linalg.norm(gap, axis=1)


def around(scene: Scene, n: int, off_deg: float, off_m: float) -> Array:
    """Poses (n, dof) scattered around the truth."""
    person = scene.persons[0]
    spread = np.where(person.body.rotates, np.radians(off_deg), off_m)
    return person.body.clamped(person.q + spread * np.random.default_rng(4).normal(size=(n, person.body.dof)))
