"""Which board the pictures of some views show, of which nothing is told."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.cameras.calibration._board_looks import (
    FEWEST_CORNERS,
    Sighting,
    charuco_of_most,
    shown_share,
    sighting,
    told_of,
    whole_size,
)
from tracker.cameras.calibration._boards import Pattern, find_board, plain_grey
from tracker.foundation.arrays import Image
from tracker.foundation.errors import CalibrationError
from tracker.foundation.progress import Progress, silent

_ANY = Pattern(9, 6)
"""Any board is looked for; of equals, one of about this size is preferred."""

_SHARE_STEP = 0.01
"""Pictures tell the share of a square that a marker has to about so much."""


Pictures = list[tuple[str, Image]]
"""Names of views, and grey pictures of them."""


@dataclass(frozen=True)
class FoundBoard:
    """A board, and who sees it."""

    pattern: Pattern
    """Its marker's side is told by the pictures, to some per cent."""

    n_pictures: dict[str, int]
    """View -> pictures that were looked at."""

    n_seen: dict[str, int]
    """View -> those that show it."""

    n_mirrored: dict[str, int]
    """View -> those that show its mirror image: of the back, or of a camera that mirrors."""

    @property
    def both_sides(self) -> bool:
        """Whether a view sees it the right way round, and some view mirrored."""
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
    """The ChArUco board of the same kind of markers of which all pictures together show most corners."""
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
    """Whether a picture shows a ChArUco board, and whether only mirrored."""
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
"""Inner corners in a row, of which a board that is calibrated with has at least."""
