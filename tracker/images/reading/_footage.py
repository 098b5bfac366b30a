"""A recording on disk, one stream of images a view, and the selection of views and frames."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, TypeVar

from tracker.cameras.frame import Packed
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.arrays import Image
from tracker.foundation.errors import ConfigError, SequenceError, nearest
from tracker.images.reading._timeline import ViewOffset

OnMissing = Literal["error", "skip"]

_FEWEST_TELLING = 10
"""Least number of frames of the shortest view whose length shows a rate."""

_OF_A_FACTOR = 0.03
"""Tolerance of the whole ratio of two lengths at two rates: cameras do not stop in one frame."""

log = logging.getLogger("tracker")


@dataclass(frozen=True)
class Selection:
    """The delivered frames of a recording."""

    start: int
    stop: int
    stride: int

    @property
    def indices(self) -> range:
        """Frame numbers in order."""
        return range(self.start, self.stop, self.stride)


def chosen_rig(path: Path | None, views: tuple[str, ...]) -> Rig:
    """The rig of a file, restricted to the named views in their order.

    Raises:
        ConfigError: the configuration names no file.
    """
    if path is None:
        raise ConfigError('[reading]: the key "rig" is missing, expected the calibration, e.g. rig = "Calib.toml"')
    return load_rig(path, views)


def chosen_names(views: tuple[str, ...]) -> tuple[str, ...]:
    """Names of cameras without a rig.

    Raises:
        ConfigError: there are none, or one is given twice.
    """
    if not views:
        raise ConfigError(
            "[reading] views: expected the names of the cameras, which stand for {view} in the path, e.g. "
            'views = ["left", "right"]'
        )
    if len(set(views)) < len(views):
        raise ConfigError(f"[reading] views = {list(views)}: expected different names, one a camera")
    return views


def view_paths(pattern: str | dict[str, str], names: tuple[str, ...]) -> tuple[Path, ...]:
    """The path of every view, by a pattern with `{view}` or by a table.

    Raises:
        SequenceError: the pattern gives all views the same path, or the table two of them, or a view none.
    """
    if isinstance(pattern, dict):
        return _told_paths(pattern, names)
    if "{view}" not in pattern and len(names) > 1:
        raise SequenceError(f'"{pattern}": no {{view}} in it, so all {len(names)} views would show the same')
    return tuple(Path(pattern.replace("{view}", name)) for name in names)


def _told_paths(table: dict[str, str], names: tuple[str, ...]) -> tuple[Path, ...]:
    for name in names:
        if name not in table:
            raise SequenceError(f'[reading] path: no file of view "{name}"; {nearest(name, table)}')
    paths = tuple(Path(table[name].replace("{view}", name)) for name in names)
    for k, path in enumerate(paths):
        if path in paths[:k]:
            raise SequenceError(f'[reading] path: "{names[paths.index(path)]}" and "{names[k]}" are both {path}')
    return paths


def common_length(
    names: tuple[str, ...],
    lengths: tuple[int, ...],
    offsets: tuple[ViewOffset, ...],
    on_missing: OnMissing,
    stop: int | None,
) -> int:
    """Number of frames of all views; the longest view's if views may be missing or end after `stop`.

    Raises:
        SequenceError: the views have different numbers of frames, some too few, and none may be missing.
    """
    usable = [offset.length(length) for length, offset in zip(lengths, offsets, strict=True)]
    factor = _told_factor(names, usable)
    enough = stop is not None and stop <= min(usable)
    if on_missing == "error" and len(set(usable)) > 1 and not enough:
        table = ", ".join(f"{name} {length}" for name, length in zip(names, usable, strict=True))
        raise SequenceError(
            f"the views have different numbers of frames ({table}): give offsets or stop, or set "
            'on_missing = "skip" to leave a view out of the frames it lacks' + (f"; but {factor}" if factor else "")
        )
    if factor:
        log.warning("%s", factor)
    return max(usable)


def _told_factor(names: tuple[str, ...], lengths: list[int]) -> str:
    """Message about a view whose length is a whole share of the others'; empty without one."""
    shortest, longest = min(lengths), max(lengths)
    times = round(longest / shortest) if shortest >= _FEWEST_TELLING else 1
    if times < 2 or abs(longest / (times * shortest) - 1) > _OF_A_FACTOR:
        return ""
    return (
        f"{names[lengths.index(shortest)]} has 1 frame for {times} of {names[lengths.index(longest)]}: if it filmed "
        f"as long, at a lower rate, frames of one number are not of one moment; write 1 frame of every {times} "
        "of the others to new files then"
    )


def selected(start: int, stop: int | None, stride: int, length: int) -> Selection:
    """The range of frames, checked against the recording's length.

    Raises:
        SequenceError: the range is empty or ends beyond the recording.
    """
    end = length if stop is None else stop
    if not 0 <= start < end <= length:
        raise SequenceError(
            f"frames {start} to {end} asked for, the recording has {length}: mend start and stop, or --frames"
        )
    return Selection(start, end, stride)


def numbered_files(name: str, pattern: Path) -> dict[int, Path]:
    """The files of a view by their number.

    Args:
        name: of the view, for messages.
        pattern: path with `{frame}` in the file name.

    Raises:
        SequenceError: there are none, or two of one number.
    """
    folder, before_after = pattern.parent, pattern.name.split("{frame}")
    if len(before_after) != 2:
        raise SequenceError(f'"{pattern}": no {{frame}} in the file name, expected e.g. images/{{view}}/{{frame}}.png')
    if not folder.is_dir():
        raise SequenceError(f'view "{name}": no folder {folder}')
    number = re.compile(r"(\d+)".join(re.escape(piece) for piece in before_after))
    matches = ((number.fullmatch(file.name), file) for file in sorted(folder.iterdir()))
    files: dict[int, Path] = {}
    for n, file in ((int(match[1]), file) for match, file in matches if match):
        if n in files:
            raise SequenceError(
                f'view "{name}": {files[n].name} and {file.name} in {folder} are both number {n}: remove one'
            )
        files[n] = file
    if not files:
        raise SequenceError(f'view "{name}": no image {pattern.name} in {folder}')
    return files


LEAST_FPS, MOST_FPS = 1e-3, 1e5
"""A picture every quarter of an hour, and the fastest cameras."""

_View = TypeVar("_View")


class ImageStream(Protocol):
    """One view's images, read in ascending order."""

    def read(self, index: int) -> Image | None:
        """Image number `index` of the view's own count, None past its end.

        Raises:
            SequenceError: it cannot be read.
        """
        ...

    def held(self, index: int) -> Image | Packed | None:
        """The same, packed if that takes less memory; see `read`."""
        ...


@dataclass(frozen=True)
class Footage:
    """Files of a recording, for a reading component."""

    names: tuple[str, ...]
    """The views in order."""

    fps: float
    lengths: tuple[int, ...]
    """Number of images of each view, 0 where it is absent."""

    open_views: Callable[[], tuple[ImageStream, ...]]
    plate_of_clip: Callable[[Path], Image]
    first: int = 0
    """Number in the file names of the images, or of masks, that belongs to a view's image 0."""

    positions: tuple[tuple[int, ...] | None, ...] = ()
    """Of each view, for each image that can be asked for, its position in the file, -1 where it was dropped; None, or
    no views at all: it is what is asked for."""


@dataclass(frozen=True)
class AbsentView:
    """A view whose files are missing or cannot be opened."""

    def read(self, index: int) -> Image | None:
        """None for every frame."""
        return None

    def held(self, index: int) -> Image | Packed | None:
        """None for every frame."""
        return None


def opened_views(names: tuple[str, ...], opened: Callable[[str], _View], on_missing: OnMissing) -> list[_View | None]:
    """What `opened` makes of each view; None for views that cannot be opened, where that is allowed, with a warning.

    Raises:
        SequenceError: from `opened`, where nothing may be missing or no view can be opened.
    """
    views: list[_View | None] = []
    faults: dict[str, SequenceError] = {}
    for name in names:
        try:
            views.append(opened(name))
        except SequenceError as fault:
            views.append(None)
            faults[name] = fault
    if faults and (on_missing == "error" or len(faults) == len(names)):
        raise next(iter(faults.values()))
    for name, why in faults.items():
        log.warning('view "%s" is left out of all frames: %s', name, why)
    return views
