"""Snakes led by trajectories through a sequence (D'Apuzzo et al. 2000, section 3, figure 16), and their files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy.spatial import cKDTree

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.foundation.errors import ConfigError
from tracker.points.following.record import Rows
from tracker.points.following.snakes import Contour, Nodes, Snake, drawn_to_edges, normals_of, remembered
from tracker.points.following.tables import quoted

# Points that lead a node, and the least of them: three fix an affinity, twice as many show a wrong one.
_MOST, _LEAST = 12, 6
# Points at this distance count half; holds an affinity of near points towards a shift: both are choices.
_NEAR_PX, _STIFFNESS_PX2 = 10.0, 50.0
# Points that move otherwise than the median by three times the usual, and this, are of another surface.
_TIMES, _APART_PX = 3.0, 0.5


def led_nodes(
    places: Array, closed: bool, moved: tuple[Array, Array], reach_px: float, motion: Array
) -> tuple[Array, Integers]:
    """Carries the nodes of a contour along.

    A closed contour is led by points within it, which are of the same limb, wherever six of them are near.

    Args:
        places: (N, 2) nodes, px.
        closed: whether the contour is closed.
        moved: (M, 2) px of followed points in the same frame and in the next; NaN where not seen.
        reach_px: points farther from a node do not lead it.
        motion: (N, 2) of the nodes in the frame before, for those that no point leads.

    Returns:
        Where they are expected in the next frame (N, 2), and how many points led each one (N,).
    """
    known = np.isfinite(moved[0]).all(axis=1) & np.isfinite(moved[1]).all(axis=1)
    before, now = moved[0][known], moved[1][known]
    shifts, n_leading = np.full_like(places, np.nan), np.zeros(len(places), dtype=np.int64)
    if closed and len(before):
        own = inside(before, places)
        _lead(places, (before[own], now[own]), reach_px, shifts, n_leading)
    _lead(places, (before, now), reach_px, shifts, n_leading)
    return places + np.where(n_leading[:, None] > 0, shifts, motion), n_leading


def inside(points: Array, contour: Array) -> Mask:
    """(M,) points (M, 2) within a closed contour (N, 2), px."""
    low = np.floor(contour.min(axis=0)) - 1
    width, height = (contour.max(axis=0) - low + 3).astype(int)
    mask = np.zeros((height, width), dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(contour - low).astype(np.int32)], 1)
    # points that the view does not show may be projected anywhere, and the frame of the mask is empty
    columns, rows = np.round(np.clip(points - low, 0, (width - 1, height - 1))).astype(int).T
    own: Mask = mask[rows, columns] > 0
    return own


def _lead(places: Array, moved: tuple[Array, Array], reach_px: float, shifts: Array, n_leading: Integers) -> None:
    """Fills the shifts of the nodes that have none yet and enough of these points around them."""
    before, now = moved
    free = np.flatnonzero(n_leading == 0)
    if len(before) < _LEAST or not len(free):
        return
    gaps, near = cKDTree(before).query(places[free], k=min(_MOST, len(before)), distance_upper_bound=reach_px)
    for row, distances, chosen in zip(free, np.asarray(gaps), np.asarray(near), strict=True):
        own = chosen[np.isfinite(distances)]
        if len(own) >= _LEAST:
            shifts[row], n_leading[row] = _shift(before[own] - places[row], now[own] - before[own])


def _shift(offsets: Array, moved: Array) -> tuple[Array, int]:
    """Shift (2,) of the origin by an affinity of points at offsets (K, 2), after those that move otherwise are out."""
    gaps = np.linalg.norm(moved - np.median(moved, axis=0), axis=1)
    alike = gaps <= _TIMES * np.median(gaps) + _APART_PX
    o, m = offsets[alike], moved[alike]
    weight = 1.0 / (1.0 + (o**2).sum(axis=1) / _NEAR_PX**2)
    design = np.concatenate([o, np.ones((len(o), 1))], axis=1)
    mean = weight @ m / weight.sum()
    normal = (design * weight[:, None]).T @ design + np.diag([_STIFFNESS_PX2, _STIFFNESS_PX2, 0.0])
    solution = np.linalg.solve(normal, (design * weight[:, None]).T @ (m - mean))
    return solution[2] + mean, len(o)


# Snakes led by trajectories: contours of limbs followed in the image (D'Apuzzo et al. 2000, section 3, figure 16).

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


# Snakes through a sequence, and what is written of them: a table, and a picture as the paper's figure 16.

# A snake that lies on few edges for so long is not looked for any more: it would hold to whatever comes by.
_LOST_FRAMES = 10
# Pictures in the sheet and in a row of it, a side of each, and the surroundings of the snakes that they show, px.
_N_PICTURES, _IN_A_ROW, _SIDE_PX, _MARGIN_PX = 6, 3, 420, 40


@dataclass(frozen=True)
class Seen:
    """M followed points in the image of a view."""

    ids: Integers
    """(M,)"""

    pixels: Array
    """(M, 2) px."""


@dataclass
class FollowedSnake:
    """A snake in the frames so far."""

    name: str
    contour: Contour
    view: int
    """Index of the view."""

    frames: list[int] = field(default_factory=list)
    nodes: list[Nodes] = field(default_factory=list)
    lost_in: int | None = None
    """Frame in which it was given up; None while it is followed."""

    _last: Seen | None = None

    def look(self, snake: Snake, seen: Seen, frame: int, image: Image | None) -> None:
        """The next frame.

        Args:
            snake: how it is followed.
            seen: the followed points in its view.
            frame: number of the frame.
            image: what its view shows; None for nothing.
        """
        if image is None or self.lost_in is not None:
            return
        if self._last is None:
            try:
                nodes = begun(snake, self.contour, image)
            except ConfigError as error:
                raise ConfigError(f"snakes.{self.name}: {error}") from error
        else:
            _, before, now = np.intersect1d(self._last.ids, seen.ids, assume_unique=True, return_indices=True)
            nodes = advanced(snake, self.nodes[-1], self._last.pixels[before], seen.pixels[now], image)
        self._last = seen
        self.frames.append(frame)
        self.nodes.append(nodes)
        if len(self.nodes) > _LOST_FRAMES and all(nodes.doubtful for nodes in self.nodes[-_LOST_FRAMES:]):
            self.lost_in = frame

    @property
    def warning(self) -> str | None:
        """Warning about a snake that is doubtful, as a whole or in a part."""
        doubtful = [frame for frame, nodes in zip(self.frames, self.nodes, strict=True) if nodes.doubtful]
        if self.lost_in is not None:
            return (
                f"snake {self.name}: given up in frame {self.lost_in}, after {_LOST_FRAMES} frames near hardly an edge"
            )
        if doubtful:
            return f"snake {self.name}: doubtful in {len(doubtful)} frames, the first one {doubtful[0]}"
        unsure = [frame for frame, nodes in zip(self.frames, self.nodes, strict=True) if "unsure" in nodes.statuses]
        if unsure:
            return (
                f"snake {self.name}: in {len(unsure)} frames, the first one {unsure[0]}, a part of it may lie on "
                "another edge: `status` in snakes.csv says which"
            )
        return None


def seen_in(rows: Rows, rig: Rig, view: int) -> Seen:
    """The points of a frame in a view: their positions projected, or what the view shows where it is alone."""
    if rows["pixels"].shape[1] == 1:
        return Seen(rows["id"], rows["pixels"][:, 0].astype(np.float64))
    return Seen(rows["id"], rig.cameras[view].project(rows["position"]) if len(rows) else np.zeros((0, 2)))


def snakes_csv(snakes: Sequence[FollowedSnake], views: tuple[str, ...]) -> Iterator[str]:
    """A row for each node and frame.

    `edge_grey_px` is the strength of the edge that holds the node, empty where none does; `shift_px` how far that is
    from where the points around, `leading` of them, have led it. `sigma_px` is the standard deviation across
    the contour if no other edge holds it.
    """
    yield "frame,snake,view,node,x_px,y_px,edge_grey_px,shift_px,leading,sigma_px,status\n"
    for snake in snakes:
        for frame, nodes in zip(snake.frames, snake.nodes, strict=True):
            lead = f"{frame},{quoted(snake.name)},{quoted(views[snake.view])}"
            statuses = nodes.statuses
            for k, (x, y) in enumerate(nodes.places):
                edge = f"{abs(nodes.edges[k]):.2f}" if nodes.held[k] else ""
                row = f"{lead},{k},{x:.3f},{y:.3f},{edge},{nodes.shift_px[k]:.3f},{nodes.n_leading[k]}"
                yield f"{row},{nodes.sigma_px[k]:.3f},{statuses[k]}\n"


def sheet_frames(frames: Sequence[int]) -> tuple[int, ...]:
    """Frames that the picture shows: some, evenly spread."""
    rows = np.unique(np.linspace(0, len(frames) - 1, _N_PICTURES).round().astype(int))
    return tuple(frames[row] for row in rows)


def drawn(snakes: Sequence[FollowedSnake], image: Image, view: int, frame: int) -> Image:
    """A view with the snakes in it: green on their edges, orange where unsure, red elsewhere; lines join them."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    canvas: Image = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    for snake in snakes:
        if snake.view == view and frame in snake.frames:
            nodes = snake.nodes[snake.frames.index(frame)]
            places = np.round(8 * np.clip(nodes.places, -1e4, 1e4)).astype(np.int32)
            cv2.polylines(canvas, [places], nodes.closed, (0, 220, 255), 1, cv2.LINE_AA, shift=3)
            for (x, y), status, held in zip(places.tolist(), nodes.statuses, nodes.held, strict=True):
                colour = (40, 40, 255) if not held else (0, 140, 255) if status == "unsure" else (60, 220, 60)
                cv2.circle(canvas, (x, y), 12, colour, -1, cv2.LINE_AA, shift=3)
    return canvas


def sheet(snakes: Sequence[FollowedSnake], pictures: Sequence[tuple[int, int, Image]]) -> Image:
    """The pictures (frame, view, image) of the views with snakes in rows, cut to where the snakes ever are."""
    rows = []
    for view in sorted({view for _, view, _ in pictures}):
        own = [picture for picture in pictures if picture[1] == view]
        box = _box([s for s in snakes if s.view == view], own[0][2])
        cut = [_cut(picture, frame, box) for frame, _, picture in own]
        rows += [np.concatenate(cut[k : k + _IN_A_ROW], axis=1) for k in range(0, len(cut), _IN_A_ROW)]
    wide = max(row.shape[1] for row in rows)
    return np.concatenate([np.pad(row, ((0, 0), (0, wide - row.shape[1]), (0, 0))) for row in rows])


def _box(snakes: Sequence[FollowedSnake], image: Image) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of all held nodes in all frames, with a margin, px."""
    held = np.concatenate([nodes.places[nodes.held] for snake in snakes for nodes in snake.nodes])
    height, width = image.shape[:2]
    left, top = np.clip(held.min(axis=0) - _MARGIN_PX, 0, (width - 2, height - 2)).astype(int)
    right, bottom = np.clip(held.max(axis=0) + _MARGIN_PX, (left + 2, top + 2), (width, height)).astype(int)
    return int(left), int(top), int(right), int(bottom)


def _cut(picture: Image, frame: int, box: tuple[int, int, int, int]) -> Image:
    left, top, right, bottom = box
    part = picture[top:bottom, left:right]
    scaled: Image = cv2.resize(part, None, fx=_SIDE_PX / part.shape[0], fy=_SIDE_PX / part.shape[0])
    cv2.putText(scaled, str(frame), (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return scaled
