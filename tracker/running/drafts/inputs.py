"""Files near a recording: calibrations and their cameras' files, clean plates, 2-D keypoints."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import read_rig
from tracker.foundation.errors import SequenceError, TrackerError
from tracker.images.footage import (
    KEYPOINT_WORDS,
    PICTURES,
    PLATE_WORDS,
    VIDEOS,
    Footage,
    header,
    listed,
    own_name,
    pattern_of,
    patterns,
    says,
    with_view,
)
from tracker.images.reading.images import intact_image

_KEYPOINT_WORDS = (*KEYPOINT_WORDS, "pose")
"""Pose2Sim's folder is called `pose`."""

_MOST_FILES = 400
"""Number of entries of a folder to look at: a folder of keypoints or plates has one a view, or some."""


def found_keypoints(folder: Path, footage: Sequence[Footage]) -> list[Path]:
    """Patterns with `{view}` of folders that each view has, near the recording; the best names first.

    Args:
        folder: of the recording.
        footage: its views.
    """
    views = [one.view for one in footage]
    places = _places(folder) if views else ()
    found = dict.fromkeys(pattern for place in places for pattern in _patterns(place, views))
    return [pattern for pattern in found if all(map(_has_files, _of_views(pattern, views)))]


def _places(folder: Path) -> Iterator[Path]:
    """Folders with a name for keypoints, beside the videos and above them."""
    for place in (folder, folder.resolve().parent):
        yield from (path for path in _some(place) if path.is_dir() and says(path.name, _KEYPOINT_WORDS))


def _patterns(place: Path, views: Sequence[str]) -> Iterator[Path]:
    for inner in _some(place):
        if inner.is_dir():
            yield from (place / text for text in with_view(inner.name, views[0]))


def _of_views(pattern: Path, views: Sequence[str]) -> list[Path]:
    return [pattern.with_name(pattern.name.replace("{view}", view)) for view in views]


def _has_files(folder: Path) -> bool:
    return folder.is_dir() and any(path.suffix == ".json" for path in _some(folder))


def _some(folder: Path) -> list[Path]:
    try:
        return sorted(listed(folder))[:_MOST_FILES]
    except SequenceError:
        return []


@dataclass(frozen=True)
class Plates:
    """Plates near a recording."""

    pattern: Path | None
    """Pattern with `{view}`."""

    lacking: tuple[str, ...]
    """Views without a plate."""

    others: tuple[Path, ...]
    """Patterns of other plates, for as many views."""

    wrong_sizes: tuple[str, ...]
    """Plates of another size than the images."""

    @property
    def whole(self) -> bool:
        """Whether each view has a plate."""
        return self.pattern is not None and not self.lacking

    def told(self) -> Iterator[str]:
        """Warnings: missing or unsuitable plates, or a choice."""
        if self.pattern is None:
            yield "no plates found: film the empty room for some seconds; else the recording makes them"
        elif self.lacking:
            yield (
                f"{self.pattern} has no plate of {', '.join(self.lacking)}: add the missing ones and set `background`, "
                "or leave these views out with `views`; else the recording makes plates"
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
    """Files that may be plates by their name or folder, each with the folder where its pattern starts."""
    for place in (folder, folder.resolve().parent):
        for path in _some(place):
            if path.is_dir():
                within = any(word in path.name.lower() for word in PLATE_WORDS)
                inner = [other for one in _some(path) for other in ([one, *_some(one)] if one.is_dir() else [one])]
                yield from ((path, one) for one in inner if within and _is_picture(one))
                yield from ((place, one) for one in inner if not within and _is_plate(one))
            elif _is_plate(path):
                yield place, path


def _is_picture(path: Path) -> bool:
    return path.suffix.lower() in PICTURES | VIDEOS and path.is_file()


def _is_plate(path: Path) -> bool:
    return _is_picture(path) and says(path.stem, PLATE_WORDS)


def _size(path: Path) -> tuple[int, int] | None:
    """Width and height of a picture or a clip; None if it cannot be read, which is reported where it is used."""
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


_ENDINGS = {".toml", ".json", ".txt", ".xml", ".yml", ".yaml", ".pickle", ".xcp"}
_RIG_WORDS = "calib", "rig", "camera", "intri", "extri"

_FEWEST = 2
"""Views that are named after cameras; one alone may be so by chance, because cameras are called `1`."""


@dataclass(frozen=True)
class FoundRig:
    """A calibration, and the files of its views."""

    path: Path
    rig: Rig
    told: tuple[str, ...]
    """Warnings about its file."""

    pattern: Path
    """Pattern of the files; a table has none."""

    views: dict[str, Path]
    """View -> file, or pattern of images."""

    mapped: bool = False
    """Whether files are not named after the cameras, so that a table assigns them."""

    guessed: bool = False
    """Whether that table is a guess by the order of names."""

    def wrong_sizes(self, footage: Sequence[Footage]) -> Iterator[str]:
        """Views with images of another size than calibrated."""
        for one in footage:
            if one.size != (size := self.rig.cameras[self.rig.index(one.view)].size):
                told = f"{one.path.name}: {one.size[0]}x{one.size[1]} px, but calibrated at {size[0]}x{size[1]}"
                turned = f"; for images that are turned: `bodytrack rig convert {self.path} rig.toml --upright`"
                yield told + (turned if one.size == size[::-1] else "")


def given_rig(path: Path, there: list[Path], folder: Path) -> FoundRig:
    """The given calibration.

    Args:
        path: of its file.
        there: the videos, or patterns of images.
        folder: their folder.

    Raises:
        CalibrationError: it cannot be used.
    """
    opened = read_rig(path)
    return _with_views(FoundRig(path, opened.rig, opened.told(), folder, {}), there, folder)


def found_rigs(folder: Path, there: list[Path]) -> tuple[list[FoundRig], list[str]]:
    """The calibrations near a recording that fit its files, the best one first.

    The best one has most cameras of the files' names, and among equals most equal image sizes. If no name fits, it has
    as many cameras as there are files.

    Args:
        folder: of the recording.
        there: the videos, or patterns of images.

    Returns:
        The calibrations; and the faults of files with a calibration's name, if there are no others.
    """
    found: list[FoundRig] = []
    faults: list[str] = []
    for path in _near(folder):
        try:
            one = given_rig(path, there, folder)
        except (TrackerError, OSError, ValueError, KeyError) as error:
            if _says_so(path.stem) and path.is_file():  # else something else
                faults.append(str(error) if str(path) in str(error) else f"{path}: {error}")
            continue
        if one.views:
            found.append(one)
    named = [one for one in found if not one.mapped]
    found = sorted(named or found, key=lambda one: (-len(one.views), -_n_views_fitting(one)))
    most = len(found[0].views) if found else 0
    return [one for one in found if len(one.views) == most], [] if found else faults


def _n_views_fitting(found: FoundRig) -> int:
    """Number of views with images of the calibrated size."""
    sizes = {camera.name: camera.size for camera in found.rig.cameras}
    n_fitting = 0
    for view, source in found.views.items():
        try:
            n_fitting += header(source, view).size == sizes[view]
        except SequenceError:  # faults of a file are reported where it is used
            continue
    return n_fitting


def _near(folder: Path) -> Iterator[Path]:
    """Files and folders that may be calibrations: in the folder, in its parent, and in folders of that name."""
    for place in (folder, folder.resolve().parent):
        inner = sorted(path for path in listed(place) if path.is_dir() and _says_so(path.name))
        for one in (place, *inner):
            yield from sorted(path for path in listed(one) if path.suffix.lower() in _ENDINGS and path.is_file())
        yield from (place, *inner)


def _says_so(name: str) -> bool:
    return any(word in name.lower() for word in _RIG_WORDS)


def _with_views(found: FoundRig, there: list[Path], folder: Path) -> FoundRig:
    """The calibration with the files of its views."""
    rig = found.rig
    pattern, views = pattern_of(there, folder, rig)
    if len(views) >= min(_FEWEST, len(rig), len(there)):
        return FoundRig(found.path, rig, found.told, pattern, views)
    if len(there) != len(rig):
        return FoundRig(found.path, rig, found.told, pattern, {})
    by_key = _by_key({own_name(source, there): source for source in there}, rig.names)
    table = by_key or dict(zip(sorted(rig.names, key=_order), sorted(there, key=_file_order), strict=True))
    views = {name: table[name] for name in rig.names}
    return FoundRig(found.path, rig, found.told, pattern, views, mapped=True, guessed=not by_key)


def _by_key(files: dict[str, Path], names: tuple[str, ...]) -> dict[str, Path]:
    """Camera -> file, if their names are equal except for capitals, or their last numbers are; else empty."""
    for key in (str.casefold, _last_number):
        of_files = {key(name): path for name, path in files.items()}
        of_cameras = {key(name): name for name in names}
        if len(of_files) == len(files) == len(of_cameras) and of_files.keys() == of_cameras.keys():
            return {of_cameras[one]: path for one, path in of_files.items()}
    return {}


def _last_number(name: str) -> str:
    numbers = re.findall(r"\d+", name)
    return numbers[-1].lstrip("0") if numbers else name


def _order(name: str) -> list[tuple[int, str]]:
    """Key that sorts names with numbers: cam_2 before cam_10."""
    return [(int(step), "") if step.isdigit() else (-1, step) for step in re.split(r"(\d+)", name.casefold())]


def _file_order(path: Path) -> list[tuple[int, str]]:
    return _order(path.as_posix())
