"""Snakes: the contours to follow, how they are followed, and their nodes in a frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
import pydantic

from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask
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
    """Its view; None if only one view is followed."""

    closed: bool = True
    """Whether the last point is joined to the first one; false for the outline of a limb that ends at the body."""

    limb: Literal["left", "right"] | None = None
    """Side of an open contour on which the limb lies, as seen from the first point to the last; None if not given. The
    limb of a closed one is within it."""

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

    In each frame, nodes move with the followed points near them; then a search along the normals finds edges, best for
    all nodes together (dynamic programming, Amini et al. 1990), and nodes move to them as far as the snake bends.
    """

    step_px: float = pydantic.Field(default=4.0, ge=1)
    """Distance of its nodes in the first frame, px."""

    search_px: int = pydantic.Field(default=6, ge=1, le=50)
    """Range of the search for edges on either side, px; twice as far in the first frame."""

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
    """Appearance of both sides of a contour: as at its beginning, apart from the light."""

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

        A thing beside the limb turns the edge, dark for bright, as when it passes before the limb; or one side looks
        different, and the limb's side was not given.
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

    sigma_px: Array = field(default_factory=lambda: np.zeros(0))
    """(N,) standard deviation of each node across the contour, if the edges that hold it and its neighbours are the
    contour's, px."""

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
    """Faults of the views of contours; None for none."""
    for name, contour in contours.items():
        if contour.view is None and len(views) > 1:
            return f"snakes.{name}: in which view? expected view = one of {', '.join(views)}"
        if contour.view is not None and contour.view not in views:
            return f'snakes.{name}: view = "{contour.view}": expected one of {", ".join(views)}'
    return None


# Whether the sides of a contour look as they did where it began: what tells its edge from others beside it.

# A side is what lies so far from an edge, px: beyond its blur, within a finger.
_NEAR_PX, FAR_PX = 2, 5
# Of the way from how one side looked to how the other one did: from here on it is rather something else.
HALF_WAY = 0.5
# Nodes on either side that a node may have slid along the contour: it is held across it alone.
_SLID = 4
# Contrasts below this are noise, grey levels.
_LEAST_GREY = 8.0


def sides_of(across: Array32) -> Array:
    """(N, K, 2, C) means to the left and the right of each of K columns, of grey values (N, K + 2 FAR_PX, C)."""
    width = across.shape[1] - 2 * FAR_PX

    def mean(first: int, last: int) -> Array:
        return np.asarray(np.mean([across[:, k : k + width] for k in range(first, last + 1)], axis=0))

    return np.stack([mean(FAR_PX + _NEAR_PX, 2 * FAR_PX), mean(0, FAR_PX - _NEAR_PX)], axis=2)


def gaps_to_first(sides: Sides | None, looks: Array) -> Array:
    """(N, K, 2) how far the sides (N, K, 2, C) are from how they looked: 0 alike, 1 as the other side did."""
    if sides is None:
        return np.zeros(looks.shape[:3])
    first, n = sides.first, len(looks)
    contrasts = _distance(first[:, 0], first[:, 1])
    contrasts = np.fmax(contrasts, np.fmax(np.nanmedian(contrasts), _LEAST_GREY))
    gaps = np.full(looks.shape[:3], np.inf)
    for slid in range(-_SLID, _SLID + 1):
        known = first[np.clip(np.arange(n) + slid, 0, n - 1)]
        gaps = np.fmin(gaps, _distance(looks - sides.light, known[:, None]))
    return np.asarray(gaps / contrasts[:, None, None])


def own_share(sides: Sides | None, gaps: Array) -> Array:
    """(N, K) how far an edge counts whose sides are (N, K, 2) from how they looked: by its limb."""
    own = gaps if sides is None else gaps[..., list(sides.limb)]
    share: Array = np.clip((1 - own.min(axis=-1)) / (1 - HALF_WAY), 0.0, 1.0)
    return share


def lit(sides: Sides | None, looks: Array, alike: Mask) -> Sides | None:
    """Sides in the light of a frame in which they look so (N, 2, C), some of them (N, 2) as in the first frame."""
    if sides is None:
        return None
    own = alike & np.isin((0, 1), sides.limb) & np.isfinite(sides.first).all(axis=-1)
    return replace(sides, light=np.nanmedian((looks - sides.first)[own], axis=0)) if own.any() else sides


def _distance(one: Array, other: Array) -> Array:
    """Root mean square difference of grey values or colours (..., C)."""
    return np.asarray(np.sqrt(np.mean((one - other) ** 2, axis=-1)))


# Snakes drawn to the edges along their normals, as far as they bend (Kass et al. 1988, Amini et al. 1990).

# A step along the normal of an edge that is as strong as usual outweighs the search reach only by this: a choice.
_FAR = 0.25
# Of the usual strength: weaker edges do not hold a node.
_HOLDS = 0.25
# An edge whose dark side has changed counts half: the background has changed, or it is another edge.
_TURNED = 0.5
# Share of a usual strength that each frame adds.
_LEARNT = 0.1
# Least s0^2 of edges, px^2: a turning ellipse of noise 2 was 0.05 to 0.09 px off where its edges agreed to 0.05.
_LEAST_PX2 = 0.1**2
# Of blue, green and red in a grey value (ITU-R BT.601).
_GREY = np.array((0.114, 0.587, 0.299), dtype=np.float32)


def drawn_to_edges(snake: Snake, nodes: Nodes, image: Image, rounds: int) -> Nodes:
    """The same snake on the edges around that look as those of the first frame.

    Args:
        snake: how.
        nodes: where it is expected.
        image: to look in.
        rounds: how often it looks, each time along the normals that it has then.
    """
    smooth = _smooth(snake, image)
    places, edges, usual, alike, light = nodes.places, nodes.edges, nodes.usual, nodes.alike, None
    misfit, spread = 0.0, nodes.sigma_px
    for _ in range(rounds):
        normals = normals_of(places, nodes.closed)
        across = _across(smooth, places, normals, snake.search_px)
        slopes = _slopes(across)
        strength = np.where(slopes * np.sign(nodes.edges)[:, None] < 0, _TURNED, 1.0) * np.abs(slopes)
        if not usual:
            usual = max(float(np.median(strength.max(axis=1))), snake.min_edge_grey)
        looks = sides_of(across)
        gaps = gaps_to_first(nodes.sides, looks)
        best = _best(snake, strength * own_share(nodes.sides, gaps) / usual, nodes.closed)
        at, found = _refined(slopes, best)
        rows = np.arange(len(best))
        alike = gaps[rows, best] < HALF_WAY
        holds = np.abs(found) >= max(snake.min_edge_grey, _HOLDS * usual)
        if nodes.sides is not None:
            holds &= alike[:, list(nodes.sides.limb)].any(axis=1)
            # where points lead, an edge that may be another one is not needed
            holds &= (nodes.n_leading == 0) | ~nodes.sides.unsure(found, alike)
        weight = np.where(holds, np.minimum(np.abs(found) / usual, 1.0), 0.0)
        shifts, own, spread = _relaxed(snake, weight, at - snake.search_px, nodes.closed)
        # the first round tells it: later ones begin where that one has led
        misfit = max(misfit, own)
        places = places + shifts[:, None] * normals
        edges = np.where(holds, found, 0.0)
        light = looks[rows, best]
    held = edges != 0
    learnt = float(np.median(np.abs(edges[held]))) if held.any() else usual
    usual = (1 - _LEARNT) * usual + _LEARNT * learnt
    sides = nodes.sides if light is None else lit(nodes.sides, light, held[:, None] & alike)
    sigma = np.sqrt(max(misfit, _LEAST_PX2)) * spread
    return replace(nodes, places=places, edges=edges, usual=usual, alike=alike, sides=sides, sigma_px=sigma)


def remembered(snake: Snake, nodes: Nodes, image: Image, limb: tuple[int, ...]) -> Nodes:
    """A snake of the first frame that remembers how its sides look there; `limb` as in `Sides`."""
    across = _across(_smooth(snake, image), nodes.places, normals_of(nodes.places, nodes.closed), snake.search_px)
    # a node on no edge has background on both sides, and would take any of that for its limb later
    first = np.where(nodes.held[:, None, None], sides_of(across)[:, snake.search_px], np.nan)
    sides = Sides(first, limb, np.zeros(first.shape[-1]))
    return replace(nodes, sides=sides, alike=np.ones((len(first), 2), dtype=np.bool_))


def _smooth(snake: Snake, image: Image) -> Array32:
    """(H, W) or (H, W, 3) grey values or colours."""
    smooth: Array32 = cv2.GaussianBlur(np.asarray(image, dtype=np.float32), (0, 0), snake.smoothing_px)
    return smooth


def normals_of(places: Array, closed: bool) -> Array:
    """(N, 2) unit normals, to the left of the direction of the contour as drawn in the image."""
    ends = np.pad(places, ((1, 1), (0, 0)), mode="wrap" if closed else "edge")
    tangents = ends[2:] - ends[:-2]
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-9)
    return np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)


def _across(smooth: Array32, places: Array, normals: Array, reach: int) -> Array32:
    """(N, 2 (reach + FAR_PX) + 1, C) grey values or colours along the normals, a px apart."""
    offsets = np.arange(-reach - FAR_PX, reach + FAR_PX + 1)
    at = (places[:, None] + offsets[:, None] * normals[:, None]).astype(np.float32)
    seen = cv2.remap(smooth, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    across: Array32 = seen.reshape(*at.shape[:2], -1)
    return across


def _slopes(across: Array32) -> Array:
    """(N, 2 reach + 1) derivatives of the grey values."""
    grey = across @ _GREY if across.shape[-1] == 3 else across[..., 0]
    inner = grey[:, FAR_PX - 1 : grey.shape[1] - FAR_PX + 1]
    return np.asarray(0.5 * (inner[:, 2:] - inner[:, :-2]), dtype=np.float64)


def _best(snake: Snake, strength: Array, closed: bool) -> Integers:
    """(N,) columns of the edges that are strongest together with least bending; strengths (N, C) in usual ones."""
    n, n_columns = strength.shape
    half = n_columns // 2
    offset = np.arange(n_columns) - half
    cost = _FAR * (offset / half) ** 2 - np.minimum(strength, 1.0)
    # A closed contour is gone around twice; the second half of the first round and the first of the second are free of
    # ends.
    order = np.concatenate([np.arange(n), np.arange(n)]) if closed else np.arange(n)
    step = snake.elasticity * (offset[:, None] - offset) ** 2
    total, back = cost[order[0]], np.zeros((len(order), n_columns), dtype=np.int64)
    for k in range(1, len(order)):
        ways = total[:, None] + step
        back[k] = ways.argmin(axis=0)
        total = ways[back[k], np.arange(n_columns)] + cost[order[k]]
    chosen = np.zeros(len(order), dtype=np.int64)
    chosen[-1] = total.argmin()
    for k in range(len(order) - 1, 0, -1):
        chosen[k - 1] = back[k, chosen[k]]
    if not closed:
        return chosen
    return np.concatenate([chosen[n : n + n // 2], chosen[n // 2 : n]])


def _refined(slopes: Array, best: Integers) -> tuple[Array, Array]:
    """Columns of the maxima of parabolas through each three strengths (N,), and the signed slopes there."""
    n, n_columns = slopes.shape
    rows, inner = np.arange(n), np.clip(best, 1, n_columns - 2)
    left, middle, right = (np.abs(slopes[rows, inner + k]) for k in (-1, 0, 1))
    bend = left - 2 * middle + right
    peak = np.where((bend < 0) & (inner == best), 0.5 * (left - right) / np.where(bend < 0, bend, 1.0), 0.0)
    return best + np.clip(peak, -0.5, 0.5), slopes[rows, best]


def _relaxed(snake: Snake, weight: Array, shifts: Array, closed: bool) -> tuple[Array, float, Array]:
    """The snake's equation (Kass et al. 1988, eq. 9, in shifts): ``(W + a D1'D1 + b D2'D2) s = W shifts``.

    Read as a normal distribution, its matrix N is the information of the shifts in units of s0^2, the mean of
    ``(s - shifts)' W (s - shifts) + s' (N - W) s`` over the edges that hold a node.

    Returns:
        Shifts s (N,) px, s0^2 px^2, and roots (N,) of the diagonal of the inverse of N.
    """
    n = len(weight)
    unit = np.eye(n)
    first = np.roll(unit, 1, axis=1) - unit
    second = np.roll(unit, 1, axis=1) - 2 * unit + np.roll(unit, -1, axis=1)
    if not closed:
        first, second = first[:-1], second[1:-1]
    # A thousandth of an edge holds nodes of a snake that lies on none where they were led.
    stiff = snake.elasticity * first.T @ first + snake.rigidity * second.T @ second + 1e-3 * unit
    inverse = np.linalg.inv(stiff + np.diag(weight))
    found = inverse @ (weight * shifts)
    misfit = (weight * (found - shifts) ** 2).sum() + found @ stiff @ found
    s0_2 = float(misfit / max(int((weight > 0).sum()), 1))
    return np.asarray(found, dtype=np.float64), s0_2, np.sqrt(np.diag(inverse))
