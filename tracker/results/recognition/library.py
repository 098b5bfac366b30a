"""A library of movements: a folder for each, with a table of every performance.

`walk/movement.toml` describes the movement, `walk/anna.csv` one performance of it: 25 rows a second with the directions
of the limbs (see `recognition.limb_directions`). It holds no code, no places and no likenesses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pydantic
import tomli_w

from tracker.foundation.arrays import Array, Array32, frozen
from tracker.foundation.errors import ConfigError, name_fault, nearest
from tracker.foundation.files import csv_lines, write_whole
from tracker.foundation.resources import models_folder
from tracker.foundation.source_files import cells_of, number_in, rows_of, toml_of
from tracker.results.recognition import FEATURES, LIMBS, RATE_HZ, Course

LEAST_FRAMES = 8
"""Least length: a third of a second, because shorter performances fit almost anything."""

MOST_FRAMES = 1500
"""Largest length: a minute, because matching takes longer with a larger library."""

_UNIT = 0.02
"""Tolerance of the lengths of directions: files have three digits."""


class Description(pydantic.BaseModel):
    """Content of `movement.toml`."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)

    about: str = ""
    repeats: bool = False
    """Whether it is a cycle, as walking is: it may then begin and end anywhere. A performance is one cycle."""

    told_by: tuple[str, ...] = ()
    """Decisive directions, for instance those of the legs if the arms may do anything; empty for all."""

    stays: bool = False
    """Whether the person stays in one place: who goes over the floor does something else."""

    source: str = ""
    """Source of the performances, and their licence."""


@dataclass(frozen=True)
class Movement:
    """A known movement."""

    name: str
    description: Description
    performances: dict[str, Array32]
    """Performance -> (T, L, 3) unit directions of the library's features, at `RATE_HZ`."""


@dataclass(frozen=True)
class Library:
    """Known movements, by name."""

    movements: dict[str, Movement] = field(default_factory=dict)
    features: tuple[str, ...] = FEATURES
    """Meaning of the directions: a person's limbs, or the segments of another body."""

    def without(self, performance: str) -> Library:
        """The library without all performances of a name; movements without any other are gone."""
        kept = {}
        for name, movement in self.movements.items():
            others = {key: value for key, value in movement.performances.items() if key != performance}
            if others:
                kept[name] = Movement(name, movement.description, others)
        return replace(self, movements=kept)


def bundled_library() -> Path:
    """Folder of the library that comes with the package."""
    return models_folder() / "movements"


def load_library(folders: tuple[Path, ...]) -> Library:
    """Loads movements; performances of one movement in several folders add up.

    Args:
        folders: of libraries, each counts once; empty for the bundled one.

    Raises:
        ConfigError: a folder is not a library, two are of other bodies, or a file is damaged; the message names it.
    """
    movements: dict[str, Movement] = {}
    chosen = list({folder.resolve(): folder for folder in folders or (bundled_library(),)}.values())
    features = features_in(chosen[0])
    for folder in chosen:
        if features_in(folder) != features:
            raise ConfigError(
                f"{folder}: movements of another body than those in {chosen[0]}: expected one body's alone"
            )
        for movement in _movements_in(folder, features):
            known = movements.get(movement.name)
            if known is not None and known.description.repeats != movement.description.repeats:
                raise ConfigError(
                    f'{folder / movement.name}: "repeats" is {told(movement.description.repeats)}, and '
                    f"{told(known.description.repeats)} in another library: make them agree"
                )
            performances = dict(known.performances) if known else {}
            for name, directions in movement.performances.items():
                # one of a name that another library has, too, is told apart by where it is
                performances[f"{folder}/{name}" if name in performances else name] = directions
            movements[movement.name] = Movement(movement.name, (known or movement).description, performances)
    return Library(movements, features)


def columns_of(features: tuple[str, ...]) -> list[str]:
    """Head of a performance's table."""
    return ["time_s", *(f"{name}_{axis}" for name in features for axis in "xyz")]


def features_in(folder: Path) -> tuple[str, ...]:
    """Meaning of a library's directions, by the head of its first table; a person's if that is unknown."""
    first = next(iter(sorted(folder.glob("*/*.csv"))), None)
    head = [] if first is None else next(iter(cells_of(first, ConfigError)), [])
    names = tuple(name.removesuffix("_x") for name in head if name.endswith("_x"))
    whole = set(columns_of(names)) == set(head)
    of_another = set(names) != set(FEATURES) and (whole or not set(names) & set(LIMBS))
    return names if names and of_another else FEATURES


def told(value: bool) -> str:
    """A truth value as TOML has it."""
    return str(value).lower()


def _movements_in(folder: Path, features: tuple[str, ...]) -> Iterator[Movement]:
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder, expected a library of movements")
    inner = sorted(path for path in folder.iterdir() if path.is_dir() and (path / "movement.toml").is_file())
    if not inner:
        raise ConfigError(
            f"{folder}: no movement in it, expected folders with movement.toml and CSV tables; "
            "bodytrack result recognize RESULT NAME --add makes one"
        )
    for path in inner:
        tables = sorted(path.glob("*.csv"))
        if not tables:
            raise ConfigError(f"{path}: no CSV table in it, expected one a performance")
        yield Movement(path.name, description_in(path), {table.stem: _directions(table, features) for table in tables})


def description_in(folder: Path) -> Description:
    """Content of the `movement.toml` in a movement's folder.

    Raises:
        ConfigError: it is damaged.
    """
    path = folder / "movement.toml"
    table = toml_of(path, ConfigError)
    for key in table:
        if key not in Description.model_fields:
            raise ConfigError(f'{path}: unknown key "{key}"; {nearest(key, Description.model_fields)}')
    try:
        return Description(**table)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error


def _directions(path: Path, features: tuple[str, ...]) -> Array32:
    """(T, L, 3) of a performance's table.

    Raises:
        ConfigError: it is not such a table.
    """
    rows, columns = rows_of(path, ConfigError), columns_of(features)
    unknown = next((name for name in rows[0] if name not in columns), None)
    if unknown is not None:
        raise ConfigError(f'{path}: unknown column "{unknown}"; {nearest(unknown, columns)}')
    values = np.array([[number_in(row, column, path, ConfigError) for column in columns] for row in rows])
    if not LEAST_FRAMES <= len(values) <= MOST_FRAMES:
        raise ConfigError(f"{path}: {len(values)} rows, expected {LEAST_FRAMES} to {MOST_FRAMES}")
    if np.abs(np.diff(values[:, 0]) * RATE_HZ - 1).max() > 0.01:
        raise ConfigError(f"{path}: the times are not {1 / RATE_HZ:g} s apart, expected {RATE_HZ:g} rows a second")
    directions = values[:, 1:].reshape(len(values), -1, 3)
    lengths = np.linalg.norm(directions, axis=-1)
    t, limb = np.unravel_index(np.abs(lengths - 1).argmax(), lengths.shape)
    if abs(lengths[t, limb] - 1) > _UNIT:
        raise ConfigError(f"{path}: {features[limb]} in row {t + 1} has length {lengths[t, limb]:.2f}, expected 1")
    directed: Array32 = frozen(directions / lengths[..., None], np.float32)
    return directed


# Performances that are added to a library of movements; of one that repeats, the round that closes best.

_LONGEST_ROUND_S, _SHORTEST_ROUND_S = 4.0, 0.4
"""Longest cycle of a repeating movement, seconds: a slow squat, and a sprinter's two steps."""

_CLOSED_DEG = 20.0
"""Largest RMS angle between the ends of a cycle: half of the angle between unlike postures of a walk (`benchmark.py
recognition` prints both)."""

_NEARLY_DEG = 3.0
"""Excess over the best return for which a shorter cycle is taken: in a walk, one cycle and two differ by 1 to 2."""


def add_performance(
    folder: Path, movement: str, performance: str, course: Course, description: Description
) -> tuple[Path, Course]:
    """Adds a performance of a movement to a library; of a repeating one, the cycle that closes best.

    Args:
        folder: of the library; created if missing.
        movement: its name.
        performance: its name; it must be new.
        course: the movement, without unknown frames.
        description: of the movement, if the library lacks it; otherwise `repeats` must be the same.

    Returns:
        The table written, and its content.

    Raises:
        ConfigError: a name cannot be used, the library is of another body, or the performance exists already, is too
            short or too long, or does not repeat.
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
        content = description.model_dump(exclude_defaults=True) | {"repeats": description.repeats}
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
    """One cycle of a repeating movement.

    The length of the cycle is the shortest one at which poses return nearly as well as at the best; it begins where
    they return best. An exact cycle, whose end leads to its beginning, stays as it is.

    Raises:
        ConfigError: it does not return to its beginning.
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
            f"it does not return to its beginning within {_LONGEST_ROUND_S:g} s: choose frames with two cycles, "
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
