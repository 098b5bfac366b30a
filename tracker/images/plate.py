"""A clean plate: what a view shows without persons, and how it compares with an image in the light of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from tracker.foundation.arrays import Image, Mask, Region, frozen
from tracker.images.operations.light import SAMPLING, Light, light_of, sparse
from tracker.kernels.changes import MARGIN, median_level

MOST_LEVEL = 80.0
"""Threshold (6 sigmas of the noise, grey levels) above which a plate is of no use. Noise and a soft lens before a wall
full of sharp lines make it 44; in changing light that was not corrected it rose to 145 and hid 1415 of a view's 1542
edges: their geometric mean."""


@dataclass(frozen=True, eq=False)
class Plate:
    """A view without persons; what every frame needs of it is made once."""

    picture: Image
    """(h, w, 3) BGR, read-only."""

    unknown: Mask | None = None
    """(h, w) where the picture may show a person: nothing is foreground there, and nothing is background for sure. None
    for nowhere."""

    occluder: Mask | None = None
    """(h, w) where something stands before the persons: it hides them, so nothing is known there either. None for
    nowhere."""

    recorded: bool = False
    """Whether it was made of a recording with persons."""

    stays: bool = False
    """Whether somebody stays before it, so that it is unknown behind them: it tells of what they move alone."""

    def __post_init__(self) -> None:
        if self.picture.flags.writeable or self.picture.base is not None:
            object.__setattr__(self, "picture", frozen(self.picture, np.uint8))
        if self.occluder is not None:
            object.__setattr__(self, "occluder", frozen(self.occluder, np.bool_))
            unknown = self.occluder if self.unknown is None else self.unknown | self.occluder
            object.__setattr__(self, "unknown", unknown)
        if self.unknown is not None:
            object.__setattr__(self, "unknown", frozen(self.unknown, np.bool_) if self.unknown.any() else None)

    def hidden_by(self, occluder: Mask) -> Plate:
        """The same with something (h, w) more before the persons."""
        hidden = replace(self, occluder=occluder if self.occluder is None else self.occluder | occluder)
        hidden.__dict__.update(
            {name: self.__dict__[name] for name in ("fine", "coarse", "sparse") if name in self.__dict__}
        )
        return hidden

    @cached_property
    def fine(self) -> Image:
        """(h, w, 3) as lightly smoothed as the image that is compared with it."""
        smooth: Image = cv2.GaussianBlur(self.picture, (3, 3), 0)
        return smooth

    @cached_property
    def coarse(self) -> Image:
        """(h + 2 m, w + 2 m, 3) as smooth as the image whose light is compared with it, mirrored at the border.

        m is `MARGIN`.
        """
        whole = 0, 0, self.picture.shape[1], self.picture.shape[0]
        return cut(cv2.GaussianBlur(self.picture, (5, 5), 0), whole, MARGIN)

    @cached_property
    def sparse(self) -> Image:
        """(h / 4, w / 4, 3) every fourth pixel: enough to find light and noise."""
        return sparse(self.picture)


def in_light_of(image: Image, plate: Plate) -> Image:
    """The plate's picture (h, w, 3) as it would look in the light of an image."""
    light = light_of(sparse(image), plate.sparse)
    return plate.picture if light is None else light.on(plate.picture)


def threshold_level(image: Image, plate: Plate, sigmas: float = 6.0, least: float = 14.0) -> float:
    """Threshold of a difference image from its own noise, grey levels; see `lit_by`."""
    return lit_by(image, plate, sigmas, least).level


class Lit(NamedTuple):
    """How an image is compared with its plate."""

    light: Light | None
    """Of the image against that of the plate; None for pictures too small to tell."""

    level: float
    """Threshold of their difference from the noise of the whole image, grey levels."""

    differences: Image
    """(h / 4, w / 4) their largest channel difference in every fourth pixel, grey levels."""


def lit_by(image: Image, plate: Plate, sigmas: float = 6.0, least: float = 14.0) -> Lit:
    """The light of an image (h, w, 3) against its plate's, and the threshold of their difference.

    The median of the differences to the plate in the image's light is the noise of the background, which covers most
    of the image; a sixteenth of the pixels is enough to find it.
    """
    now = sparse(image)
    light = light_of(now, plate.sparse)
    expected = plate.sparse if light is None else light.on(plate.sparse, spacing=SAMPLING)
    differences = largest_difference(now, expected)
    return Lit(light, max(least, sigmas * median_level(differences) / 0.954), differences)


def largest_difference(image: Image, other: Image) -> Image:
    """(h, w) the largest channel difference of two pictures (h, w, 3), grey levels."""
    blue, green, red = cv2.split(cv2.absdiff(image, other))
    largest: Image = cv2.max(cv2.max(blue, green), red)
    return largest


def cut(picture: Image, region: Region, margin: int) -> Image:
    """A region with a margin, mirrored at the border of the picture."""
    x, y, width, height = region
    left, top = max(x - margin, 0), max(y - margin, 0)
    right, bottom = min(x + width + margin, picture.shape[1]), min(y + height + margin, picture.shape[0])
    part = picture[top:bottom, left:right]
    lacking = top - y + margin, y + height + margin - bottom, left - x + margin, x + width + margin - right
    return cv2.copyMakeBorder(part, *lacking, cv2.BORDER_REFLECT_101) if any(lacking) else part
