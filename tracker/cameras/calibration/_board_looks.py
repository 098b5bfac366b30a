"""Finds the board in pictures that do not show the configured one."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tracker.cameras.calibration._boards import (
    Pattern,
    charuco_detector,
    families,
    find_board,
    markers_of,
    n_markers,
    plain_grey,
    smallest,
)
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.foundation.errors import CalibrationError
from tracker.foundation.progress import Progress, silent

FEWEST_CORNERS = 6
"""Three times what a pose needs, so that a wrong corner shows."""

_FEWEST_MARKERS = 3
"""Fewer are seen by chance, in a carpet; three in their places are not."""
_WIDTHS = range(3, 21)
"""Squares in a row that are tried."""
_USUAL_MARKER = 0.75
"""Default side of a marker in squares: as most generators print them."""
_NEAR = 2
"""Differences of columns and rows of a chessboard if squares were counted for corners, all or half of them."""
_LARGE_PX = 20.0
"""A marker's side from which on its share of a square is measured: to some per cent."""


@dataclass(frozen=True)
class Sighting:
    """A board that a picture shows, and that another pattern sees."""

    pattern: Pattern
    n_corners: int
    mirrored: bool = False

    def is_meant(self, wanted: Pattern) -> bool:
        """Whether it can only be the configured board: another chessboard may be the room's floor, or its tiles."""
        alike = (self.pattern.marker is None) == (wanted.marker is None)
        return self.pattern.marker is not None or (alike and _apart(_as_wanted(self.pattern, wanted), wanted) <= _NEAR)

    def told(self, wanted: Pattern) -> str:
        """The lines of a configuration that differ from those of the pattern wanted, and what they see."""
        if self.pattern.marker is None and wanted.marker is not None:
            inverted = ", inverted = true" if self.pattern.inverted else ""
            size = f"columns = {self.pattern.columns}, rows = {self.pattern.rows}"
            return f"a plain chessboard is seen: {size}{inverted}, without marker_m"
        lines = _lines(self.pattern, wanted)
        if wanted.marker is None and self.pattern.marker is not None:
            lines.append("marker_m = the side of a marker, metres")
        mirrored = (
            "its mirror image is seen: switch off what mirrors this camera's pictures (or, if it sees the back of a "
            "board printed on both sides, both_sides = true)"
        )
        seen = f"{self.n_corners} of its corners are seen in a picture with {', '.join(lines)}" if lines else ""
        where = "" if len(lines) < 2 else ", each on a line of its own"
        return "; ".join(filter(None, [f"{seen}{where}" if seen else "", mirrored if self.mirrored else ""]))


def _lines(found: Pattern, wanted: Pattern) -> list[str]:
    lines = []
    for key in ("columns", "rows", "dictionary", "legacy", "inverted"):
        value = getattr(found, key)
        if value != getattr(wanted, key):
            lines.append(f"{key} = {str(value).lower() if isinstance(value, bool) else _quoted(value)}")
    return lines


def _quoted(value: int | str) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)


def told_of(pictures: Sequence[Image], wanted: Pattern) -> str:
    """Message about other boards in pictures; empty if they show none."""
    found = sighting(pictures, wanted)
    if found is not None:
        return found.told(wanted)
    markers = [seen for picture in pictures for seen in _lonely_markers(plain_grey(picture))]
    if not markers:
        return ""
    dictionary, numbers = max(markers, key=lambda seen: len(seen[1]))
    return (
        f"{len(numbers)} markers of {dictionary} are seen in a picture, {numbers.min()} to {numbers.max()}, and "
        "no corners between them, whatever columns and rows are: a ChArUco board is needed, its markers numbered from "
        "0, flat and large in the pictures"
    )


def sighting(pictures: Sequence[Image], wanted: Pattern) -> Sighting | None:
    """Another pattern that sees a board in one of some pictures: inverted, legacy, other numbers, another dictionary.

    Args:
        pictures: in which the wanted one sees none.
        wanted: the pattern of the configuration; what is nearer to it is preferred.
    """
    for picture in map(plain_grey, pictures):
        for tried in (_charucos, chessboards):  # of a ChArUco board, a plain one is seen as well
            found = list(tried(picture, wanted))
            if found:
                return max(found, key=lambda one: (one.n_corners, -_apart(one.pattern, wanted)))
    return None


def chessboards(picture: Image, wanted: Pattern) -> Iterator[Sighting]:
    """The largest chessboard of about the configured size, perhaps given in squares; smaller ones are parts of it."""
    columns, rows = wanted.size
    near = [(columns + a, rows + b) for a, b in itertools.product((1, 0, -1), repeat=2)]
    for inverted in (wanted.inverted, not wanted.inverted):
        sizes = sorted(
            {*near, *whole_size(255 - picture if inverted else picture)}, key=lambda size: -size[0] * size[1]
        )
        for size in sizes:
            pattern = Pattern(*size, inverted=inverted)
            if min(size) >= 3 and len(find_board(picture, pattern)[0]):
                yield Sighting(_as_wanted(pattern, wanted), size[0] * size[1])
                return


def _as_wanted(found: Pattern, wanted: Pattern) -> Pattern:
    """The pattern with columns and rows exchanged where that is nearer: a chessboard has no first side."""
    turned = replace(found, columns=found.rows, rows=found.columns)
    return min((found, turned), key=lambda one: _apart(one, wanted))


def _apart(one: Pattern, other: Pattern) -> int:
    return abs(one.columns - other.columns) + abs(one.rows - other.rows)


def whole_size(picture: Image) -> list[tuple[int, int]]:
    """Columns and rows of a chessboard of any size, as OpenCV's second detector counts them."""
    found, _, plan = cv2.findChessboardCornersSBWithMeta(picture, (3, 3), cv2.CALIB_CB_LARGER)
    return [(plan.shape[1], plan.shape[0]), plan.shape] if found else []


def _charucos(picture: Image, wanted: Pattern) -> Iterator[Sighting]:
    """ChArUco boards that are seen in the picture, as it is or inverted, or else in its mirror image."""
    for mirrored, inverted in itertools.product((False, True), (wanted.inverted, not wanted.inverted)):
        shown = np.ascontiguousarray(picture[:, ::-1]) if mirrored else picture
        found = list(_with_any_markers(255 - shown if inverted else shown, wanted))
        if found:
            yield from (Sighting(replace(one, inverted=inverted), n, mirrored) for one, n in found)
            return


def _with_any_markers(shown: Image, wanted: Pattern) -> Iterator[tuple[Pattern, int]]:
    """Patterns that see corners, and how many, with markers of any dictionary and in rows of any length."""
    for names in families().values():
        corners, numbers = markers_in(shown, names[-1])
        if len(numbers) < _FEWEST_MARKERS:
            continue
        for pattern in _layouts(int(numbers[_likely(numbers)].max()), names, wanted):
            found = charuco_detector(pattern).detectBoard(shown, markerCorners=corners, markerIds=numbers)[1]
            if found is not None and len(found) >= FEWEST_CORNERS:
                yield _named(pattern, wanted), len(found)


def _likely(numbers: Integers) -> Mask:
    """Markers of a board: numbers far above the others belong to other things that look like markers."""
    likely: Mask = numbers <= 2 * np.median(numbers) + 10
    return likely


def charuco_of_most(shown: Sequence[Image], dictionary: str) -> Pattern | None:
    """The ChArUco board that shows most corners in grey pictures together, for a kind of markers; None for none.

    A single picture may lack the last markers, which show the number of rows.
    """
    names = next(names for names in families().values() if dictionary in names)
    seen = [(one, *markers_in(one, names[-1])) for one in shown]
    seen = sorted((one for one in seen if len(one[2]) >= _FEWEST_MARKERS), key=lambda one: -len(one[2]))[
        :_MOST_PICTURES
    ]
    counts = Counter(number for _, _, numbers in seen for number in numbers[_likely(numbers)].tolist())
    least = min(_TWICE, len(seen))  # one that is seen once may be none
    found: Counter[Pattern] = Counter()
    for pattern in _layouts(max((k for k, n in counts.items() if n >= least), default=0), names, Pattern(0, 0)):
        for one, corners, numbers in seen:
            there = charuco_detector(pattern).detectBoard(one, markerCorners=corners, markerIds=numbers)[1]
            found[pattern] += 0 if there is None else len(there)
    best, n_corners = max(found.items(), key=lambda one: one[1], default=(None, 0))
    return None if best is None or n_corners < FEWEST_CORNERS else _named(best, replace(best, dictionary=names[0]))


_MOST_PICTURES, _TWICE = 12, 2
"""Pictures that are looked at for how large a board is, and in how many of them a marker is seen at least."""


def markers_in(shown: Image, dictionary: str) -> tuple[Sequence[Array], Integers]:
    """Corners (1, 4, 2) px and numbers of the markers of a dictionary that a grey picture shows."""
    corners, numbers, _ = cv2.aruco.ArucoDetector(markers_of(dictionary)).detectMarkers(shown)
    return corners, np.zeros(0, dtype=np.int32) if numbers is None else numbers


def _lonely_markers(grey: Image) -> Iterator[tuple[str, Integers]]:
    """Dictionaries and numbers of markers that a picture shows, of small dictionaries, which are not seen by chance."""
    for shown, names in itertools.product((grey, 255 - grey), families().values()):
        numbers = markers_in(shown, names[0])[1]
        if len(numbers) > _FEWEST_MARKERS:
            yield names[0], numbers


def _layouts(last: int, names: list[str], wanted: Pattern) -> Iterator[Pattern]:
    """Patterns that have a marker number `last`, of every width; the wanted number of rows where it has it."""
    marker = wanted.marker or _USUAL_MARKER
    for columns, legacy in itertools.product(_WIDTHS, (False, True)):
        sides = wanted.size if columns == wanted.rows else wanted.size[::-1]
        liked = [rows for rows in sides if columns * rows // 2 > last and not (legacy and rows % 2)]
        fewest = max(3, -(-2 * (last + 1) // columns))
        rows = liked[0] if liked else fewest + (fewest % 2 if legacy else 0)
        pattern = Pattern(columns, rows, marker, names[-1], legacy)
        if n_markers(pattern) <= len(markers_of(names[-1]).bytesList):
            yield pattern


def _named(found: Pattern, wanted: Pattern) -> Pattern:
    """The pattern with the wanted dictionary, or the smallest one, of those that share their first markers."""
    family = next(names for names in families().values() if found.dictionary in names)
    least = smallest(family, n_markers(found)) or found.dictionary
    own = wanted.dictionary.lower().removeprefix("dict_")
    kept = own in family and family.index(own) >= family.index(least)
    return replace(found, dictionary=wanted.dictionary if kept else least)


def shown_share(picture: Image, pattern: Pattern) -> float | None:
    """The side of a board's markers in squares, as a picture shows it; None where they are too small in it."""
    shown = plain_grey(255 - picture if pattern.inverted else picture)
    corners, numbers, markers, _ = charuco_detector(pattern).detectBoard(shown)
    if numbers is None or len(numbers) < FEWEST_CORNERS:
        return None
    plan = pattern.plan[numbers.ravel(), :2]
    matrix = cv2.findHomography(np.asarray(corners, dtype=np.float64).reshape(-1, 2), plan)[0]
    if matrix is None:
        return None
    outlines = np.asarray(markers, dtype=np.float64).reshape(-1, 4, 2)
    sides_px = np.linalg.norm(outlines - np.roll(outlines, 1, axis=1), axis=2).min(axis=1)
    squares = cv2.perspectiveTransform(outlines.reshape(1, -1, 2), matrix)[0].reshape(-1, 4, 2)
    sides = np.linalg.norm(squares - np.roll(squares, 1, axis=1), axis=2).mean(axis=1)[sides_px > _LARGE_PX]
    return float(np.median(sides)) if len(sides) >= _FEWEST_MARKERS else None


_ANY = Pattern(9, 6)
"""It finds any board; among equals, one of about this size is preferred."""

_SHARE_STEP = 0.01
"""Accuracy of a marker's share of a square in pictures."""


Pictures = list[tuple[str, Image]]
"""Names of views, and grey pictures of them."""


@dataclass(frozen=True)
class FoundBoard:
    """A board, and who sees it."""

    pattern: Pattern
    """The pictures give its marker's side to some per cent."""

    n_pictures: dict[str, int]
    """View -> pictures that were looked at."""

    n_seen: dict[str, int]
    """View -> those that show it."""

    n_mirrored: dict[str, int]
    """View -> those that show its mirror image: of the back, or of a camera that mirrors."""

    @property
    def both_sides(self) -> bool:
        """Whether a view sees it the right way round, and whether one sees it mirrored."""
        return any(self.n_mirrored.values()) and any(self.n_seen[name] > self.n_mirrored[name] for name in self.n_seen)


def found_board(views: Mapping[str, Sequence[Image]], progress: Progress = silent) -> FoundBoard:
    """The board that most pictures show.

    Args:
        views: pictures of each view, spread over its recording.
        progress: told how far it is.

    Raises:
        CalibrationError: no picture shows a board.
    """
    pictures = [(name, plain_grey(picture)) for name, picture in _in_turn(views)]
    first = _first_seen([picture for _, picture in pictures], progress)
    if first.pattern.marker is not None:
        pattern = _measured(_most_seen(first, pictures), pictures)
        seen = [_sides_seen(picture, pattern) for _, picture in pictures]
    else:
        pattern = _usual_size(first.pattern, pictures)
        seen = [(len(find_board(picture, pattern)[0]) > 0, False) for _, picture in pictures]
    names = [name for name, _ in pictures]
    counted = [Counter(name for name, one in zip(names, seen, strict=True) if one[k]) for k in (0, 1)]
    n_seen, n_mirrored = ({name: counts[name] for name in views} for counts in counted)
    return FoundBoard(pattern, {name: len(own) for name, own in views.items()}, n_seen, n_mirrored)


def _in_turn(views: Mapping[str, Sequence[Image]]) -> Iterator[tuple[str, Image]]:
    """A picture of each view, the next one of each, and so on."""
    for row in itertools.zip_longest(*([(name, one) for one in own] for name, own in views.items())):
        yield from (one for one in row if one is not None)


def _first_seen(pictures: list[Image], progress: Progress) -> Sighting:
    for k, picture in enumerate(pictures):
        progress("looking for a board", k + 1, len(pictures))
        if (found := sighting([picture], _ANY)) is not None:
            return found
    told = told_of(pictures, _ANY) if pictures else ""
    raise CalibrationError(
        f"no board is seen in {len(pictures)} pictures{': ' + told if told else ''}; expected a chessboard or a "
        "ChArUco board, whole, flat and large in the pictures of every camera"
    )


def _most_seen(first: Sighting, pictures: Pictures) -> Pattern:
    """The ChArUco board of the same kind of markers that shows most corners in all pictures together."""
    pattern = first.pattern
    shown = [255 - picture if pattern.inverted else picture for _, picture in pictures]
    if first.mirrored:
        shown = [np.ascontiguousarray(picture[:, ::-1]) for picture in shown]
    found = charuco_of_most(shown, pattern.dictionary)
    return pattern if found is None else replace(found, inverted=pattern.inverted)


def _measured(pattern: Pattern, pictures: Pictures) -> Pattern:
    """The pattern with its markers as large as the pictures show them."""
    shares = (shown_share(picture, pattern) for _, picture in pictures)
    known = [share for share in shares if share is not None]
    if not known:
        return pattern
    return replace(pattern, marker=round(float(np.median(known)) / _SHARE_STEP) * _SHARE_STEP)


def _sides_seen(picture: Image, pattern: Pattern) -> tuple[bool, bool]:
    """Whether a picture shows a ChArUco board, and whether only a mirrored one."""
    if len(find_board(picture, pattern)[0]) >= FEWEST_CORNERS:
        return True, False
    mirrored = len(find_board(np.ascontiguousarray(picture[:, ::-1]), pattern)[0]) >= FEWEST_CORNERS
    return mirrored, mirrored


def _usual_size(first: Pattern, pictures: Pictures) -> Pattern:
    """The chessboard that most pictures show, of equals the larger one: of a part of a board others are seen."""
    counts: Counter[tuple[int, int]] = Counter()
    for _, picture in pictures:
        found = whole_size(255 - picture if first.inverted else picture)
        counts.update({(max(size), min(size)) for size in found if min(size) >= _FEWEST_ROWS})
    columns, rows = max(counts, key=lambda size: (counts[size], size[0] * size[1]), default=first.size)
    return replace(first, columns=columns, rows=rows)


_FEWEST_ROWS = 3
"""Least number of inner corners in a row of a board for calibration."""
