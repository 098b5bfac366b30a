"""The frame rate of a recording: that of its views' files, or the one that is given, where they allow it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tracker.foundation.errors import SequenceError
from tracker.images.reading._timeline import Timeline

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
    """What is said of views at the rate that is taken.

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
    """What is said of views whose frame rates hardly differ, but by frames at the end; empty if they do not."""
    rates = [one.fps for one in timelines]
    n_frames = max(map(len, timelines)) * (1 - min(rates) / max(rates)) if rates and max(rates) > 0 else 0.0
    if n_frames < _APART_FRAMES:
        return ""
    return (
        f"the views have {min(rates):.3f} to {max(rates):.3f} frames a second and are paired by number: at the end "
        f"they are {n_frames:.1f} frames apart, unless one clock has released them all (fps says that it has)"
    )
