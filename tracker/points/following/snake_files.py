"""Snakes through a sequence, and what is written of them: a table, and a picture as the paper's figure 16."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.errors import ConfigError
from tracker.points.following.led_snakes import advanced, begun
from tracker.points.following.record import Rows
from tracker.points.following.snakes import Contour, Nodes, Snake
from tracker.points.following.tables import quoted

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
        """What to say of a snake that is doubtful, as a whole or in a part."""
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
    from where the points around, `leading` of them, have led it.
    """
    yield "frame,snake,view,node,x_px,y_px,edge_grey_px,shift_px,leading,status\n"
    for snake in snakes:
        for frame, nodes in zip(snake.frames, snake.nodes, strict=True):
            lead = f"{frame},{quoted(snake.name)},{quoted(views[snake.view])}"
            statuses = nodes.statuses
            for k, (x, y) in enumerate(nodes.places):
                edge = f"{abs(nodes.edges[k]):.2f}" if nodes.held[k] else ""
                row = f"{lead},{k},{x:.3f},{y:.3f},{edge},{nodes.shift_px[k]:.3f},{nodes.n_leading[k]},{statuses[k]}\n"
                yield row


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
