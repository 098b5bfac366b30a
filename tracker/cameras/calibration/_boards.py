"""Chessboards and ChArUco boards in images, and the relative positions of views that see the same board."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Array32, Image, Integers
from tracker.foundation.errors import CalibrationError, nearest

DICTIONARIES = {name[5:].lower(): getattr(cv2.aruco, name) for name in dir(cv2.aruco) if name.startswith("DICT_")}
"""OpenCV's dictionaries of markers, by the names that a configuration has for them."""

_SADDLE = 0.5
"""Share of a board's contrast by which the squares around an inner corner differ at least, and do not at most."""
_BESIDE, _BEYOND = 0.35, 0.8
"""Squares from a corner to where its squares are looked at; share of a line's corners that go on behind a board."""


@dataclass(frozen=True)
class Pattern:
    """Pattern of a board: a chessboard of so many inner corners, or a ChArUco board of so many squares."""

    columns: int
    rows: int
    marker: float | None = None
    """Side of a marker, in squares; None for a plain chessboard."""

    dictionary: str = ""
    """Dictionary of the markers, for instance `4x4_50`."""

    legacy: bool = False
    """ChArUco: whether it begins with a white square where the number of rows is even, as of OpenCV before 4.6."""

    inverted: bool = False
    """Whether it is white on black."""

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        return self.columns, self.rows

    @property
    def plan(self) -> Array:
        """(N, 3) all its inner corners, row by row, in squares."""
        inside = 0 if self.marker is None else 1
        columns, rows = np.meshgrid(np.arange(self.columns - inside), np.arange(self.rows - inside))
        return np.stack([columns, rows, 0 * rows], axis=-1).reshape(-1, 3) + float(inside) * np.array([1.0, 1.0, 0.0])


def plain_grey(image: Image) -> Image:
    """(h, w) grey levels."""
    grey: Image = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return grey


def find_board(image: Image, pattern: Pattern) -> tuple[Integers, Array]:
    """Numbers (N,) in the pattern's plan and pixels (N, 2) of the corners that an image shows.

    Raises:
        CalibrationError: no such dictionary of markers, or too small a one.
    """
    shown = 255 - image if pattern.inverted else image
    if pattern.marker is not None:
        return find_charuco(shown, charuco_detector(pattern))
    corners = find_corners(shown, pattern.size)
    return (np.zeros(0, dtype=np.int64), np.zeros((0, 2))) if corners is None else (np.arange(len(corners)), corners)


def find_corners(image: Image, size: tuple[int, int]) -> Array | None:
    """Inner corners of a chessboard.

    Args:
        image: grey or colour.
        size: inner corners along a row, and rows.

    Returns:
        (columns * rows, 2) px, row by row; None where the board is not seen as a whole.
    """
    grey = plain_grey(image)
    found, corners = cv2.findChessboardCorners(
        grey, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    )
    if not found:
        return None
    spacing = np.linalg.norm(np.diff(corners.reshape(size[1], size[0], 2), axis=1), axis=2).min()
    half = int(np.clip(spacing / 3, 2, 11))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    refined = cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), criteria)
    return np.asarray(refined.reshape(-1, 2), dtype=np.float64)


def goes_on(image: Image, corners: Array, size: tuple[int, int]) -> bool:
    """Whether a chessboard has more inner corners than the (N, 2) found: those of a part of it are wrong."""
    grey = plain_grey(image).astype(np.float32)
    columns, rows = size
    plan = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(np.float64)
    matrix = cv2.findHomography(plan, corners)[0]
    if matrix is None:
        return False
    contrast = float(np.median(np.ptp(_around(grey, matrix, plan), axis=1)))
    along_rows, along_columns = np.arange(rows), np.arange(columns)
    beyond = [np.column_stack([np.full(rows, k), along_rows]) for k in (-1, columns)]
    beyond += [np.column_stack([along_columns, np.full(columns, k)]) for k in (-1, rows)]
    for line in beyond:
        a, b, c, d = _around(grey, matrix, line.astype(np.float64)).T
        apart, alike = np.abs(a + c - b - d) / 2, np.maximum(np.abs(a - c), np.abs(b - d))
        if np.mean((apart > _SADDLE * contrast) & (alike < _SADDLE * contrast)) > _BEYOND:
            return True
    return False


def _around(grey: Array32, matrix: Array, places: Array) -> Array:
    """(N, 4) grey levels of the four squares around places (N, 2) of a plan, one after another; NaN outside."""
    steps = _BESIDE * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    pixels = cv2.perspectiveTransform((places[:, None] + steps).reshape(1, -1, 2), matrix)[0].astype(np.float32)
    levels = cv2.remap(grey, pixels[:, 0], pixels[:, 1], cv2.INTER_LINEAR, borderValue=np.nan)
    return np.asarray(levels, dtype=np.float64).reshape(-1, 4)


@functools.lru_cache(maxsize=64)
def charuco_detector(pattern: Pattern) -> cv2.aruco.CharucoDetector:
    """OpenCV's detector of a ChArUco board.

    Raises:
        CalibrationError: no such dictionary of markers, or too small a one.
    """
    markers = markers_of(pattern.dictionary)
    needed, there = n_markers(pattern), len(markers.bytesList)
    if needed > there:
        raise CalibrationError(
            f"a board of {pattern.columns} x {pattern.rows} squares has {needed} markers, and dictionary = "
            f'"{pattern.dictionary}" has {there}; {_larger(pattern.dictionary, needed)}'
        )
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # it has a word on markers with a narrow rim
    try:
        board = cv2.aruco.CharucoBoard(pattern.size, 1.0, pattern.marker or 0.0, markers)
    finally:
        cv2.utils.logging.setLogLevel(level)
    board.setLegacyPattern(pattern.legacy)
    return cv2.aruco.CharucoDetector(board)


def markers_of(dictionary: str) -> Any:
    """OpenCV's dictionary of a name.

    Raises:
        CalibrationError: there is none.
    """
    key = dictionary.lower().removeprefix("dict_")
    if key not in DICTIONARIES:
        raise CalibrationError(f'dictionary = "{dictionary}"; {nearest(key, DICTIONARIES)}')
    return cv2.aruco.getPredefinedDictionary(DICTIONARIES[key])


def n_markers(pattern: Pattern) -> int:
    """Markers of a ChArUco board: on every second square."""
    return pattern.columns * pattern.rows // 2


@functools.cache
def families() -> dict[str, list[str]]:
    """Dictionaries that share their first markers, the smallest first; by what their names begin with."""
    found: dict[str, list[str]] = {}
    for name in DICTIONARIES:
        start, _, number = name.rpartition("_")
        found.setdefault(start if number.isdigit() else name, []).append(name)
    return {family: sorted(names, key=lambda name: len(markers_of(name).bytesList)) for family, names in found.items()}


def smallest(family: list[str], needed: int) -> str | None:
    """The first of some dictionaries, the smallest first, that has so many markers; None if none has."""
    return next((name for name in family if len(markers_of(name).bytesList) >= needed), None)


def _larger(dictionary: str, needed: int) -> str:
    key = dictionary.lower().removeprefix("dict_")
    fitting = smallest(next(names for names in families().values() if key in names), needed)
    return f'dictionary = "{fitting}" begins with the same' if fitting else "are columns and rows right?"


def find_charuco(image: Image, detector: cv2.aruco.CharucoDetector) -> tuple[Integers, Array]:
    """Numbers (N,) and pixels (N, 2) of the seen corners of a ChArUco board."""
    corners, numbers, _, _ = detector.detectBoard(plain_grey(image))
    if corners is None or numbers is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 2))
    return numbers.ravel().astype(np.int64), np.asarray(corners, dtype=np.float64).reshape(-1, 2)


Key = tuple[int, int]
"""View and frame."""

SeenCorners = dict[Key, tuple[Array, Array]]
"""(view, frame) -> corners in the board's frame (N, 3) metres, and their pixels (N, 2)."""

_MOST_FRAMES = 120
"""Frames in which two views are compared, spread over all: every one is compared with every other."""
_AT_ODDS = 0.35
"""Gap, of an angle in radians and a shift as a share of the distance, from which on views do not see one board: poses
of one board differ by 0.02 to 0.1, those of a mirror image by 0.7 and more."""
_FEWEST = 4
"""Frames that two views must share before it is judged whether they fit one another: of two, one may be wrong."""
_NO_BETTER = 2.5
"""A way round that fits the frames up to so many times worse than the best one may be the right one all the same."""
_ANOTHER = 0.2
"""Gap from which on two motions are no longer the same one with some noise."""


@dataclass(frozen=True)
class Link:
    """Position of one camera against another."""

    motion: Array
    """(4, 4) from the second camera to the first."""

    n_frames: int
    gap: float
    """Median difference of single frames from it: angle in radians, and shift as a share of the distance."""

    rival: float = np.inf
    """The same of the best motion that is another one."""


def turns_of(columns: int, rows: int, square_m: float) -> tuple[Array, ...]:
    """(4, 4) motions of a chessboard of so many inner corners after which it looks as before, the first one none.

    With an even sum of columns and rows it is the same after half a turn; a square one may be so after a quarter.
    """
    quarters = (0, 1, 2, 3) if columns == rows else (0, 2) if (columns + rows) % 2 == 0 else (0,)
    middle = square_m * np.array([columns - 1, rows - 1, 0.0]) / 2
    motions = []
    for n in quarters:
        motion = np.eye(4)
        motion[:2, :2] = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), n)
        motion[:3, 3] = middle - motion[:3, :3] @ middle
        motions.append(motion)
    return tuple(motions)


def links_of(poses: dict[Key, Array], n_views: int, turns: Sequence[Array]) -> dict[tuple[int, int], Link]:
    """The links of all pairs of views that see the board together.

    Args:
        poses: (4, 4) camera_from_board by view and frame.
        n_views: how many views there are.
        turns: those of the board after which it looks as before.
    """
    found = {}
    for view, other in itertools.combinations(range(n_views), 2):
        shared = [frame for v, frame in poses if v == view and (other, frame) in poses]
        if not shared:
            continue
        link = _link([(poses[view, frame], poses[other, frame]) for frame in shared], turns)
        back: Array = np.asarray(np.linalg.inv(link.motion), dtype=np.float64)
        found[view, other], found[other, view] = link, replace(link, motion=back)
    return found


def _link(pairs: Sequence[tuple[Array, Array]], turns: Sequence[Array]) -> Link:
    """The motion that most frames agree with, each with the turn of the board that suits it."""
    chosen = [pairs[k] for k in np.linspace(0, len(pairs) - 1, min(len(pairs), _MOST_FRAMES)).astype(int)]
    motions = np.stack([[one @ turn @ np.linalg.inv(other) for turn in turns] for one, other in chosen])
    flat = motions.reshape(-1, 4, 4)
    gaps = _gaps(flat, flat)
    to_frames = gaps.reshape(len(flat), len(chosen), len(turns)).min(axis=2)
    spreads = np.median(to_frames, axis=1)
    best = int(np.argmin(spreads))
    others = gaps[best] > _ANOTHER
    rival = float(spreads[others].min()) if others.any() else np.inf
    motion: Array = np.asarray(flat[best], dtype=np.float64)
    return Link(motion, len(pairs), float(spreads[best]), rival)


def _gaps(motions: Array, others: Array) -> Array:
    """(M, N) by how much motions differ: the angle, and the shift as a share of their median length."""
    traces = np.einsum("mij,nij->mn", motions[:, :3, :3], others[:, :3, :3])
    angles = np.arccos(np.clip((traces - 1) / 2, -1.0, 1.0))
    size = max(float(np.median(np.linalg.norm(motions[:, :3, 3], axis=1))), 1e-9)
    shifts: Array = np.linalg.norm(motions[:, None, :3, 3] - others[None, :, :3, 3], axis=2) / size
    gaps: Array = angles + shifts
    return gaps


def check_ends(links: dict[tuple[int, int], Link], names: Sequence[str]) -> None:
    """Whether the frames distinguish the ends of a board that looks the same from several.

    Raises:
        CalibrationError: two views have too few of them, or the board did not move.
    """
    for (view, other), link in links.items():
        if link.rival < max(_NO_BETTER * link.gap, _ANOTHER / 2):
            raise CalibrationError(
                f'"{names[view]}" and "{names[other]}": the board looks the same when it is turned, and the '
                f"{link.n_frames} frames in which both see it do not tell which end is which: show it in more "
                "positions, tilted, or use a board with an odd number of columns and an even one of rows"
            )


def one_way_round(
    seen: SeenCorners, poses: dict[Key, Array], motions: Sequence[Array], turns: Sequence[Array]
) -> tuple[SeenCorners, dict[Key, Array]]:
    """Corners and poses with the board, in every frame, the same way round in all views.

    Args:
        seen: each view with its own way round.
        poses: (4, 4) camera_from_board.
        motions: (4, 4) camera_from_world of the views.
        turns: those of the board after which it looks as before.
    """
    turned, ways = dict(seen), dict(poses)
    for frame in sorted({frame for _, frame in seen}):
        keys = [key for key in seen if key[1] == frame]
        first = max(keys, key=lambda key: (len(seen[key][0]), key))
        for key in keys:
            expected = motions[key[0]] @ np.linalg.inv(motions[first[0]]) @ poses[first]
            options = np.stack([poses[key] @ turn for turn in turns])
            k = 0 if key == first else int(np.argmin(_gaps(expected[None], options)[0]))
            ways[key] = options[k]
            back = np.linalg.inv(turns[k])
            turned[key] = (seen[key][0] @ back[:3, :3].T + back[:3, 3], seen[key][1])
    return turned, ways


def odd_pairs(links: dict[tuple[int, int], Link]) -> list[tuple[int, int]]:
    """Pairs of views that do not see one and the same board."""
    return [(view, other) for (view, other), link in links.items() if view < other and _at_odds(link)]


def refuse(
    odd: Sequence[tuple[int, int]],
    names: Sequence[str],
    mirrored: Sequence[dict[Key, Array]],
    poses: dict[Key, Array],
    turns: Sequence[Array],
) -> NoReturn:
    """Says why views do not see one and the same board.

    Args:
        odd: pairs of them, as of `odd_pairs`.
        names: of the views.
        mirrored: (4, 4) camera_from_board as they would be if all views showed mirror images, in each possible way.
        poses: as they are.
        turns: as for `links_of`.

    Raises:
        CalibrationError: always; a view whose pictures are mirrored is named.
    """
    suspects = [view for view, other in _mirrored(odd, mirrored, poses, turns)]
    if suspects:
        most = max(map(suspects.count, suspects))
        named = [f'"{names[view]}"' for view in sorted(set(suspects)) if suspects.count(view) == most]
        raise CalibrationError(
            f"{' or '.join(named)}: the pictures of {'this view' if len(named) == 1 else 'one of these views'} are "
            "mirrored: what it sees of the board fits the other views as a mirror image only; switch that off in the "
            "camera or in what has written the file"
        )
    view, other = odd[0]
    raise CalibrationError(
        f'"{names[view]}" and "{names[other]}" do not see one and the same board: how they lie to one another differs '
        "from frame to frame: are they in step, did a camera move, and do the files belong to one recording?"
    )


def _at_odds(link: Link) -> bool:
    return link.n_frames >= _FEWEST and link.gap > _AT_ODDS


def _mirrored(
    odd: Sequence[tuple[int, int]],
    mirrored: Sequence[dict[Key, Array]],
    poses: dict[Key, Array],
    turns: Sequence[Array],
) -> Iterator[tuple[int, int]]:
    """Pairs whose first view fits the second one if its pictures are mirror images."""
    for pair in odd:
        for view, other in (pair, pair[::-1]):
            shared = [frame for v, frame in poses if v == view and (other, frame) in poses]
            for way in mirrored:
                link = _link([(way[view, frame], poses[other, frame]) for frame in shared], turns)
                if not _at_odds(link):
                    yield view, other
                    break
