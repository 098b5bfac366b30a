"""Which image of a video belongs to which frame: what its time stamps say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.arrays import Array, Integers

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

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.stamps)


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
        return Timeline(told_fps, tuple(range(len(stamps))), timed=False)
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
    return _resampled(ordered, times, usual_s)


def _evenly(times: Array, places: Integers, interval_s: float) -> bool:
    return bool(np.abs(times - interval_s * places).max() < _MOST_OFF * interval_s)


def _resampled(ordered: list[int], times: Array, usual_s: float) -> Timeline:
    wanted = np.arange(0, float(times[-1]) + usual_s / 2, usual_s)
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    nearest = np.where(wanted - times[after - 1] <= times[after] - wanted, after - 1, after)
    shortest, longest = 1000 * float(np.diff(times).min()), 1000 * float(np.diff(times).max())
    remark = f"its frame rate varies ({shortest:.0f} to {longest:.0f} ms): resampled to {1 / usual_s:.2f} fps by time"
    return Timeline(1 / usual_s, tuple(ordered[k] for k in nearest.tolist()), remark=remark)
