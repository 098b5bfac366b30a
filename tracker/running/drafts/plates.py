"""The clean plates that lie near a recording: pictures or clips, in folders of their own or beside the videos."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tracker.foundation.errors import SequenceError
from tracker.images.footage import PICTURES, PLATE_WORDS, VIDEOS, Footage, header, listed, patterns, says
from tracker.images.reading.images import intact_image

_MOST_FILES = 400
"""Of a folder that are looked at: a folder of plates has one a view, or some."""


@dataclass(frozen=True)
class Plates:
    """What was found."""

    pattern: Path | None
    """With `{view}`."""

    lacking: tuple[str, ...]
    """Views that have none."""

    others: tuple[Path, ...]
    """Patterns of other ones that have as many views."""

    wrong_sizes: tuple[str, ...]
    """Plates that are not as large as the images."""

    @property
    def whole(self) -> bool:
        """Whether each view has one."""
        return self.pattern is not None and not self.lacking

    def told(self) -> Iterator[str]:
        """What is missing, does not fit, or could be chosen."""
        if self.pattern is None:
            yield "no plates found: film the empty room for some seconds; else they are made of the recording"
        elif self.lacking:
            yield (
                f"{self.pattern} has no plate of {', '.join(self.lacking)}: add what is missing and set `background`, "
                "or leave these views out with `views`; else plates are made of the recording"
            )
        yield from self.wrong_sizes
        if self.others:
            named = ", ".join(map(str, self.others))
            yield f"other plates there: {named}; `background` chooses: make sure which are right"


def found_plates(folder: Path, footage: Sequence[Footage]) -> Plates:
    """The plates of most views, near the recording.

    Args:
        folder: of the recording.
        footage: its views.
    """
    views = {one.view: one for one in footage}
    used = {one.path for one in footage}
    found: dict[tuple[Path, ...], Path] = {}
    for place, file in _candidates(folder):
        for view in views if file not in used else ():
            for pattern in patterns(file, place, view):
                files = tuple(path for path in _files(pattern, views).values() if path not in used)
                found.setdefault(files, pattern)
    ranked = sorted(found.items(), key=lambda one: (-len(one[0]), -_n_fitting(one[1], views)))
    if not ranked:
        return Plates(None, tuple(views), (), ())
    (files, pattern), *rest = ranked
    lacking = tuple(view for view in views if view not in _files(pattern, views))
    others = tuple(other for those, other in rest if len(those) == len(files) and not set(those) & set(files))
    return Plates(pattern, lacking, others, tuple(_wrong(pattern, views)))


def _files(pattern: Path, views: dict[str, Footage]) -> dict[str, Path]:
    paths = {view: Path(str(pattern).replace("{view}", view)) for view in views}
    return {view: path for view, path in paths.items() if path.is_file()}


def _candidates(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Files that may be plates, each with the folder that its pattern starts from: their names or folders say so."""
    for place in (folder, folder.resolve().parent):
        for path in _some(place):
            if path.is_dir():
                within = any(word in path.name.lower() for word in PLATE_WORDS)
                inner = [other for one in _some(path) for other in ([one, *_some(one)] if one.is_dir() else [one])]
                yield from ((path, one) for one in inner if within and _is_picture(one))
                yield from ((place, one) for one in inner if not within and _is_plate(one))
            elif _is_plate(path):
                yield place, path


def _some(folder: Path) -> list[Path]:
    try:
        return sorted(listed(folder))[:_MOST_FILES]
    except SequenceError:
        return []


def _is_picture(path: Path) -> bool:
    return path.suffix.lower() in PICTURES | VIDEOS and path.is_file()


def _is_plate(path: Path) -> bool:
    return _is_picture(path) and says(path.stem, PLATE_WORDS)


def _size(path: Path) -> tuple[int, int] | None:
    """Width and height of a picture or a clip; None where it cannot be read, which is told where it is used."""
    try:
        if path.suffix.lower() in VIDEOS:
            return header(path, "").size
        height, width = intact_image(path).shape[:2]
    except SequenceError:
        return None
    return width, height


def _n_fitting(pattern: Path, views: dict[str, Footage]) -> int:
    return sum(_size(path) == views[view].size for view, path in _files(pattern, views).items())


def _wrong(pattern: Path, views: dict[str, Footage]) -> Iterator[str]:
    for view, path in _files(pattern, views).items():
        size, wanted = _size(path), views[view].size
        if size is None:
            yield f"{path}: not a picture or a clip that can be read"
        elif size != wanted:
            yield f"{path}: {size[0]}x{size[1]} px, but the images of {view} have {wanted[0]}x{wanted[1]}"
