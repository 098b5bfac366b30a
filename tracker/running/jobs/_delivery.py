"""Limits of a run of live cameras, whose frames come only once; images brightened, smoothed and brought in step."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import dropwhile, islice
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from tracker.cameras.frame import Frame
from tracker.cameras.rig import fitting_downscale, shown_px
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.errors import ConfigError, TrackerError
from tracker.foundation.source_files import json_of
from tracker.images.inspection import Survey, changes
from tracker.images.operations.appearance import noise_grey
from tracker.images.plate import threshold_level
from tracker.images.reading import Reading, Sequence, later
from tracker.images.reading.live import LiveCounts, counts_of
from tracker.tracking.cycle import Cycle
from tracker.tracking.trajectory import Step

__all__ = ["LiveCounts", "counts_of", "is_live", "patiently", "settings_missing", "timed"]


def is_live(read: Any) -> bool:
    """Whether a reading, or its opened recording, is of live cameras."""
    return bool(getattr(read, "live", False))


def settings_missing(job: Any) -> Iterator[str]:
    """Settings that a job of live cameras lacks: it gets each frame once."""
    if job.passes != 1:
        yield "passes = 1"
    if job.inspection:
        yield "inspection = false"
    fitted = [one.name for one in job.persons if one.is_fitted]
    if fitted:
        yield f'shape = "model" of {", ".join(fitted)}'
    if job.smoothing is not None:
        yield "no smoothing (`bodytrack result smooth` afterwards)"
    if job.keypoints is not None:
        yield "no keypoints"


def timed(steps: Iterable[Step], counts: LiveCounts) -> Iterator[Step]:
    """The steps as they come, counted when their poses are ready."""
    for step in steps:
        counts.done(step.frame.time_s)
        yield step


def patiently(cycle: Cycle, sequence: Sequence) -> Cycle:
    """The cycle that waits, however long, until a person comes before the live cameras."""
    return replace(cycle, loss=replace(cycle.loss, start_within=sequence.n_frames))


_BRIGHT_GREY, _WHITE_GREY = 130.0, 240.0
"""Largest channel that half of the pixels of an image, and all except a hundredth, reach after brightening; the smaller
gain counts. Recordings of `BODYTRACK_DATA` have 117 to 144, and 145 to 255."""

_DARK = 1.4
"""Gain below which images are left as they are. A dance that needs a gain of 2.9 was tracked 65 mm (49) off, with a
joint off in 55 of 64 frames: a difference from a plate counts from 14 grey levels."""

_MOST_GAIN = 5.0
"""In darker images rounding leaves little."""

_BLACK_FRAMES = 100
"""If the first image is darker than that, images are compared with those that are not."""

_NOISY_GREY = 2.0
"""Noise of images that are smoothed, grey levels. Recordings of `BODYTRACK_DATA` have up to 1.1. With noise of 3.1 a
dance was tracked 34 mm (28) off, with a joint off in 32 of 64 frames; with 6.3 nobody was found, though plates were
there."""

_ROUGH_GREY = 5.8
"""Difference of images from clean plates where nothing has changed, grey levels, from which images are smoothed: noise,
and effects of a codec. Recordings of `BODYTRACK_DATA` have up to 5.2. A dance compressed until it shows had 7, and was
tracked 28 mm (22) off, with a joint off in 23 frames."""

_SMOOTHING_PX = 1.0
"""Smoothing of noisy images, px as recorded. Smoothed, those dances were tracked 17 to 20 mm (10 to 12) off, as without
noise, with no joint off in any frame. Without noise smoothing costs some 2 mm (1)."""


def sized(reading: Reading) -> Reading:
    """A reading that enlarges or averages images by the height of the persons in them, unless it says how."""
    if getattr(reading, "downscale", 1) is not None:
        return reading
    settings: Any = reading  # of whatever kind, it has a rig and views
    try:
        rig = load_rig(settings.rig, settings.views)
    except TrackerError:
        return reading  # opening it tells what is wrong
    averaged: Reading = replace(settings, downscale=fitting_downscale(rig))
    return averaged


def opened_even(reading: Reading) -> Sequence:
    """The opened recording: dark images are made brighter, noisy ones smoothed, unless the reading sets either.

    Raises:
        TrackerError: it cannot be opened, see `tracker.images.reading.Reading.open`.
    """
    settings: Any = reading
    sequence = reading.open()
    if getattr(reading, "gain", 1.0) is None and (gain := _gain(sequence)) > _DARK:
        settings = replace(settings, gain=round(gain, 2))
        sequence = settings.open()
    if getattr(reading, "smoothing_px", 0.0) is None and _is_noisy(sequence):
        sigma_px = _SMOOTHING_PX * max(1.0, 1 / sequence.rig.cameras[0].downscale)
        sequence = replace(settings, smoothing_px=sigma_px).open()
    return sequence


def chosen_settings(reading: Any, sequence: Sequence) -> dict[str, float]:
    """`gain` and `smoothing_px` that an opened recording chose where its reading leaves them open.

    With these settings it opens with the same images.
    """
    usual = {"gain": 1.0, "smoothing_px": 0.0}
    has = {name: float(getattr(sequence, name, value)) for name, value in usual.items()}
    return {name: has[name] for name in usual if getattr(reading, name, 0) is None and has[name] != usual[name]}


def _first(sequence: Sequence, n_frames: int) -> list[Frame]:
    """The first frames that are not black, as before a lamp is on; the first ones if all are."""
    try:
        frames = list(islice(sequence.frames(), n_frames))
        if frames and _gain_of(frames[0]) > _MOST_GAIN:
            lit = dropwhile(lambda frame: _gain_of(frame) > _MOST_GAIN, islice(sequence.frames(), _BLACK_FRAMES))
            frames = list(islice(lit, n_frames)) or frames
    except TrackerError:
        return []  # tracking tells what is wrong
    return frames


def _gain(sequence: Sequence) -> float:
    """Gain that makes the first images as bright as usual; 1 if there are none."""
    return float(np.clip(max(map(_gain_of, _first(sequence, 1)), default=1.0), 1.0, _MOST_GAIN))


def _gain_of(frame: Frame) -> float:
    """Gain that makes images as bright as usual, the median of the views; 1 if there are none."""
    images = [image for image in frame.images if image is not None]
    levels = [np.percentile(image[::4, ::4].max(axis=2), (50, 99)) for image in images]
    gains = [min(_BRIGHT_GREY / max(half, 1.0), _WHITE_GREY / max(most, 1.0)) for half, most in levels]
    return float(median(gains)) if gains else 1.0


def _is_noisy(sequence: Sequence) -> bool:
    """Whether the first images have noise, or are rough beside clean plates."""
    frames = _first(sequence, 2)
    if not frames:
        return False
    images = frames[0].images
    pairs = zip(images, frames[-1].images, strict=True)
    noise = [noise_grey(one, other) for one, other in pairs if one is not None and other is not None]
    # those that are made of the recording are as rough as it is
    plates = (None,) * len(images) if sequence.makes_plates else sequence.plates
    shown = zip(images, plates, strict=True)
    rough = [threshold_level(one, plate, 1.0, 0.0) for one, plate in shown if one is not None and plate is not None]
    return max(noise, default=0.0) > _NOISY_GREY or (bool(rough) and median(rough) > _ROUGH_GREY)


def delivered(sequence: Sequence) -> str:
    """Changes of the images of a recording before they are used; empty for none."""
    factor, sigma_px = sequence.rig.cameras[0].downscale, getattr(sequence, "smoothing_px", 0.0)
    gain, told = getattr(sequence, "gain", 1.0), []
    if factor != 1:
        done = "enlarged twice" if factor < 1 else f"averaged over {factor:g} x {factor:g} pixels"
        told.append(f"images {done}, persons are then some {shown_px(sequence.rig):.0f} pixels high")
    if gain != 1:
        told.append(f"images made {gain:g} times brighter")
    if sigma_px:
        told.append(f"images smoothed by a Gaussian of {sigma_px:g} px, against noise and compression")
    return "; ".join(told)


MOST_ROUNDS = 3
"""Rounds of measuring and correcting: views that overlap more show the remaining delay."""

_FEWEST_FRAMES = 20
"""For a recording whose views cannot be compared."""

_SETTINGS = ("offsets", "start", "stop", "on_missing")
"""Key of a reading that corrects delays."""


def in_step(reading: Reading, sequence: Sequence, seen: Survey) -> Reading | None:
    """The reading with the offsets that bring its views in step; None if they are in step, or shall stay as they are.

    Frames keep the numbers that they have in most views. The first and the last frames are left out if a view has no
    image of them.

    Args:
        reading: settings of the recording.
        sequence: the recording, opened with them.
        seen: findings in its first frames.
    """
    settings: Any = reading
    if not brings(reading):
        return None
    late = {name: told for v, name in enumerate(seen.rig.names) if (told := changes(seen, v))}
    if not late:
        return None
    added = {name: later(settings.offsets.get(name, 0), told) for name, told in late.items()}
    begin = max(-(one if isinstance(one, int) else one[0][1]) for one in added.values())
    start = settings.start + settings.stride * max(0, -((settings.start - begin) // settings.stride))
    last = settings.start + (sequence.n_frames - 1) * settings.stride
    stop = last + 1 - max(0, *(list(told.values())[-1] for told in late.values()))
    if stop <= start:
        return None
    changed: dict[str, Any] = {"offsets": {**settings.offsets, **added}, "start": start, "stop": stop}
    if any(after < before - 1 for told in late.values() for before, after in itertools.pairwise(told.values())):
        changed["on_missing"] = "skip"  # several images in turn were dropped
    corrected: Reading = replace(settings, **changed)
    return corrected


def brings(reading: Reading) -> bool:
    """Whether to bring late views in step, and poses to one moment."""
    return getattr(reading, "in_step", "off") != "off"


def untold(seen: Survey) -> str:
    """Warning about views that nothing compares; empty if there are none."""
    told = seen.delays.told
    if told.all() or len(seen.foregrounds) < _FEWEST_FRAMES:
        return ""
    names = [name for name, one in zip(seen.rig.names, told, strict=True) if not one]
    verb = "shows" if len(names) == 1 else "show"
    whether = f"{' and '.join(names)} {verb} the same moments as the others" if told.any() else "views are in step"
    return f"views: too little moves in the first {len(seen.foregrounds)} frames to tell whether {whether}"


def corrections(asked: Any, reading: Any) -> dict[str, Any]:
    """The settings of a reading that differ from the configuration, as `run.json` keeps them."""
    return {
        name: getattr(reading, name)
        for name in _SETTINGS
        if hasattr(reading, name) and getattr(reading, name) != getattr(asked, name)
    }


def corrected_before(reading: Reading, folder: Path | None) -> Reading:
    """A reading with the corrections of an interrupted run; unchanged if that run corrected, or kept, nothing.

    Args:
        reading: settings of the recording.
        folder: result of the interrupted run; None for none.
    """
    try:
        kept: Any = {} if folder is None else json_of(folder / "run.json", ConfigError).get("images", {})
    except ConfigError:
        return reading
    told = {name: kept[name] for name in _SETTINGS if isinstance(kept, Mapping) and name in kept}
    changed: Reading = replace(reading, **told) if told else reading  # type: ignore[type-var]
    return changed


def told_of_delays(asked: Any, reading: Any) -> str:
    """The corrections, in words; empty for none."""
    before, now = getattr(asked, "offsets", {}), getattr(reading, "offsets", {})
    views = [f"{name} {_words(before.get(name, 0), one)}" for name, one in now.items() if one != before.get(name, 0)]
    return f"views brought in step: {', '.join(views)}" if views else ""


def _words(before: Any, now: Any) -> str:
    if isinstance(before, int) and isinstance(now, int):
        images = now - before
        return f"was {abs(images)} image{'s' * (abs(images) > 1)} {'late' if images > 0 else 'early'}"
    pairs = ((0, now),) if isinstance(now, int) else now
    first, *others = pairs
    return f"has offset {first[1]}" + "".join(f", {offset} from frame {frame} on" for frame, offset in others)
