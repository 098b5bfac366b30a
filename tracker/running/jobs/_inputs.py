"""Fingerprints of a job's inputs: a job can only be resumed with the same ones."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import re
import tomllib
import typing
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tracker.cameras.rig_layouts import read_rig
from tracker.foundation.configuration.components import available, find
from tracker.foundation.configuration.tables import Table, entries_of, named_of, path_mark, read_config
from tracker.foundation.errors import CalibrationError, ConfigError
from tracker.images.footage import PICTURES, VIDEOS
from tracker.running.jobs._folder import CONFIG

INPUTS = "inputs.json"
"""File of the fingerprints, beside a result."""

_BLOCK, _N_BLOCKS = 2**16, 64
"""Blocks read of a file larger than 4 MiB, evenly spread: an hour of video takes milliseconds."""

Fingerprints = dict[str, str]
"""Path -> size and SHA-256."""


def fingerprints(job: Any, views: tuple[str, ...]) -> Fingerprints:
    """Size and SHA-256 of every input file that a job's fields name.

    Of a folder of numbered files only the first, second, third, fifth, ninth, ... count: a recording may grow, and
    hashing 100 000 pictures takes longer than some.

    Args:
        job: a component; its fields that are paths count, and those of its components.
        views: names that `{view}` stands for.
    """
    files = (file for text in _paths(job) for file in _files(text, views))
    files = (one for file in files for one in (file, *_skin_of(file)))
    return {str(file): _fingerprint(file) for file in dict.fromkeys(files)}


def _skin_of(path: Path) -> Iterator[Path]:
    """The files of the skin, if this is a model file with a skin."""
    if path.suffix != ".toml":
        return
    with contextlib.suppress(OSError, ValueError):
        skin = tomllib.loads(path.read_text(encoding="utf-8")).get("skin")
        named = skin if isinstance(skin, dict) else {}
        files = (path.parent / str(named[name]) for name in ("surface", "weights") if named.get(name))
        yield from (file for file in files if file.is_file())


def check_inputs(folder: Path, now: Mapping[str, str]) -> None:
    """Compares the fingerprints with those at the beginning of a result; new inputs do not matter.

    Args:
        folder: the result.
        now: fingerprints of its inputs now.

    Raises:
        ConfigError: the first input that has changed or is gone, or the file of fingerprints is damaged.
    """
    path = folder / INPUTS
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        pairs = sorted(before.items())
    except FileNotFoundError as error:
        raise ConfigError(
            f"{folder}: was stopped before it computed anything, or is of another version: run anew without --resume"
        ) from error
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise ConfigError(f"{path}: damaged, so its inputs cannot be compared: run anew without --resume") from error
    for name, fingerprint in pairs:
        if now.get(name) != fingerprint:
            fault = "is another file than when the run began" if name in now else "is no longer there"
            raise ConfigError(f"{name} {fault}: resume with what it was made from, or run anew without --resume")


def _paths(part: Any) -> Iterator[str]:
    kinds = typing.get_type_hints(type(part), include_extras=True)
    for field in dataclasses.fields(part):
        yield from _paths_in(getattr(part, field.name), kinds[field.name])


def _paths_in(value: Any, kind: Any) -> Iterator[str]:
    if dataclasses.is_dataclass(value):
        yield from _paths(value)
    elif isinstance(value, tuple):
        for entry in value:
            yield from _paths_in(entry, entries_of(kind))
    elif isinstance(value, dict):
        for entry in value.values():
            yield from _paths_in(entry, named_of(kind))
    elif isinstance(value, str | Path) and path_mark(kind) is not None:
        yield str(value)


def _files(text: str, views: tuple[str, ...]) -> Iterator[Path]:
    for path in dict.fromkeys(Path(text.replace("{view}", view)) for view in views or ("",)):
        if path.is_file():
            yield path
        elif path.is_dir():
            yield from _some([file for file in path.iterdir() if file.is_file()])
        elif "{frame}" in path.name and path.parent.is_dir():
            number = re.compile(r"\d+".join(re.escape(piece) for piece in path.name.split("{frame}")))
            yield from _some([file for file in path.parent.iterdir() if number.fullmatch(file.name)])


def _some(files: list[Path]) -> Iterator[Path]:
    """The files at the places 0, 1, 2, 4, 8, ...: files added behind them do not change these."""
    ordered = sorted(files, key=lambda file: (_numbers(file.name), file.name))
    yield from ordered[:1]
    place = 1
    while place < len(ordered):
        yield ordered[place]
        place *= 2


def _numbers(name: str) -> list[int]:
    return [int(digits) for digits in re.findall(r"\d+", name)]


def _fingerprint(path: Path) -> str:
    digest, size = hashlib.sha256(), path.stat().st_size
    with path.open("rb") as file:
        if size <= _N_BLOCKS * _BLOCK:
            digest.update(file.read())
            return f"{size} bytes, sha256 {digest.hexdigest()}"
        for k in range(_N_BLOCKS):
            file.seek(k * (size - _BLOCK) // (_N_BLOCKS - 1))
            digest.update(file.read(_BLOCK))
    return f"{size} bytes, sha256 of {_N_BLOCKS} blocks {digest.hexdigest()}"


_END = "reading.stop"
"""The only setting that may change: a run may be extended. Its frames do not depend on later ones, except through
bodies fitted to the first frames; the run keeps these."""


def check_same(now: Table, folder: Path) -> None:
    """Compares the configuration of a result with the present one.

    Args:
        now: the resolved configuration.
        folder: the result.

    Raises:
        ConfigError: the first setting that differs, or a range that ends earlier.
    """
    path = folder / CONFIG
    if not path.is_file():
        raise ConfigError(f"{folder}: no {CONFIG} there that tells how it was made; run without --resume")
    if path.stat().st_size == 0:
        raise ConfigError(f"{folder}: was stopped before it computed anything: remove it, and run without --resume")
    before, wanted = _flat(read_config(path)), _flat(now)
    for key in sorted(before.keys() | wanted.keys()):
        then, asked = before.get(key), wanted.get(key)
        if then == asked or (key == _END and _extends(then, asked)):
            continue
        mended = "resume with what it was made with, or run anew without --resume"
        if key == _END:
            mended = f"--resume may only extend a run; {mended}"
        raise ConfigError(f"{path}: {key} = {_told(then)}, but {_told(asked)} is asked for: {mended}")


def _extends(then: Any, asked: Any) -> bool:
    """Whether an end is behind another one; None is the end of the recording."""
    return then is not None and (asked is None or (isinstance(then, int) and asked > then))


def _told(value: Any) -> str:
    return "nothing" if value is None else repr(value)


def _flat(value: Any, key: str = "") -> Table:
    """The values of nested tables and lists by their dotted keys."""
    if isinstance(value, dict) and value:
        return {name: leaf for k, entry in value.items() for name, leaf in _flat(entry, f"{key}.{k}").items()}
    if isinstance(value, list) and value:
        return {name: leaf for k, entry in enumerate(value) for name, leaf in _flat(entry, f"{key}.{k}").items()}
    return {key.removeprefix("."): value}


_DRAFT = "`bodytrack init VIDEOS` writes the configuration of a run"

_PROGRAMS = {
    "Anipose's config.toml": {"project", "nesting"},
    "Pose2Sim's Config.toml": {"project", "triangulation"},
    "Sports2D's Config.toml": {"base", "px_to_meters_conversion"},
}
"""Configurations of other programs, and their sections."""

_COMMANDS = {"track": "run", "calibrate": "calibrate"}
"""Jobs whose command has another name; they come first, because other jobs have their sections, too."""

_CALIBRATIONS = {"reference_bar": "bar", "chessboard": "chessboard", "scene_points": "points"}


def read_own(use: str, path: Path, overrides: Sequence[str] = ()) -> Table:
    """Reads the configuration of a job, as `tracker.foundation.configuration.tables.read_config` does.

    Args:
        use: the job.
        path: TOML file.
        overrides: `section.key=value`.

    Raises:
        ConfigError: it cannot be read, or is another kind of file: which kind, and what to do with it.
    """
    if told := _by_its_path(path):
        raise ConfigError(f"{path}: {told}")
    try:
        table = read_config(path, overrides)
    except ConfigError:
        if path.is_file() and (told := _calibration(path)):
            raise ConfigError(f"{path}: {told}") from None
        raise
    if set(table) - _sections(use) - {"job"} and (told := _by_its_sections(use, table, path)):
        raise ConfigError(f"{path}: {told}")
    return table


def _by_its_path(path: Path) -> str:
    if path.is_dir() and (path / CONFIG).is_file():
        return f"the folder of a result, expected a configuration; its own is {path / CONFIG}"
    if path.is_dir():
        return f"a folder, expected a configuration: `bodytrack init {path}` writes one for the videos in it"
    if path.is_file() and path.suffix.lower() in VIDEOS | PICTURES:
        kind = "a video" if path.suffix.lower() in VIDEOS else "a picture"
        return f"{kind}, expected a configuration: `bodytrack init {path.parent}` writes one for all views there"
    return ""


def _by_its_sections(use: str, table: Table, path: Path) -> str:
    for program, sections in _PROGRAMS.items():
        if sections <= set(table):
            return f"{program}, expected a configuration of bodytrack: {_DRAFT}"
    others = sorted(set(available("jobs")) - {use}, key=lambda other: (other not in _COMMANDS, other))
    other = next((other for other in others if set(table) <= _sections(other) | {"job"}), None)
    if other is not None:
        return f"the configuration of another command: `bodytrack {_command(other, table)} {path}`"
    if "segments" in table:
        return f'a body model, expected a configuration: name it there, persons = [{{ model = "{path}" }}]; {_DRAFT}'
    return _calibration(path)


def _calibration(path: Path) -> str:
    """Message about a calibration; None for other files."""
    with contextlib.suppress(CalibrationError):
        n_cameras = len(read_rig(path).rig)
        cameras = "a camera" if n_cameras == 1 else f"{n_cameras} cameras"
        return f"a calibration of {cameras}, expected a configuration: `bodytrack init VIDEOS --rig {path}` writes one"
    return ""


def _command(use: str, table: Table) -> str:
    calibration: Any = table.get("calibration")
    kind = calibration.get("use") if isinstance(calibration, dict) else None
    of_kind = f" {_CALIBRATIONS.get(str(kind), 'chessboard')}" if use == "calibrate" else ""
    return _COMMANDS.get(use, use.partition("_")[0]) + of_kind


def _sections(use: str) -> set[str]:
    """The sections and keys of a job, and of the jobs that its command chooses."""
    jobs = [name for name in available("jobs") if name == use or name.startswith(f"{use}_")]
    return {field.name for name in jobs for field in dataclasses.fields(find("jobs", name))}
