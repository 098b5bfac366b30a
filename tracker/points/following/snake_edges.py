"""Snakes drawn to the edges along their normals, as far as they bend (Kass et al. 1988, Amini et al. 1990)."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Array32, Image, Integers
from tracker.points.following.snake_sides import FAR_PX, HALF_WAY, gaps_to_first, lit, own_share, sides_of
from tracker.points.following.snakes import Nodes, Sides, Snake

# A step along the normal of an edge that is as strong as usual outweighs the search reach only by this: a choice.
_FAR = 0.25
# Of the usual strength: weaker edges do not hold a node.
_HOLDS = 0.25
# An edge whose dark side has changed counts half: the background has changed, or it is another edge.
_TURNED = 0.5
# Share of a usual strength that each frame adds.
_LEARNT = 0.1
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
        shifts = _relaxed(snake, weight, at - snake.search_px, nodes.closed)
        places = places + shifts[:, None] * normals
        edges = np.where(holds, found, 0.0)
        light = looks[rows, best]
    held = edges != 0
    learnt = float(np.median(np.abs(edges[held]))) if held.any() else usual
    usual = (1 - _LEARNT) * usual + _LEARNT * learnt
    sides = nodes.sides if light is None else lit(nodes.sides, light, held[:, None] & alike)
    return replace(nodes, places=places, edges=edges, usual=usual, alike=alike, sides=sides)


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
