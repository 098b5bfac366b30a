"""The rate of a recording, of its files or as given, and the times that Caliscope and FreeMoCap write beside videos."""

from __future__ import annotations

import csv
import logging
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import SequenceError
from tracker.images.reading._timeline import Timeline

log = logging.getLogger("tracker")

_OF_ALL = "timestamps.csv", "frame_time_history.csv"
"""Caliscope's table of all cameras, and what it was called before: `cam_id` (`port`) and `frame_time` in seconds."""

_CAMERAS = "cam_id", "port"
_TIME = "frame_time"

_OF_ONE = "timestamps", "timestamps/camera_timestamps"
"""FreeMoCap's folders of tables, one a camera, beside its videos."""

_FROM_START = "timestamp.from_recording_start.sec"
"""FreeMoCap 2 and SkellyCam; the first of them had `0`, in nanoseconds, and no other column."""

_FREEMOCAP_1 = ["", "0"]
_NANOSECONDS = 1e-9
"""Seconds."""

_MOST_OFF = 0.6
"""Share of an interval: an image farther from a frame's time does not belong to it. Cameras that are not triggered are
up to half of one apart."""


def paired_by_stamps(paths: Mapping[str, Path], found: list[Timeline | None]) -> list[Timeline | None]:
    """The timelines with each frame shown by the image whose time is nearest, where a program has written times.

    They stay as they are where there is no such table, or it does not fit the videos, which is logged.

    Args:
        paths: of the views' videos.
        found: their timelines, in the same order; None for an absent one.
    """
    there = {name: one for name, one in zip(paths, found, strict=True) if one is not None}
    told = _told(paths)
    if told is None or len(there) < 2:
        return found
    source, times = told
    images = {name: _images(one) for name, one in there.items()}
    for name, one in images.items():
        if len(times.get(name, ())) != len(one):
            log.warning(
                '%s: has %d times of view "%s", whose video has %d images: its times are not used',
                source,
                len(times.get(name, ())),
                name,
                len(one),
            )
            return found
    numbers, interval_s, apart_s = _numbers([times[name] for name in there])
    log.warning(
        '%s: views are paired by its times, up to %.0f ms apart, at %.4g frames a second; in_step = "off" in [reading] '
        "pairs them by number",
        source,
        1000 * apart_s,
        1 / interval_s,
    )
    paired = {
        name: _shown_by(one, images[name], own, 1 / interval_s)
        for (name, one), own in zip(there.items(), numbers, strict=True)
    }
    return [paired.get(name) for name in paths]


def _images(one: Timeline) -> list[int]:
    """Time stamps of a file's images, in order."""
    return sorted({*(stamp for stamp in one.stamps if stamp is not None), *(stamp for stamp, _ in one.images)})


def _shown_by(one: Timeline, images: list[int], numbers: Integers, fps: float) -> Timeline:
    stamps = tuple(None if number < 0 else images[number] for number in numbers.tolist())
    left_out = tuple(sorted(set(images) - set(stamps)))
    return replace(one, fps=fps, stamps=stamps, images=(), skipped=left_out, remark="")


def _numbers(times: list[Array]) -> tuple[list[Integers], float, float]:
    """The image of each view that is nearest to each frame, -1 for none; the interval and how far apart they are, s."""
    interval_s = float(np.median([np.median(np.diff(one)) for one in times]))
    first, last = max(float(one[0]) for one in times), min(float(one[-1]) for one in times)
    wanted = np.arange(first, last + 0.5 * interval_s, interval_s)
    numbers, shown = [], []
    for one in times:
        after = np.clip(np.searchsorted(one, wanted), 1, len(one) - 1)
        nearest = np.where(wanted - one[after - 1] <= one[after] - wanted, after - 1, after)
        near = np.abs(one[nearest] - wanted) <= _MOST_OFF * interval_s
        numbers.append(np.where(near, nearest, -1))
        shown.append(np.where(near, one[nearest], np.nan))
    spread = np.nanmax(shown, axis=0) - np.nanmin(shown, axis=0)
    return numbers, interval_s, float(np.nanmax(spread))


def _told(paths: Mapping[str, Path]) -> tuple[Path, dict[str, Array]] | None:
    """The table, or the folder of tables, beside the videos and the times of each view in order, seconds."""
    folders = {path.parent for path in paths.values()}
    if len(folders) != 1:
        return None
    (folder,) = folders
    for table in (folder / name for name in _OF_ALL):
        if table.is_file():
            found = _of_all(table, paths)
            if found is None:
                log.warning("%s: not a table of times that is known, expected cam_id and frame_time: not used", table)
            return None if found is None else (table, found)
    for tables in (folder / name for name in reversed(_OF_ONE)):
        found = {name: one for name, path in paths.items() if (one := _of_one(tables, path)) is not None}
        if found:
            return tables, found
    return None


def _of_all(table: Path, paths: Mapping[str, Path]) -> dict[str, Array] | None:
    """Times of each view by Caliscope's table; None if it is none."""
    times: dict[int, list[float]] = defaultdict(list)
    try:
        with table.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.DictReader(file)
            camera = next((name for name in _CAMERAS if name in (rows.fieldnames or ())), None)
            if camera is None or _TIME not in (rows.fieldnames or ()):
                return None
            for row in rows:
                times[int(float(row[camera]))].append(float(row[_TIME]))
    except (OSError, ValueError, TypeError, csv.Error):
        return None
    numbers = {name: int(match[0]) for name, path in paths.items() if (match := re.search(r"\d+(?=\D*$)", path.stem))}
    return {name: np.sort(times[number]) for name, number in numbers.items() if number in times}


def _of_one(tables: Path, video: Path) -> Array | None:
    """Times of a view by FreeMoCap's table of its camera; None if there is none, or it is another one."""
    camera = re.search(r"\.camera\.id(.+?)\.idx", video.name)
    pattern = f"*.camera{camera[1]}.timestamps.csv" if camera else f"{video.stem}_timestamps_human_readable.csv"
    table = next(iter(sorted(tables.glob(pattern))), None)
    if table is None:
        return None
    try:
        with table.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
        head = [name.strip("# ") for name in rows[0]]
        if head == _FREEMOCAP_1:
            return np.sort([_NANOSECONDS * float(row[1]) for row in rows[1:]])
        return np.sort([float(row[head.index(_FROM_START)]) for row in rows[1:]])
    except (OSError, ValueError, IndexError, csv.Error):
        return None


_ALIKE = 0.01
"""Rates that differ by less are one: 29.97 and 30 frames a second are told of, not refused."""

_APART_FRAMES = 0.5
"""Of views by the end of a recording, from which it is said."""


def common_rate(views: Mapping[str, Timeline], given: float | None) -> tuple[float, dict[str, int]]:
    """Frames a second of a recording, and of each view by its name every how many frames are taken.

    Views are paired by number: those of different rates never are, whatever rate is given. Where the lowest one is
    given, of which the others have whole multiples, so many of their frames are left out.

    Args:
        views: the files' own, at one pace each.
        given: by whoever reads the recording; None for nothing.

    Raises:
        SequenceError: files without a clock and no rate given, or rates that cannot be brought together.
    """
    clockless = {name: one for name, one in views.items() if one.fps <= 0}
    if clockless and given is None:
        raise SequenceError(_asked_for(clockless))
    rates = {name: one.fps if one.fps > 0 else given or 0.0 for name, one in views.items()}
    if max(rates.values()) <= (1 + _ALIKE) * min(rates.values()):
        return given or next(iter(rates.values())), dict.fromkeys(views, 1)
    lowest = min(rates.values())
    every = {name: round(rate / lowest) for name, rate in rates.items()}
    multiples = not clockless and all(abs(rates[name] / (lowest * n) - 1) < _ALIKE for name, n in every.items())
    if multiples and given is not None and abs(given / lowest - 1) < _ALIKE:
        return given, every
    table = ", ".join(f"{name} {rate:.2f}" for name, rate in rates.items())
    thinned = f"fps = {lowest:.5g} takes {_share(every)}, and all of the others"
    raise SequenceError(
        f"the views have different frame rates ({table} fps), so frames of one number are not of one moment"
        f"{'' if given is None else f', and fps = {given:g} does not change that'}: "
        f"{thinned if multiples else 'write the files anew at one rate, by their times'}; a file that tells a wrong "
        "rate, such as slow motion, has to be written anew with the right one"
    )


def _share(every: Mapping[str, int]) -> str:
    """Every how many frames of the faster views are taken, in words."""
    words = []
    for n in sorted(set(every.values()) - {1}):
        ordinal = {2: "second", 3: "third"}.get(n, f"{n}th")
        words.append(f"every {ordinal} frame of {', '.join(name for name, k in every.items() if k == n)}")
    return ", ".join(words)


def _asked_for(clockless: Mapping[str, Timeline]) -> str:
    hints = {name: one.hint_fps for name, one in clockless.items() if one.hint_fps > 0}
    told = sorted(set(hints.values()))
    if not hints:
        hint = "nor do the images hint at any"
    elif len(told) == 1:
        hint = f"the coded images hint at fps = {told[0]:.5g}, which cameras often leave wrong"
    else:
        hint = "the coded images hint at " + ", ".join(f"{name} {rate:.5g}" for name, rate in hints.items())
    without = [name for name, one in clockless.items() if one.clock]
    what = "do not tell their frame rate" if without else "are streams without a container, which have no clock"
    return (
        f"the videos of {', '.join(clockless)} {what}: set fps in [reading] to the frames a second that the "
        f"cameras filmed at; {hint}"
    )


def told_of_rates(views: Mapping[str, Timeline], fps: float, given: float | None) -> Iterator[str]:
    """Messages about views at the chosen rate.

    Args:
        views: as they are read.
        fps: taken.
        given: by whoever reads the recording; None for nothing.
    """
    for name, one in views.items():
        if not one.clock and one.hint_fps > 0 and abs(one.hint_fps / fps - 1) > _ALIKE:
            yield f'view "{name}": the coded images hint at {one.hint_fps:.5g} frames a second, fps = {fps:g} is taken'
    timed = [one for one in views.values() if one.fps > 0]
    rates = [one.fps for one in timed]
    thinned = any(one.skipped for one in timed)
    if given is not None and rates and abs(given / rates[0] - 1) > _ALIKE:
        yield (
            f"the files tell {rates[0]:.5g} frames a second, fps = {given:g} is taken: right where they are slow "
            "motion, or fast"
        )
    if (given is None or thinned) and (apart := _apart(timed)):
        yield apart


def _apart(timelines: list[Timeline]) -> str:
    """Message about views whose frame rates hardly differ, but add up to frames at the end; empty without any."""
    rates = [one.fps for one in timelines]
    n_frames = max(map(len, timelines)) * (1 - min(rates) / max(rates)) if rates and max(rates) > 0 else 0.0
    if n_frames < _APART_FRAMES:
        return ""
    return (
        f"the views have {min(rates):.3f} to {max(rates):.3f} frames a second and are paired by number: at the end "
        f"they are {n_frames:.1f} frames apart, unless one clock has released them all (fps says that it has)"
    )
