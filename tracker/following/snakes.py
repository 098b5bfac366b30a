"""Snakes led by trajectories: contours of limbs followed in the image (D'Apuzzo et al. 2000, section 3, figure 16)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pydantic

from tracker.arrays import Array, Array32, Image, Integers, Mask
from tracker.components import component
from tracker.errors import ConfigError
from tracker.following.leading import led_nodes

# A snake that begins looks so many times; clicks lie some px beside the contour, and normals turn as it nears it.
_FIRST_ROUNDS, _ROUNDS = 6, 2
# A step along the normal of an edge that is as strong as usual outweighs the search reach only by this: a choice.
_FAR = 0.25
# Of the usual strength: weaker edges do not hold a node.
_HOLDS = 0.25
# An edge whose dark side has changed counts half: the background has changed, or it is another edge.
_TURNED = 0.5
# Nodes on either side whose motion is one with a node's.
_SMOOTH_NODES = 4
# Share of a usual strength that each frame adds.
_LEARNT = 0.1


# A triangle, or an arc.
_LEAST_CLICKS = 3


@component
class Contour:
    """A contour to follow."""

    points: tuple[tuple[float, float], ...]
    """Clicked along it in the first frame, in order, px: `[[x, y], ...]`, each some px from it at most."""

    view: str | None = None
    """In which it is seen; None where one view alone is followed."""

    closed: bool = True
    """Whether the last point is joined to the first one; false for the outline of a limb that ends at the body."""

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

    @property
    def held(self) -> Mask:
        """(N,) nodes that an edge holds; the others go with their neighbours."""
        held: Mask = self.edges != 0
        return held

    @property
    def doubtful(self) -> bool:
        """Whether fewer than half of the nodes lie on an edge."""
        return bool(self.held.mean() < _DOUBT)


# A choice: nodes without an edge go where others lead them, for some frames they may be most.
_DOUBT = 0.5


def begun(snake: Snake, contour: Contour, image: Image) -> Nodes:
    """A clicked contour drawn to the edges near it.

    Raises:
        ConfigError: a point lies outside the image, or most of the contour is near no edge.
    """
    clicks = np.array(contour.points, dtype=np.float64)
    height, width = image.shape[:2]
    for x, y in clicks:
        if not (0 <= x < width and 0 <= y < height):
            raise ConfigError(f"point [{x:g}, {y:g}] lies outside the image of {width} x {height} px")
    length = np.linalg.norm(np.diff(_ring(clicks, contour.closed), axis=0), axis=1).sum()
    places = evenly(clicks, contour.closed, max(6, round(length / snake.step_px)))
    n = len(places)
    nodes = Nodes(places, contour.closed, np.zeros(n), np.zeros(n, np.int64), np.zeros(n), 0.0, np.zeros((n, 2)))
    wide = replace(snake, search_px=2 * snake.search_px)
    for k in range(_FIRST_ROUNDS):
        nodes = _drawn_to_edges(wide if k < _FIRST_ROUNDS // 2 else snake, nodes, image, rounds=1)
    nodes = replace(nodes, motion=np.zeros((n, 2)), shift_px=np.zeros(n))
    if nodes.doubtful:
        raise ConfigError(
            f"{int(nodes.held.sum())} of {n} nodes lie on an edge of {snake.min_edge_grey:g} grey levels a px or more: "
            "click along a contour that is seen, more densely, or lower snake.min_edge_grey"
        )
    return nodes


def advanced(snake: Snake, nodes: Nodes, before: Array, now: Array, image: Image) -> Nodes:
    """A snake in the next frame.

    Args:
        snake: how.
        nodes: in the frame before.
        before, now: (M, 2) px of the followed points in both frames; NaN where one is not seen.
        image: the next frame.
    """
    led, n_leading = led_nodes(nodes.places, nodes.closed, (before, now), snake.reach_px, nodes.motion)
    found = _drawn_to_edges(snake, replace(nodes, places=led), image, _ROUNDS)
    shift = np.linalg.norm(found.places - led, axis=1)
    spaced = evenly(found.places, nodes.closed, len(led))
    motion = _own_motion(found.places - nodes.places, _normals(found.places, nodes.closed), found.held, nodes.closed)
    return replace(found, places=spaced, n_leading=n_leading, shift_px=shift, motion=motion)


def _own_motion(moved: Array, normals: Array, held: Mask, closed: bool) -> Array:
    """What a contour shows of its motion: that of the held nodes along their normals, smooth along the contour.

    The others go with the nearest held ones: their own shifts show nothing, and free ends would run away.
    """
    own = np.flatnonzero(held)
    if not len(own):
        return np.zeros_like(moved)
    along = (moved[own] * normals[own]).sum(axis=1)
    reach = min(_SMOOTH_NODES, (len(along) - 1) // 2)
    padded = np.pad(along, reach, mode="wrap" if closed else "edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1), axis=1)
    shown, n = smooth[:, None] * normals[own], len(moved)
    period = n if closed else None
    return np.stack([np.interp(np.arange(n), own, shown[:, k], period=period) for k in range(2)], axis=1)


def _drawn_to_edges(snake: Snake, nodes: Nodes, image: Image, rounds: int) -> Nodes:
    """The same snake on the edges around."""
    smooth = cv2.GaussianBlur(_grey(image), (0, 0), snake.smoothing_px)
    places, edges, usual = nodes.places, nodes.edges, nodes.usual
    for _ in range(rounds):
        normals = _normals(places, nodes.closed)
        slopes = _slopes(smooth, places, normals, snake.search_px)
        strength = np.where(slopes * np.sign(nodes.edges)[:, None] < 0, _TURNED, 1.0) * np.abs(slopes)
        if not usual:
            usual = max(float(np.median(strength.max(axis=1))), snake.min_edge_grey)
        best = _best(snake, strength / usual, nodes.closed)
        at, found = _refined(slopes, best)
        holds = np.abs(found) >= max(snake.min_edge_grey, _HOLDS * usual)
        weight = np.where(holds, np.minimum(np.abs(found) / usual, 1.0), 0.0)
        shifts = _relaxed(snake, weight, at - snake.search_px, nodes.closed)
        places = places + shifts[:, None] * normals
        edges = np.where(holds, found, 0.0)
    held = edges != 0
    learnt = float(np.median(np.abs(edges[held]))) if held.any() else usual
    return replace(nodes, places=places, edges=edges, usual=(1 - _LEARNT) * usual + _LEARNT * learnt)


def _grey(image: Image) -> Array32:
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(grey, dtype=np.float32)


def _ring(places: Array, closed: bool) -> Array:
    return np.concatenate([places, places[:1]]) if closed else places


def evenly(places: Array, closed: bool, n: int) -> Array:
    """(n, 2) places at even distances along a contour; open ones keep their ends, closed ones their first node."""
    ring = _ring(places, closed)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    wanted = np.linspace(0.0, along[-1], n, endpoint=not closed)
    return np.stack([np.interp(wanted, along, ring[:, k]) for k in range(2)], axis=1)


def _normals(places: Array, closed: bool) -> Array:
    """(N, 2) unit normals, to the left of the direction of the contour as drawn in the image."""
    ends = np.pad(places, ((1, 1), (0, 0)), mode="wrap" if closed else "edge")
    tangents = ends[2:] - ends[:-2]
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-9)
    return np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)


def _slopes(smooth: Array32, places: Array, normals: Array, reach: int) -> Array:
    """(N, 2 reach + 1) derivatives of the grey values along the normals, a px apart."""
    offsets = np.arange(-reach - 1, reach + 2)
    at = (places[:, None] + offsets[:, None] * normals[:, None]).astype(np.float32)
    grey = cv2.remap(smooth, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(0.5 * (grey[:, 2:] - grey[:, :-2]), dtype=np.float64)


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


def _relaxed(snake: Snake, weight: Array, shifts: Array, closed: bool) -> Array:
    """The snake's equation (Kass et al. 1988, eq. 9, in shifts): ``(W + a D1'D1 + b D2'D2) s = W shifts``."""
    n = len(weight)
    unit = np.eye(n)
    first = np.roll(unit, 1, axis=1) - unit
    second = np.roll(unit, 1, axis=1) - 2 * unit + np.roll(unit, -1, axis=1)
    if not closed:
        first, second = first[:-1], second[1:-1]
    stiff = snake.elasticity * first.T @ first + snake.rigidity * second.T @ second
    # A thousandth of an edge holds nodes of a snake that lies on none where they were led.
    normal = stiff + np.diag(weight + 1e-3)
    return np.asarray(np.linalg.solve(normal, weight * shifts), dtype=np.float64)


def snake_faults(contours: Mapping[str, Contour], views: tuple[str, ...]) -> str | None:
    """What is wrong with the views of contours; None for nothing."""
    for name, contour in contours.items():
        if contour.view is None and len(views) > 1:
            return f"snakes.{name}: in which view? expected view = one of {', '.join(views)}"
        if contour.view is not None and contour.view not in views:
            return f'snakes.{name}: view = "{contour.view}": expected one of {", ".join(views)}'
    return None
