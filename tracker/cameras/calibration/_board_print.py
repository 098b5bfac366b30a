"""Boards for printing: pages of vectors, true to scale, with rulers that show whether the printer kept it."""

from __future__ import annotations

import pathlib
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from tracker.cameras.calibration._boards import Pattern, charuco_detector
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.files import replacing

PAPERS = {
    **{"a4": (210.0, 297.0), "a3": (297.0, 420.0), "a2": (420.0, 594.0), "a1": (594.0, 841.0), "a0": (841.0, 1189.0)},
    **{"letter": (215.9, 279.4), "tabloid": (279.4, 431.8)},
}
"""Widths and heights, mm (ISO 216; ANSI/ASME Y14.1)."""

_MARGIN_MM, _FOOT_MM = 14.0, 24.0
"""Margins that printers leave white, and that rulers and words take at the foot."""

_RIM_MM = 4.0
"""Around a board that is white on black."""

_RULER_MM = 100.0
"""Length of the scale for a ruler."""

_MM_PER_INCH = 25.4
"""Figures are in inches."""


@dataclass(frozen=True)
class BoardPrint:
    """A board on paper."""

    pattern: Pattern
    square_mm: float
    paper: str = "a4"
    back: bool = False
    """Whether a second page shows the same board seen through the paper, for printing on both sides."""

    @property
    def page_mm(self) -> tuple[float, float]:
        """Width and height of the page, turned so that larger squares fit."""
        sides = _sides(self.paper)
        columns, rows = _squares(self.pattern)
        return sides if (columns <= rows) else sides[::-1]

    @property
    def lines(self) -> str:
        """The lines of a configuration that describe the board, as measured on paper if the scale is kept."""
        pattern = self.pattern
        told = [f"columns = {pattern.columns}", f"rows = {pattern.rows}", f"square_m = {self.square_mm / 1000:g}"]
        if pattern.marker is not None:
            told += [f"marker_m = {pattern.marker * self.square_mm / 1000:g}", f'dictionary = "{pattern.dictionary}"']
        told += [f"{key} = true" for key, on in (("inverted", pattern.inverted), ("both_sides", self.back)) if on]
        return "\n".join(told)


def board_pattern(size: tuple[int, int], marker: float | None, dictionary: str, inverted: bool = False) -> Pattern:
    """A board of so many columns and rows; a plain chessboard without a marker.

    Raises:
        CalibrationError: its dictionary of markers is unknown, or too small.
    """
    if marker is None:
        return Pattern(*size, inverted=inverted)
    pattern = Pattern(*size, marker, dictionary.lower().removeprefix("dict_"), inverted=inverted)
    charuco_detector(pattern)
    return pattern


def largest_square_mm(pattern: Pattern, paper: str) -> int:
    """The side of the largest squares of whole millimetres with which a board fits a paper.

    Raises:
        ConfigError: there is no such paper, or not even squares of 1 mm fit it.
    """
    columns, rows = _squares(pattern)
    short, long = _sides(paper)
    width, height = (short, long) if columns <= rows else (long, short)
    found = int(min((width - 2 * _MARGIN_MM) / columns, (height - 2 * _MARGIN_MM - _FOOT_MM) / rows))
    if found < 1:
        raise ConfigError(f"--paper {paper}: {columns} x {rows} squares do not fit it, expected a larger one")
    return found


def write_board(path: pathlib.Path, board: BoardPrint) -> None:
    """Writes the pages of a board as PDF.

    Raises:
        ConfigError: it does not fit the paper.
        CalibrationError: its dictionary of markers is unknown, or too small.
    """
    largest = largest_square_mm(board.pattern, board.paper)
    if board.square_mm > largest:
        raise ConfigError(
            f"--square {board.square_mm / 1000:g}: does not fit {board.paper}, expected {largest / 1000:g} m at most "
            f"for {' x '.join(map(str, _squares(board.pattern)))} squares"
        )
    with replacing(path) as unfinished, PdfPages(unfinished) as pages:
        for page in page_figures(board):
            pages.savefig(page)


def page_figures(board: BoardPrint) -> Iterator[Figure]:
    """The pages, as large as the paper; see `write_board`."""
    for mirrored in (False, True) if board.back else (False,):
        width, height = board.page_mm
        figure = Figure(figsize=(width / _MM_PER_INCH, height / _MM_PER_INCH))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_xlim(0, width)
        axes.set_ylim(height, 0)
        axes.set_axis_off()
        _draw_board(axes, board, mirrored)
        _draw_foot(axes, board, mirrored)
        yield figure


def dark_cells(pattern: Pattern) -> tuple[Array, Array, Mask]:
    """The board as a grid of cells that are dark or not.

    Returns:
        (C + 1,) edges of the columns of cells and (R + 1,) of the rows, in squares, and (R, C) whether each is dark.
    """
    columns, rows = _squares(pattern)
    markers = _markers(pattern)
    inner = (1 - pattern.marker) / 2 if pattern.marker is not None else 0.0
    n_bits = next(iter(markers.values())).shape[0] if markers else 1
    steps = np.linspace(inner, 1 - inner, n_bits + 1) if markers else np.array([0.0])
    steps = steps if not markers or inner == 0 else np.r_[0.0, steps]
    x, y = (np.r_[(np.arange(n)[:, None] + steps).ravel(), n] for n in (columns, rows))
    middles_x, middles_y = np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2)
    column, row = middles_x.astype(int), middles_y.astype(int)
    dark = (column + row + pattern.legacy * (rows % 2 == 0)) % 2 == 0
    for (r, c), bits in markers.items():
        mine = (row == r) & (column == c)
        u, v = ((place[mine] % 1 - inner) / (1 - 2 * inner) * n_bits for place in (middles_x, middles_y))
        inside = (u >= 0) & (u < n_bits) & (v >= 0) & (v < n_bits)
        dark[mine] = np.where(inside, bits[v.astype(int) % n_bits, u.astype(int) % n_bits], False)
    return x, y, dark if not pattern.inverted else ~dark


def _squares(pattern: Pattern) -> tuple[int, int]:
    """Columns and rows of squares; a chessboard has its inner corners."""
    outside = 1 if pattern.marker is None else 0
    return pattern.columns + outside, pattern.rows + outside


def _sides(paper: str) -> tuple[float, float]:
    if paper not in PAPERS:
        raise ConfigError(f"--paper {paper}; {nearest(paper, PAPERS)}")
    return PAPERS[paper]


def _markers(pattern: Pattern) -> dict[tuple[int, int], Mask]:
    """Row and column of each square with a marker, and the marker's cells (n, n), True where dark."""
    if pattern.marker is None:
        return {}
    board = charuco_detector(pattern).getBoard()
    dictionary = board.getDictionary()
    side = dictionary.markerSize + 2  # with its rim
    found = {}
    for number, corners in zip(np.ravel(board.getIds()).tolist(), board.getObjPoints(), strict=True):
        column, row = np.asarray(corners)[:, :2].mean(axis=0).astype(int)
        found[int(row), int(column)] = cv2.aruco.generateImageMarker(dictionary, number, side) == 0
    return found


def _draw_board(axes: Axes, board: BoardPrint, mirrored: bool) -> None:
    """The dark cells as one path, so that no viewer shows seams between them."""
    x, y, dark = dark_cells(board.pattern)
    width, height = board.page_mm
    left = (width - board.square_mm * x[-1]) / 2
    top = (height - _FOOT_MM - board.square_mm * y[-1]) / 2
    if board.pattern.inverted:  # markers at the border need a dark rim
        rim = _RIM_MM / board.square_mm
        x, y, dark = (*(np.r_[-rim, edges, edges[-1] + rim] for edges in (x, y)), np.pad(dark, 1, constant_values=True))
    if mirrored:
        x, dark = x[-1] + x[0] - x[::-1], dark[:, ::-1]
    runs = []
    for row, line in enumerate(dark):
        ends = np.flatnonzero(np.diff(np.r_[0, line.astype(int), 0]))
        for begin, end in zip(ends[::2], ends[1::2], strict=True):
            corners = [(x[begin], y[row]), (x[end], y[row]), (x[end], y[row + 1]), (x[begin], y[row + 1])]
            places = (left, top) + board.square_mm * np.array([*corners, corners[0]])
            runs.append(Path(places, closed=True))
    axes.add_patch(PathPatch(Path.make_compound_path(*runs), facecolor="black", linewidth=0))


def _draw_foot(axes: Axes, board: BoardPrint, mirrored: bool) -> None:
    """Rulers along and across the paper, and what to do with them."""
    height = board.page_mm[1]
    left, line = _MARGIN_MM, height - _MARGIN_MM
    for k in range(int(_RULER_MM) + 1):
        length = 4.0 if k % 10 == 0 else 2.6 if k % 5 == 0 else 1.6
        axes.plot([left + k, left + k], [line, line - length], color="black", linewidth=0.3, solid_capstyle="butt")
        if k % 10 == 0:
            upright = line - k
            axes.plot([left - 8, left - 8 + 0.75 * length], [upright, upright], color="black", linewidth=0.3)
    axes.plot([left, left + _RULER_MM], [line, line], color="black", linewidth=0.3)
    axes.plot([left - 8, left - 8], [line, line - _RULER_MM], color="black", linewidth=0.3)
    words = (
        f"{'back, seen through; ' if mirrored else ''}print at 100 % (actual size). Both scales must be 100 mm long: "
        "measure them,\nthen ten squares, and tell the side as measured. Glue it to something flat."
    )
    axes.text(left, line + 4.5, words, fontsize=6.5, va="center")
    axes.text(left + _RULER_MM + 6, line, board.lines, fontsize=6.5, va="bottom", family="monospace")
