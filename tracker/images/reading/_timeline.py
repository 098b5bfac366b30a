"""Assigns the images of a view to frames: by time stamps, and by given offsets."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import pydantic
from pydantic_core import PydanticCustomError

from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import SequenceError, nearest

_MOST_OFF = 0.4
"""Of an interval: images farther from an even pace are not evenly paced. Containers round stamps to 1 ms, a tenth."""


@dataclass(frozen=True)
class Timeline:
    """The frames of a video at an even pace."""

    fps: float
    """0 where the file does not tell."""

    stamps: tuple[int | None, ...]
    """For each frame the time stamp of the image that shows it; None where the camera, or a copy, has dropped it."""

    timed: bool = True
    """Whether the file has time stamps; if not, they are the images' numbers."""

    remark: str = ""
    """What has been done to the times, for whoever uses the video."""

    images: tuple[tuple[int, float], ...] = ()
    """Time stamp and time, seconds, of every image of a video that is resampled; none of others."""

    skipped: tuple[int, ...] = ()
    """Time stamps of images that are left out, for others film at a lower rate."""

    film: int = 0
    """Which of the file's video streams it is."""

    clock: bool = True
    """Whether the file tells times at all; if not, `fps` is 0."""

    hint_fps: float = 0.0
    """Frames a second that the coded pictures themselves hint at, 0 for none: some cameras write another one."""

    told: tuple[str, ...] = ()
    """What the file tells of its pictures that nothing makes good."""

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.stamps)

    @property
    def positions(self) -> tuple[int, ...] | None:
        """For each frame the position of its image among those of the file, -1 where it is dropped; None: its number.

        So whoever has decoded the file counts, masks and keypoints are numbered.
        """
        numbers = self._numbers()
        found = tuple(-1 if stamp is None else numbers[stamp] for stamp in self.stamps)
        return None if found == tuple(range(len(found))) else found

    def _numbers(self) -> dict[int, int]:
        """Stamp of an image -> its position in the file."""
        told = (stamp for stamp in self.stamps if stamp is not None)
        return {
            stamp: k for k, stamp in enumerate(sorted({*told, *(stamp for stamp, _ in self.images), *self.skipped}))
        }

    def at_pace(self, interval_s: float) -> Timeline:
        """The same, resampled to an interval."""
        found = _resampled(self.images, interval_s)
        return replace(self, fps=found.fps, stamps=found.stamps, remark=found.remark)

    def thinned(self, every: int) -> Timeline:
        """The same with every so many frames, from the first one on."""
        if every == 1:
            return self
        left_out = {stamp for stamp in self.stamps if stamp is not None} - set(self.stamps[::every])
        return replace(
            self, fps=self.fps / every, stamps=self.stamps[::every], skipped=(*self.skipped, *sorted(left_out))
        )

    def numbered(self) -> Timeline:
        """The same for a decoder that gives no stamps: the first image's is 0, the next one's 1."""
        numbers = self._numbers()
        stamps = tuple(None if stamp is None else numbers[stamp] for stamp in self.stamps)
        images = tuple((numbers[stamp], time_s) for stamp, time_s in self.images)
        return replace(self, stamps=stamps, images=images, timed=False)


def at_one_pace(timelines: Sequence[Timeline | None]) -> tuple[Timeline | None, ...]:
    """The timelines of all views, None for an absent one; those that are resampled are so at the pace of the others.

    A pace of their own, the usual one of each, would let views of one recording drift apart.
    """
    told = sorted((one for one in timelines if one is not None and one.fps > 0), key=lambda one: bool(one.images))
    return tuple(one if one is None or not one.images else one.at_pace(1 / told[0].fps) for one in timelines)


def timeline_of(stamps: list[int | None], unit_s: float, told_fps: float) -> Timeline:
    """Frames at an even pace.

    Images that are evenly paced are frames, whatever the header says. Gaps of whole intervals are dropped frames. Other
    paces, as of phones in the dark, are resampled: each frame is shown by the image nearest in time.

    Args:
        stamps: time stamps of the images as they lie in the file, None where it has none.
        unit_s: of a stamp, seconds.
        told_fps: frames per second as the header tells; 0 if it does not.
    """
    known = [stamp for stamp in stamps if stamp is not None]
    if len(known) < len(stamps) or len(set(known)) < len(known) or len(known) < 2:
        remark = "its time stamps are missing or repeat: its images are taken at the pace that its header tells"
        return Timeline(told_fps, tuple(range(len(stamps))), timed=False, remark=remark if len(stamps) > 1 else "")
    ordered = sorted(known)
    times = unit_s * (np.array(ordered, dtype=np.float64) - ordered[0])
    usual_s = float(np.median(np.diff(times)))
    even_s = float(times[-1]) / (len(times) - 1)
    if _evenly(times, np.arange(len(times)), even_s):
        pace = told_fps if told_fps and abs(told_fps * even_s - 1) < _MOST_OFF / len(times) else 1 / even_s
        return Timeline(pace, tuple(ordered))
    places = np.concatenate([[0], np.cumsum(np.maximum(np.round(np.diff(times) / usual_s), 1))]).astype(np.int64)
    pace_s = float(times[-1]) / float(places[-1])
    if places[-1] < 2 * len(times) and _evenly(times, places, pace_s):
        dropped: list[int | None] = [None] * (int(places[-1]) + 1)
        for place, stamp in zip(places.tolist(), ordered, strict=True):
            dropped[place] = stamp
        return Timeline(1 / pace_s, tuple(dropped), remark=f"{dropped.count(None)} dropped frames")
    return _resampled(tuple(zip(ordered, times.tolist(), strict=True)), usual_s)


def _evenly(times: Array, places: Integers, interval_s: float) -> bool:
    return bool(np.abs(times - interval_s * places).max() < _MOST_OFF * interval_s)


def _resampled(images: tuple[tuple[int, float], ...], usual_s: float) -> Timeline:
    times = np.array([time_s for _, time_s in images])
    wanted = np.arange(0, float(times[-1]) + usual_s / 2, usual_s)
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    nearest = np.where(wanted - times[after - 1] <= times[after] - wanted, after - 1, after)
    shortest, longest = 1000 * float(np.diff(times).min()), 1000 * float(np.diff(times).max())
    remark = f"its frame rate varies ({shortest:.0f} to {longest:.0f} ms): resampled to {1 / usual_s:.2f} fps by time"
    return Timeline(1 / usual_s, tuple(images[k][0] for k in nearest.tolist()), remark=remark, images=images)


_Change = tuple[int, int]

MISSING = -1
"""Number of no image."""


def _checked(told: Any) -> Any:
    if _whole(told):
        return told
    pairs = [tuple(one) for one in told if isinstance(one, list | tuple)] if isinstance(told, list | tuple) else []
    whole = bool(pairs) and len(pairs) == len(told) and all(len(one) == 2 and all(map(_whole, one)) for one in pairs)
    if not whole or pairs[0][0] != 0 or any(after[0] <= before[0] for before, after in itertools.pairwise(pairs)):
        raise PydanticCustomError(
            "offset",
            "expected a number of frames, or pairs [frame, offset] in the order of frames, the first one of frame 0",
        )
    return tuple(pairs)


def _whole(told: Any) -> bool:
    return isinstance(told, int) and not isinstance(told, bool)


Offset = Annotated[int | tuple[_Change, ...], pydantic.BeforeValidator(_checked)]
"""Frames, or pairs of a frame and the offset from it on."""

Offsets = dict[str, Offset]
"""View -> offset."""


@dataclass(frozen=True)
class ViewOffset:
    """The offset of a view."""

    changes: tuple[_Change, ...] = ((0, 0),)
    """From which frame on it is which."""

    def number(self, frame: int) -> int:
        """The image of a frame in the view's own count, negative for none.

        Where an offset gets less, the camera has dropped images: the last one before is the nearest to one frame more,
        and others have none.
        """
        last, number = MISSING, MISSING
        for (begin, offset), (end, _) in itertools.pairwise((*self.changes, (frame + 1, 0))):
            if begin <= frame:
                number = frame + offset
                if frame >= end:
                    last = max(last, end - 1 + offset)
        return number if number >= last else MISSING

    def frame(self, number: int) -> int:
        """The frame that an image is nearly of, where offsets change; see `number`."""
        return number - self.changes[0][1]

    def length(self, n_images: int) -> int:
        """The frames that so many images are enough for."""
        return n_images - self.changes[-1][1]

    @property
    def first(self) -> int:
        """The first frame that has an image."""
        return max(0, -self.changes[0][1])


def chosen_offsets(names: tuple[str, ...], offsets: Mapping[str, Offset]) -> tuple[ViewOffset, ...]:
    """Offsets in the order of the views.

    Raises:
        SequenceError: an offset for a view that is not there.
    """
    for name in offsets:
        if name not in names:
            raise SequenceError(f'offsets: no view "{name}"; {nearest(name, names)}')
    told = (offsets.get(name, 0) for name in names)
    return tuple(ViewOffset(((0, one),) if isinstance(one, int) else one) for one in told)


def later(offset: Offset, images: Mapping[int, int]) -> Offset:
    """An offset made larger, from some frames on, by so many images each.

    Args:
        offset: as it is.
        images: frame -> how many more from it on, in order; the first one holds from the beginning on.
    """
    before: tuple[_Change, ...] = ((0, offset),) if isinstance(offset, int) else offset
    begins, more = sorted(images), [images[begin] for begin in sorted(images)]
    begins[0] = 0
    changes: list[_Change] = []
    for frame in sorted({*begins, *(frame for frame, _ in before)}):
        own = [value for begin, value in before if begin <= frame][-1]
        added = own + [value for begin, value in zip(begins, more, strict=True) if begin <= frame][-1]
        if not changes or changes[-1][1] != added:
            changes.append((frame, added))
    return changes[0][1] if len(changes) == 1 else tuple(changes)
