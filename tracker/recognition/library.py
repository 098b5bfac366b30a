"""A library of movements: a folder for each, with a table of every performance.

`walk/movement.toml` says what the movement is, `walk/anna.csv` how somebody performs it: 25 rows a second with the
directions of the limbs (see `tracker.recognition.limb_directions`). Nothing in it is code, a place or a likeness.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pydantic
import tomli_w

from tracker.arrays import Array, Array32, frozen
from tracker.errors import ConfigError, name_fault, nearest
from tracker.files import csv_lines, write_whole
from tracker.recognition.limb_directions import FEATURES, RATE_HZ, Course
from tracker.resources import models_folder
from tracker.source_files import number_in, rows_of, toml_of

_COLUMNS = ("time_s", *(f"{name}_{axis}" for name in FEATURES for axis in "xyz"))

_LEAST_FRAMES = 8
"""A third of a second: shorter performances fit almost anything."""

_MOST_FRAMES = 1500
"""A minute: the time that matching takes grows with the library."""

_UNIT = 0.02
"""Directions are unit vectors to the three digits that files have."""


class Description(pydantic.BaseModel):
    """What `movement.toml` says."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)

    about: str = ""
    repeats: bool = False
    """Whether it goes round, as walking does: it may then begin and end anywhere. A performance is one round."""

    source: str = ""
    """Where the performances come from, and on what terms."""


@dataclass(frozen=True)
class Movement:
    """A movement that is known."""

    name: str
    description: Description
    performances: dict[str, Array32]
    """Performance -> (T, 9, 3) unit directions in the order of `FEATURES`, at `RATE_HZ`."""


@dataclass(frozen=True)
class Library:
    """Movements that are known, by name."""

    movements: dict[str, Movement] = field(default_factory=dict)

    def without(self, performance: str) -> Library:
        """The library without all performances of one name; movements that have no other are gone."""
        kept = {}
        for name, movement in self.movements.items():
            others = {key: value for key, value in movement.performances.items() if key != performance}
            if others:
                kept[name] = Movement(name, movement.description, others)
        return Library(kept)


def bundled_library() -> Path:
    """Folder of the library that comes with the package."""
    return models_folder() / "movements"


def load_library(folders: tuple[Path, ...]) -> Library:
    """Loads movements; performances of one movement in several folders add up.

    Args:
        folders: of libraries; empty for the one that comes with the package.

    Raises:
        ConfigError: a folder is none, or something in it is damaged; the file is named.
    """
    movements: dict[str, Movement] = {}
    for folder in folders or (bundled_library(),):
        for movement in _movements_in(folder):
            known = movements.get(movement.name)
            if known is not None and known.description.repeats != movement.description.repeats:
                raise ConfigError(
                    f'{folder / movement.name}: "repeats" is {_told(movement.description.repeats)}, and '
                    f"{_told(known.description.repeats)} in another library: make them agree"
                )
            performances = {**(known.performances if known else {}), **movement.performances}
            movements[movement.name] = Movement(movement.name, (known or movement).description, performances)
    return Library(movements)


def _told(value: bool) -> str:
    return str(value).lower()


def _movements_in(folder: Path) -> Iterator[Movement]:
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder, expected a library of movements")
    inner = sorted(path for path in folder.iterdir() if path.is_dir() and (path / "movement.toml").is_file())
    if not inner:
        raise ConfigError(
            f"{folder}: no movement in it, expected folders with movement.toml and CSV tables; "
            "bodytrack recognize RESULT NAME --add makes one"
        )
    for path in inner:
        tables = sorted(path.glob("*.csv"))
        if not tables:
            raise ConfigError(f"{path}: no CSV table in it, expected one a performance")
        yield Movement(path.name, _description(path), {table.stem: _directions(table) for table in tables})


def _description(folder: Path) -> Description:
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


def _directions(path: Path) -> Array32:
    """(T, 9, 3) of a performance's table.

    Raises:
        ConfigError: it is no such table.
    """
    rows = rows_of(path, ConfigError)
    unknown = next((name for name in rows[0] if name not in _COLUMNS), None)
    if unknown is not None:
        raise ConfigError(f'{path}: unknown column "{unknown}"; {nearest(unknown, _COLUMNS)}')
    values = np.array([[number_in(row, column, path, ConfigError) for column in _COLUMNS] for row in rows])
    if not _LEAST_FRAMES <= len(values) <= _MOST_FRAMES:
        raise ConfigError(f"{path}: {len(values)} rows, expected {_LEAST_FRAMES} to {_MOST_FRAMES}")
    if np.abs(np.diff(values[:, 0]) * RATE_HZ - 1).max() > 0.01:
        raise ConfigError(f"{path}: the times are not {1 / RATE_HZ:g} s apart, expected {RATE_HZ:g} rows a second")
    directions = values[:, 1:].reshape(len(values), -1, 3)
    lengths = np.linalg.norm(directions, axis=-1)
    t, limb = np.unravel_index(np.abs(lengths - 1).argmax(), lengths.shape)
    if abs(lengths[t, limb] - 1) > _UNIT:
        raise ConfigError(f"{path}: {FEATURES[limb]} in row {t + 1} has length {lengths[t, limb]:.2f}, expected 1")
    directed: Array32 = frozen(directions / lengths[..., None], np.float32)
    return directed


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
        ConfigError: a name cannot be used, the performance is there already, too short, too long or does not repeat.
    """
    for name in (movement, performance):
        if fault := name_fault(name):
            raise ConfigError(fault)
    path = folder / movement / f"{performance}.csv"
    if path.exists():
        raise ConfigError(f"{path} is there already: choose another --performance, or delete it")
    if not course.known.all():
        raise ConfigError("the person is lost in some of the frames: choose others with --frames")
    known = _description(path.parent) if (path.parent / "movement.toml").is_file() else None
    if known is not None and known.repeats != description.repeats:
        raise ConfigError(f'{path.parent}: "repeats" is {_told(known.repeats)} there: use --{_flag(known.repeats)}')
    kept = one_round(course) if description.repeats else course
    if not _LEAST_FRAMES <= len(kept.known) <= _MOST_FRAMES:
        raise ConfigError(
            f"{len(kept.known) / RATE_HZ:.2f} s, expected {_LEAST_FRAMES / RATE_HZ:g} to "
            f"{_MOST_FRAMES / RATE_HZ:g} s of one movement: choose its frames with --frames"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    if known is None:
        content = {key: value for key, value in description.model_dump().items() if value != ""}
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
    return csv_lines([_COLUMNS, *rows]).replace("\r\n", "\n")


_LONGEST_ROUND_S, _SHORTEST_ROUND_S = 4.0, 0.4
"""Of a movement that repeats: a slow squat, and a sprinter's two steps."""

_CLOSED_DEG = 20.0
"""Root mean square angle between the ends of a round beyond which it does not close: half of what lies between
unlike postures of a walk (`benchmark.py recognition` prints both)."""


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
        if _angles(course.directions[:1], course.directions[-1:])[0] <= 2 * steps.max():
            return course
        raise ConfigError(
            f"it does not come back to where it began within {_LONGEST_ROUND_S:g} s: choose frames with two rounds, "
            "or add it with --no-repeats"
        )
    chosen = next(k for k in low if means[k] <= means.min() + _NEARLY_DEG)
    start = int(returns[chosen].argmin())
    return course.part(start, start + int(lags[chosen]))


_NEARLY_DEG = 3.0
"""Worse than at the best return at which a shorter round is taken: of a walk, one round and two differ by 1 to 2."""


def _angles(one: Array32, other: Array32) -> Array:
    """(T,) root mean square angles between directions (T, L, 3), degrees."""
    chords = np.linalg.norm(one - other, axis=-1)
    angles: Array = np.degrees(np.sqrt(np.mean((2 * np.arcsin(np.clip(chords / 2, 0, 1))) ** 2, axis=1)))
    return angles
