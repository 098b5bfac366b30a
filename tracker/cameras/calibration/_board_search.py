"""Looking for a board in the images of views; where it is not seen, it is soon told which board is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tracker.cameras.calibration._board_looks import FEWEST_CORNERS, shown_share, sighting, told_of
from tracker.cameras.calibration._board_order import SeenCorners
from tracker.cameras.calibration._board_start import FEWEST_BOARDS
from tracker.cameras.calibration._boards import Pattern, find_board, goes_on, plain_grey
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.errors import CalibrationError

_LOOKED_AGAIN = (16, 128, 1024)
"""Frames in which no view shows the board, after which it is looked what else they show."""
_KEPT, _LOOKED_AT = 6, 2
"""Pictures of a view that are kept, spread over the recording; those of each view that are looked at on the way."""
_SHARES, _AT_ODDS = 5, 0.1
"""Boards whose markers are measured, and the share by which the told size may differ: pictures tell it to 3 %."""


class BoardSearch:
    """What was seen of a board so far.

    Raises:
        CalibrationError: as soon as the pictures show another board than the one that is looked for.
    """

    def __init__(self, names: Sequence[str], patterns: Sequence[Pattern], square_m: float, both_sides: bool) -> None:
        self.seen: SeenCorners = {}
        """Corners in the board's frame, metres, and their pixels, by view and frame."""

        self.patterns = tuple(patterns)
        """How the board may look: one pattern, as soon as a picture has told which."""

        self._names, self._square_m, self._both_sides = names, square_m, both_sides
        self._kept: list[list[Image]] = [[] for _ in names]
        self._strides, self._counts = [1] * len(names), [0] * len(names)
        self._shares: list[float] = []

    def look(self, view: int, frame: int, image: Image) -> None:
        """Looks for the board in an image of a view."""
        numbers, pixels = self._found(image)
        shape = self._square_m * self.patterns[0].plan[numbers]
        if len(pixels) < FEWEST_CORNERS or _in_a_line(shape):
            self._keep(view, image)
            return
        if self._is_whole(view, image, pixels):
            self._measure_markers(image)
            self.seen[view, frame] = shape, pixels

    def after(self, n_frames: int) -> None:
        """Looks, after some frames in which no view has shown the board, which board they show."""
        if self.seen or n_frames not in _LOOKED_AGAIN:
            return
        found = sighting([picture for kept in self._kept for picture in kept[-_LOOKED_AT:]], self.patterns[0])
        if found is not None and found.is_meant(self.patterns[0]):
            raise CalibrationError(f"no view shows the board in {n_frames} frames; {found.told(self.patterns[0])}")

    def finish(self) -> None:
        """Looks, where a view has shown too few boards, what it shows instead."""
        counts = [sum(v == view for v, _ in self.seen) for view in range(len(self._names))]
        for view, name in enumerate(self._names):
            if counts[view] >= FEWEST_BOARDS:
                continue
            question = "are its images blank or blurred, or was the board never whole before this camera?"
            if max(counts) < FEWEST_BOARDS:
                question = "are the images blank or blurred, or columns, rows and dictionary not those of the board?"
            raise CalibrationError(
                f'view "{name}": the board is seen in {counts[view]} frames, expected at least {FEWEST_BOARDS}; '
                f"{told_of(self._kept[view], self.patterns[0]) or question}"
            )

    def _found(self, image: Image) -> tuple[Integers, Array]:
        """Numbers and pixels of the corners by the pattern that sees most; its rivals are left out from then on."""
        found = [self._both(image, pattern) for pattern in self.patterns]
        best = max(range(len(found)), key=lambda k: len(found[k][0]))
        if len(found[best][0]) >= FEWEST_CORNERS:
            self.patterns = (self.patterns[best],)
        return found[best]

    def _both(self, image: Image, pattern: Pattern) -> tuple[Integers, Array]:
        """As `find_board`, of the back of the board as well if it has one."""
        numbers, pixels = find_board(image, pattern)
        if self._both_sides and len(numbers) < FEWEST_CORNERS:
            numbers, pixels = find_board(np.ascontiguousarray(image[:, ::-1]), pattern)
            pixels = np.column_stack([image.shape[1] - 1 - pixels[:, 0], pixels[:, 1]])
        return numbers, pixels

    def _is_whole(self, view: int, image: Image, pixels: Array) -> bool:
        """Whether a chessboard is not a part of a larger one, whose corners would be taken for others."""
        pattern = self.patterns[0]
        if pattern.marker is not None or not goes_on(image, pixels, pattern.size):
            return True
        found = sighting([image], pattern)
        if found is not None and found.n_corners > len(pixels):
            raise CalibrationError(
                f'view "{self._names[view]}": more inner corners than {pattern.columns} x {pattern.rows}: '
                f"{found.told(pattern)}"
            )
        return False

    def _measure_markers(self, image: Image) -> None:
        """Compares the told size of the markers with what the first pictures show."""
        told = self.patterns[0].marker
        share = None if told is None or len(self._shares) >= _SHARES else shown_share(image, self.patterns[0])
        if share is None or told is None:
            return
        self._shares.append(share)
        middle = float(np.median(self._shares))
        if len(self._shares) == _SHARES and abs(middle / told - 1) > _AT_ODDS:
            raise CalibrationError(
                f"marker_m is {told:.2f} of square_m, and in the pictures {middle:.2f}: measure both again; if "
                f"square_m = {self._square_m:g} is right, marker_m is about {middle * self._square_m:.2g}"
            )

    def _keep(self, view: int, image: Image) -> None:
        """Keeps a picture without a board now and then, never many."""
        kept, self._counts[view] = self._kept[view], self._counts[view] + 1
        if self._counts[view] % self._strides[view]:
            return
        kept.append(plain_grey(image))
        if len(kept) > _KEPT:
            del kept[::2]
            self._strides[view] *= 2


def patterns_of(pattern: Pattern, legacy: bool | None) -> tuple[Pattern, ...]:
    """The patterns that a board may have: where its rows are even, ChArUco boards of old begin with a white square."""
    if legacy is None and pattern.marker is not None and pattern.rows % 2 == 0:
        return replace(pattern, legacy=False), replace(pattern, legacy=True)
    return (replace(pattern, legacy=bool(legacy)),)


def _in_a_line(shape: Array) -> bool:
    spread = np.linalg.svd(shape - shape.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 0.1 * spread[0])
