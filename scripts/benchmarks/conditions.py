"""Conditions a recording is tracked under: frame rates, clutter, missing and black views, wrong bodies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Image
from tracker.images.plate import Plate
from tracker.synthesis.simulation.sequence import Recipe, Simulation

# Of the simulations, as PAL has.
FPS = 25.0


@dataclass(frozen=True)
class Condition:
    """What is made harder than four views, 25 frames a second, clean plates and the exact body."""

    name: str
    movement: str
    every: int = 1
    """Frames of the 25 a second that are seen: every so many."""

    girth: float = 1.0
    """Factor on the radii of the body that tracks; the images show the exact one."""

    plates: bool = True
    """Whether the analysis is given background plates."""

    lines: int = 0
    """Random lines across the pictures, behind the person."""

    view_missing: bool = False
    """The first view has no image in the disturbed frames."""

    view_black: bool = False
    """The first view is black in the disturbed frames."""

    def recipe(self, size: tuple[int, int], seconds: float) -> Recipe:
        """What is simulated."""
        return Recipe(self.movement, seconds=seconds, fps=FPS / self.every, size=size)

    def recorded(self, simulation: Simulation) -> Simulation:
        """The simulation in the room of this condition."""
        if not self.lines:
            return simulation
        rng = np.random.default_rng(5)
        return replace(
            simulation, plates=tuple(Plate(_lined(plate.picture, rng, self.lines)) for plate in simulation.plates)
        )

    def frames(self, simulation: Simulation) -> Iterator[Frame]:
        """The images as they come: disturbed for 20 frames from the eleventh, or a third where there are fewer."""
        n_frames = len(simulation.recipe.times)
        first = min(10, n_frames // 3)
        disturbed = range(first, first + min(20, n_frames // 3))
        for frame in simulation.frames():
            yield self._disturbed(frame) if frame.index in disturbed else frame

    def _disturbed(self, frame: Frame) -> Frame:
        image = frame.images[0]
        if self.view_missing:
            image = None
        elif self.view_black and image is not None:
            image = np.zeros_like(image)
        return replace(frame, images=(image, *frame.images[1:]))

    def scene(self, simulation: Simulation) -> Scene:
        """The scene as the tracking is told."""
        person = simulation.scene.persons[0]
        return Scene((replace(person, body=_with_girth(person.body, self.girth)),), simulation.scene.rig)

    def known_plates(self, simulation: Simulation) -> tuple[Plate | None, ...]:
        """The plates as the analysis is given them."""
        return simulation.plates if self.plates else (None,) * len(simulation.plates)


def conditions(movements: tuple[str, ...]) -> list[Condition]:
    """All conditions; the frame rates for every movement, the others for all but the arm swing."""
    found = []
    for movement in movements:
        found.append(Condition("25 fps", movement))
        found.append(Condition("every 2nd frame", movement, every=2))
        found.append(Condition("every 5th frame", movement, every=5))
        if movement != "arm_swing":
            found.append(Condition("no background plates", movement, plates=False))
            found.append(Condition("150 lines of clutter", movement, lines=150))
            found.append(Condition("30 lines, no plates", movement, plates=False, lines=30))
            found.append(Condition("150 lines, no plates", movement, plates=False, lines=150))
            found.append(Condition("one view missing", movement, view_missing=True))
            found.append(Condition("one view black", movement, view_black=True))
            found.append(Condition("radii +6 %", movement, girth=1.06))
            found.append(Condition("radii -6 %", movement, girth=0.94))
    return found


def _with_girth(body: BodyModel, factor: float) -> BodyModel:
    return body.with_shapes(tuple(part.shape.scaled(1.0, factor) for part in body.parts))


def _lined(plate: Image, rng: np.random.Generator, n_lines: int) -> Image:
    """The plate crossed by straight lines of any colour, width and direction."""
    picture, size = plate.copy(), np.array(plate.shape[1::-1])
    for ends in rng.uniform(-0.1, 1.1, (n_lines, 2, 2)) * size:
        colour = tuple(int(c) for c in rng.integers(10, 245, 3))
        start, end = (tuple(round(float(c)) for c in point) for point in ends)
        cv2.line(picture, start, end, colour, int(rng.integers(1, 5)), cv2.LINE_AA)
    return picture
