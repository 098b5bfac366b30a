"""Snakes led by trajectories: contours of limbs followed in the image (D'Apuzzo et al. 2000, section 3, figure 16)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.errors import ConfigError
from tracker.points.following.leading import led_nodes
from tracker.points.following.snake_edges import drawn_to_edges, normals_of, remembered
from tracker.points.following.snakes import Contour, Nodes, Snake

# A snake that begins looks so many times; clicks lie some px beside the contour, and normals turn as it nears it.
_FIRST_ROUNDS, _ROUNDS = 6, 2
# Nodes on either side whose motion is one with a node's.
_SMOOTH_NODES = 4


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
        nodes = drawn_to_edges(wide if k < _FIRST_ROUNDS // 2 else snake, nodes, image, rounds=1)
    nodes = replace(nodes, motion=np.zeros((n, 2)), shift_px=np.zeros(n))
    nodes = remembered(snake, nodes, image, _limb_of(contour, nodes.places))
    if nodes.doubtful:
        raise ConfigError(
            f"{int(nodes.held.sum())} of {n} nodes lie on an edge of {snake.min_edge_grey:g} grey levels a px or more: "
            "click along a contour that is seen, more densely, or lower snake.min_edge_grey"
        )
    return nodes


def _limb_of(contour: Contour, places: Array) -> tuple[int, ...]:
    """Sides of the limb, 0 left, 1 right, as far as that is told."""
    if contour.limb is not None and not contour.closed:
        return (0,) if contour.limb == "left" else (1,)
    after = np.roll(places, -1, axis=0)
    turns_right = (places[:, 0] * after[:, 1] - after[:, 0] * places[:, 1]).sum() > 0
    return (0, 1) if not contour.closed else (1,) if turns_right else (0,)


def advanced(snake: Snake, nodes: Nodes, before: Array, now: Array, image: Image) -> Nodes:
    """A snake in the next frame.

    Args:
        snake: how.
        nodes: in the frame before.
        before, now: (M, 2) px of the followed points in both frames; NaN where one is not seen.
        image: the next frame.
    """
    led, n_leading = led_nodes(nodes.places, nodes.closed, (before, now), snake.reach_px, nodes.motion)
    found = drawn_to_edges(snake, replace(nodes, places=led, n_leading=n_leading), image, _ROUNDS)
    shift = np.linalg.norm(found.places - led, axis=1)
    spaced = evenly(found.places, nodes.closed, len(led))
    motion = _own_motion(found.places - nodes.places, normals_of(found.places, nodes.closed), found.held, nodes.closed)
    return replace(found, places=spaced, shift_px=shift, motion=motion)


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


def _ring(places: Array, closed: bool) -> Array:
    return np.concatenate([places, places[:1]]) if closed else places


def evenly(places: Array, closed: bool, n: int) -> Array:
    """(n, 2) places at even distances along a contour; open ones keep their ends, closed ones their first node."""
    ring = _ring(places, closed)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    wanted = np.linspace(0.0, along[-1], n, endpoint=not closed)
    return np.stack([np.interp(wanted, along, ring[:, k]) for k in range(2)], axis=1)
