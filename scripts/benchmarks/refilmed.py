"""Recordings as other cameras deliver them: grey, exposing by themselves, shaken, under a lamp that is switched."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Image
from tracker.synthesis.simulation.sequence import Simulation

Change = Callable[[Image, float, int], Image]
"""Makes another image of one, at a time in seconds, of the view of a number."""


@dataclass(frozen=True)
class Refilmed(Simulation):
    """A simulation whose images are changed after they were sensed; its plates are not."""

    change: Change = lambda image, time_s, view: image

    def frames(self) -> Iterator[Frame]:
        """The changed images; see `tracker.synthesis.simulation.sequence.Simulation.frames`."""
        for frame in super().frames():
            images = tuple(
                None if image is None else self.change(image, frame.time_s, view)
                for view, image in enumerate(frame.images)
            )
            yield replace(frame, images=images)


def refilmed(simulation: Simulation, change: Change) -> Refilmed:
    """A simulation filmed by cameras that change its images."""
    return Refilmed(**{name: getattr(simulation, name) for name in simulation.__dataclass_fields__}, change=change)


def grey(image: Image, time_s: float, view: int) -> Image:
    """Without colours."""
    return np.asarray(cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def grey_plates(folder: Path) -> None:
    """Takes the colours out of plates that were written."""
    for path in sorted(folder.glob("*.png")):
        picture = np.asarray(cv2.imread(str(path)), dtype=np.uint8)
        path.write_bytes(cv2.imencode(".png", grey(picture, 0.0, 0))[1].tobytes())


def adapting(image: Image, time_s: float, view: int) -> Image:
    """Every camera sets its exposure by itself, 18 % up and down in one and a half seconds, not with the others."""
    gain = 1 + 0.18 * np.sin(2 * np.pi * time_s / 1.5 + 1.7 * view)
    return np.asarray(cv2.convertScaleAbs(image, alpha=float(gain)), dtype=np.uint8)


def switched(image: Image, time_s: float, view: int) -> Image:
    """After a second some lamps are off: a third less light, of another colour."""
    if time_s < 1.0:
        return image
    dimmed = image * np.array([0.75, 0.65, 0.6], dtype=np.float32) + 3
    return np.clip(dimmed, 0, 255).astype(np.uint8)


def shaken(image: Image, time_s: float, view: int) -> Image:
    """Moved by 1.2 px of standard deviation in each direction, from frame to frame."""
    rng = np.random.default_rng((view, round(1000 * time_s)))
    x, y = 1.2 * rng.standard_normal(2)
    way = np.array([[1, 0, x], [0, 1, y]], dtype=np.float32)
    size = image.shape[1], image.shape[0]
    return np.asarray(cv2.warpAffine(image, way, size, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)
