"""The calibrations that lie near a recording, and which file is which camera's."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import read_rig
from tracker.foundation.errors import SequenceError, TrackerError
from tracker.images.footage import Footage, header, listed, own_name, pattern_of

_ENDINGS = {".toml", ".json", ".txt", ".xml", ".yml", ".yaml", ".pickle", ".xcp"}
_WORDS = "calib", "rig", "camera", "intri", "extri"

_FEWEST = 2
"""Views that are called after cameras; one alone may be so by chance, for cameras are called `1`."""


@dataclass(frozen=True)
class FoundRig:
    """A calibration, and the files of its views."""

    path: Path
    rig: Rig
    told: tuple[str, ...]
    """What whoever uses its file must know."""

    pattern: Path
    """Of the files; that of a table is of no use."""

    views: dict[str, Path]
    """View -> file, or pattern of images."""

    mapped: bool = False
    """Whether files are not called after the cameras, so that a table says which is which."""

    guessed: bool = False
    """Whether that table is guessed by the order of names."""

    def wrong_sizes(self, footage: Sequence[Footage]) -> Iterator[str]:
        """Views whose images are not as large as they were calibrated."""
        for one in footage:
            if one.size != (size := self.rig.cameras[self.rig.index(one.view)].size):
                told = f"{one.path.name}: {one.size[0]}x{one.size[1]} px, but calibrated at {size[0]}x{size[1]}"
                turned = f"; for images that are turned: `bodytrack rig convert {self.path} rig.toml --upright`"
                yield told + (turned if one.size == size[::-1] else "")


def given_rig(path: Path, there: list[Path], folder: Path) -> FoundRig:
    """The calibration that was asked for.

    Args:
        path: of its file.
        there: the videos, or patterns of images.
        folder: they lie in.

    Raises:
        CalibrationError: it cannot be used.
    """
    opened = read_rig(path)
    return _with_views(FoundRig(path, opened.rig, opened.told(), folder, {}), there, folder)


def found_rigs(folder: Path, there: list[Path]) -> tuple[list[FoundRig], list[str]]:
    """The calibrations near a recording that its files fit: first the one whose cameras most are called after.

    Of those, the one whose image sizes fit most. Where none is, those with as many cameras as there are files,
    whichever these are called.

    Args:
        folder: of the recording.
        there: the videos, or patterns of images.

    Returns:
        The calibrations, and why files that are called so are none, if nothing else was found.
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
    found = sorted(named or found, key=lambda one: (-len(one.views), -_n_fitting(one)))
    most = len(found[0].views) if found else 0
    return [one for one in found if len(one.views) == most], [] if found else faults


def _n_fitting(found: FoundRig) -> int:
    """How many views have images as large as they were calibrated."""
    sizes = {camera.name: camera.size for camera in found.rig.cameras}
    n_fitting = 0
    for view, source in found.views.items():
        try:
            n_fitting += header(source, view).size == sizes[view]
        except SequenceError:  # what cannot be read is told where it is used
            continue
    return n_fitting


def _near(folder: Path) -> Iterator[Path]:
    """Files and folders that may be calibrations: in the folder, in the one it lies in, and in those called so."""
    for place in (folder, folder.resolve().parent):
        inner = sorted(path for path in listed(place) if path.is_dir() and _says_so(path.name))
        for one in (place, *inner):
            yield from sorted(path for path in listed(one) if path.suffix.lower() in _ENDINGS and path.is_file())
        yield from (place, *inner)


def _says_so(name: str) -> bool:
    return any(word in name.lower() for word in _WORDS)


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
    """Camera -> file, where their names are the same but for capitals, or their last numbers are; else nothing."""
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
    """By which names with numbers are in their order: cam_2 before cam_10."""
    return [(int(step), "") if step.isdigit() else (-1, step) for step in re.split(r"(\d+)", name.casefold())]


def _file_order(path: Path) -> list[tuple[int, str]]:
    return _order(path.as_posix())
