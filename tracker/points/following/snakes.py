"""Snakes: the contours to follow, how they are followed, and their nodes in a frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pydantic

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component

# A triangle, or an arc.
_LEAST_CLICKS = 3
# A choice: nodes without an edge go where others lead them, for some frames they may be most.
_DOUBT = 0.5


@component
class Contour:
    """A contour to follow."""

    points: tuple[tuple[float, float], ...]
    """Clicked along it in the first frame, in order, px: `[[x, y], ...]`, each some px from it at most."""

    view: str | None = None
    """In which it is seen; None where one view alone is followed."""

    closed: bool = True
    """Whether the last point is joined to the first one; false for the outline of a limb that ends at the body."""

    limb: Literal["left", "right"] | None = None
    """On which side of an open contour the limb lies, as seen from the first point to the last; None if that is not
    told. The limb of a closed one is within it."""

    @pydantic.field_validator("points", mode="before")
    @classmethod
    def _enough(cls, points: object) -> object:
        if not isinstance(points, list | tuple):
            return points
        if len(points) < _LEAST_CLICKS:
            raise ValueError(f"{len(points)} points: a contour is clicked at {_LEAST_CLICKS} places or more")
        pairs = (isinstance(place, list | tuple) and len(place) == 2 for place in points)
        return tuple(tuple(map(float, place)) for place in points) if all(pairs) else points


@component
class Snake:
    """An active contour (Kass, Witkin, Terzopoulos 1988) whose prediction is the motion of the points around it.

    Each frame, nodes are carried along with the followed points near them; then edges are looked for along the normals,
    best for all nodes together (dynamic programming, Amini et al. 1990), and nodes are drawn to them as far as the
    snake bends.
    """

    step_px: float = pydantic.Field(default=4.0, ge=1)
    """Distance of its nodes in the first frame, px."""

    search_px: int = pydantic.Field(default=6, ge=1, le=50)
    """Edges are looked for so far on either side, px; twice as far in the first frame."""

    smoothing_px: float = pydantic.Field(default=1.0, gt=0, le=5)
    """Standard deviation of the Gaussian in which edges are seen, px."""

    elasticity: float = pydantic.Field(default=0.05, ge=0)
    """Weight of squared differences of neighbouring nodes' shifts from the prediction, against edges of weight 1."""

    rigidity: float = pydantic.Field(default=0.2, ge=0)
    """Weight of their squared second differences."""

    min_edge_grey: float = pydantic.Field(default=3.0, gt=0)
    """Weaker edges hold no node, grey levels a px."""

    reach_px: float = pydantic.Field(default=60.0, gt=0)
    """Followed points farther from a node do not lead it, px."""


@dataclass(frozen=True)
class Sides:
    """How both sides of a contour look: as they did where it began, apart from the light."""

    first: Array
    """(N, 2, C) mean grey values or colours to the left and the right of each node in the first frame; NaN of those
    that lay on no edge then."""

    limb: tuple[int, ...]
    """Which of them are the limb's, 0 left, 1 right: those that have to look as in the first frame. Both where nobody
    has told: then one at least has to."""

    light: Array
    """(C,) by how much all of them are brighter now."""

    def unsure(self, edges: Array, alike: Mask) -> Mask:
        """(N,) which edges (N,) may be others' that a limb's side is (N, 2) alike at.

        Beside the limb is something else, and the edge is turned, dark for bright, as where something passes before the
        limb; or one side looks otherwise, and nobody has told which is the limb's.
        """
        turned = (self.first[:, 0] - self.first[:, 1]).mean(axis=-1) * edges < 0
        unsure: Mask = ~alike[:, list(self.limb)].all(axis=1) | (turned & ~alike.all(axis=1))
        return unsure


@dataclass(frozen=True)
class Nodes:
    """A snake in a frame: N nodes."""

    places: Array
    """(N, 2) px."""

    closed: bool

    edges: Array
    """(N,) strength of the edge that each node lies on, signed: positive where it is brighter to the left of the
    direction of the contour as drawn in the image, grey levels a px; 0 for none."""

    n_leading: Integers
    """(N,) followed points that led each node; 0 where its neighbours on the contour did, or its own motion."""

    shift_px: Array
    """(N,) how far its edge is from where it was led to."""

    usual: float
    """Usual strength of its edges, grey levels a px."""

    motion: Array
    """(N, 2) of each node since the frame before, px."""

    sides: Sides | None = None
    """What an edge has to look like; None in the first frame."""

    alike: Mask = field(default_factory=lambda: np.zeros((0, 2), dtype=np.bool_))
    """(N, 2) whether the left and the right side of each node look as in the first frame."""

    @property
    def held(self) -> Mask:
        """(N,) nodes that an edge holds; the others go with their neighbours."""
        held: Mask = self.edges != 0
        return held

    @property
    def statuses(self) -> tuple[str, ...]:
        """(N,) what is known of each node.

        `followed`: it lies on an edge that looks as its own did; `unsure`: that may be another one, see `Sides.unsure`;
        `led`: no edge of the limb is near, it goes with its neighbours and the points around; `doubtful`: fewer
        than half of the frame's nodes are followed.
        """
        if self.doubtful:
            return ("doubtful",) * len(self.places)
        return tuple(np.where(~self.held, "led", np.where(self.followed, "followed", "unsure")).tolist())

    @property
    def followed(self) -> Mask:
        """(N,) nodes that lie on an edge that looks as their own did."""
        if self.sides is None:
            return self.held
        followed: Mask = self.held & ~self.sides.unsure(self.edges, self.alike)
        return followed

    @property
    def doubtful(self) -> bool:
        """Whether fewer than half of the nodes are followed.

        Of a lost arm a third stayed on edges of the background that look like its own, to the end of the recording.
        """
        return bool(self.followed.mean() < _DOUBT)


def snake_faults(contours: Mapping[str, Contour], views: tuple[str, ...]) -> str | None:
    """What is wrong with the views of contours; None for nothing."""
    for name, contour in contours.items():
        if contour.view is None and len(views) > 1:
            return f"snakes.{name}: in which view? expected view = one of {', '.join(views)}"
        if contour.view is not None and contour.view not in views:
            return f'snakes.{name}: view = "{contour.view}": expected one of {", ".join(views)}'
    return None
