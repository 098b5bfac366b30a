"""Times of images that recording programs write beside their videos: Caliscope's and FreeMoCap's tables."""

from __future__ import annotations

import csv
import logging
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array, Integers
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
"""Of an interval: an image that is farther from a frame's time is none of it. Cameras that are not triggered are up to
half of one apart."""


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
