"""Followed points joined by lines as a moving figure, beside the images it moves in (paper, figure 14)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import ConfigError, nearest
from tracker.images.film import film_writer

# Height of the film, px, even as the encoder wants it; sixteenths of a pixel that OpenCV draws in.
_HEIGHT_PX, _SHIFT = 480, 4
_LINE, _CROSS, _INK = (60, 220, 60), (40, 150, 255), (30, 30, 30)


def check_lines(lines: Sequence[Sequence[str]], names: Sequence[str]) -> None:
    """Lines join points that are followed.

    Raises:
        ConfigError: a line has one end alone, or names a point that there is not.
    """
    for line in lines:
        if len(line) < 2:
            raise ConfigError(f"lines: {list(line)}: a line joins two or more points")
        for name in line:
            if name not in names:
                raise ConfigError(f'lines: no point is called "{name}"; {nearest(name, tuple(names))}')


def joined(grey: Image, places: Array, lines: Sequence[Sequence[int]]) -> Image:
    """The image with the points and their lines, and the lines alone beside it.

    Args:
        grey: (h, w).
        places: (N, 2) px; NaN of points that are not seen, which no line leads to.
        lines: numbers of the points that each joins in turn.
    """
    scale = _HEIGHT_PX / grey.shape[0]
    width = 2 * round(grey.shape[1] * scale / 2)
    picture = cv2.cvtColor(cv2.resize(grey, (width, _HEIGHT_PX), interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    alone = np.full_like(picture, 255)
    at = (places + 0.5) * scale - 0.5
    for line in lines:
        for one, other in pairwise(line):
            ends = at[[one, other]]
            if np.isfinite(ends).all():
                first, second = np.round(ends * 2**_SHIFT).astype(int).tolist()
                cv2.line(picture, first, second, _LINE, 1, cv2.LINE_AA, _SHIFT)
                cv2.line(alone, first, second, _INK, 2, cv2.LINE_AA, _SHIFT)
    for place in at[np.isfinite(at).all(axis=1)]:
        cv2.drawMarker(picture, np.round(place).astype(int).tolist(), _CROSS, cv2.MARKER_CROSS, 9, 1, cv2.LINE_AA)
    return np.concatenate([picture, alone], axis=1)


def write_line_figure(
    path: Path, shown: Iterable[tuple[Image | None, Array]], lines: Sequence[Sequence[int]], fps: float
) -> None:
    """Writes the film.

    Args:
        path: of an MP4.
        shown: for each frame its image (h, w), None for none, and the points (N, 2) in it, px.
        lines: see `joined`.
        fps: frames a second.
    """
    with film_writer(path, fps) as add:
        for grey, places in shown:
            if grey is not None:
                add(joined(grey, places, lines))
