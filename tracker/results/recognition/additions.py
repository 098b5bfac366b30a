"""Performances that are added to a library of movements; of one that repeats, the round that closes best."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomli_w

from tracker.foundation.arrays import Array, Array32
from tracker.foundation.errors import ConfigError, name_fault
from tracker.foundation.files import csv_lines, write_whole
from tracker.results.recognition.library import (
    LEAST_FRAMES,
    MOST_FRAMES,
    Description,
    columns_of,
    description_in,
    features_in,
    told,
)
from tracker.results.recognition.limb_directions import RATE_HZ, Course

_LONGEST_ROUND_S, _SHORTEST_ROUND_S = 4.0, 0.4
"""Of a movement that repeats: a slow squat, and a sprinter's two steps."""

_CLOSED_DEG = 20.0
"""Root mean square angle between the ends of a round beyond which it does not close: half of what lies between
unlike postures of a walk (`benchmark.py recognition` prints both)."""

_NEARLY_DEG = 3.0
"""Worse than at the best return at which a shorter round is taken: of a walk, one round and two differ by 1 to 2."""


def add_performance(
    folder: Path, movement: str, performance: str, course: Course, description: Description
) -> tuple[Path, Course]:
    """Adds a performance of a movement to a library; of one that repeats, the round that closes best.

    Args:
        folder: of the library; made if there is none.
        movement: its name.
        performance: name of the performance; one of that name must not be there.
        course: what was done, without unknown frames.
        description: of the movement, where the library does not know it yet; else it must not differ in `repeats`.

    Returns:
        The table written, and what stands in it.

    Raises:
        ConfigError: a name cannot be used, the library is of another body, or the performance is there already, too
            short, too long or does not repeat.
    """
    for name in (movement, performance):
        if fault := name_fault(name):
            raise ConfigError(fault)
    path = folder / movement / f"{performance}.csv"
    if path.exists():
        raise ConfigError(f"{path} is there already: choose another --performance, or delete it")
    if any(folder.glob("*/*.csv")) and features_in(folder) != course.features.names:
        raise ConfigError(f"{folder}: movements of another body: choose another --library")
    if not course.known.all():
        raise ConfigError("the person is lost in some of the frames: choose others with --frames")
    known = description_in(path.parent) if (path.parent / "movement.toml").is_file() else None
    if known is not None and known.repeats != description.repeats:
        raise ConfigError(f'{path.parent}: "repeats" is {told(known.repeats)} there: use --{_flag(known.repeats)}')
    kept = one_round(course) if description.repeats else course
    if not LEAST_FRAMES <= len(kept.known) <= MOST_FRAMES:
        raise ConfigError(
            f"{len(kept.known) / RATE_HZ:.2f} s, expected {LEAST_FRAMES / RATE_HZ:g} to "
            f"{MOST_FRAMES / RATE_HZ:g} s of one movement: choose its frames with --frames"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    if known is None:
        content = {key: value for key, value in description.model_dump().items() if value not in ("", ())}
        write_whole(path.parent / "movement.toml", tomli_w.dumps(content))
    write_whole(path, _table(kept))
    return path, kept


def _flag(repeats: bool) -> str:
    return "repeats" if repeats else "no-repeats"


def _table(course: Course) -> str:
    rows = [
        [f"{t / RATE_HZ:.2f}", *(f"{value:.3f}" for value in frame.ravel())]
        for t, frame in enumerate(course.directions)
    ]
    return csv_lines([columns_of(course.features.names), *rows]).replace("\r\n", "\n")


def one_round(course: Course) -> Course:
    """The part of a repeating movement after which it begins again.

    The round's length is the shortest one at which poses return nearly as well as at the best; its beginning is where
    they return best. What is exactly one round, so that its end leads to its beginning, stays as it is.

    Raises:
        ConfigError: it does not come back to where it was.
    """
    n_frames = len(course.known)
    lags = np.arange(round(_SHORTEST_ROUND_S * RATE_HZ), min(n_frames, round(_LONGEST_ROUND_S * RATE_HZ) + 1))
    returns = [_angles(course.directions[lag:], course.directions[: n_frames - lag]) for lag in lags]
    means = np.array([gaps.mean() for gaps in returns])
    low = [k for k in range(1, len(means)) if means[k] == means[max(k - 2, 0) : k + 3].min()]
    if not low or means.min() > _CLOSED_DEG:
        steps = _angles(course.directions[1:], course.directions[:-1])
        if _angles(course.directions[:1], course.directions[-1:])[0] <= 2 * steps.max(initial=0.0):
            return course
        raise ConfigError(
            f"it does not come back to where it began within {_LONGEST_ROUND_S:g} s: choose frames with two rounds, "
            "or add it with --no-repeats"
        )
    chosen = next(k for k in low if means[k] <= means.min() + _NEARLY_DEG)
    start = int(returns[chosen].argmin())
    return course.part(start, start + int(lags[chosen]))


def _angles(one: Array32, other: Array32) -> Array:
    """(T,) root mean square angles between directions (T, L, 3), degrees."""
    chords = np.linalg.norm(one - other, axis=-1)
    angles: Array = np.degrees(np.sqrt(np.mean((2 * np.arcsin(np.clip(chords / 2, 0, 1))) ** 2, axis=1)))
    return angles
