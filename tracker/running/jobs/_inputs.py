"""What a job reads, as fingerprints: whoever resumes one must find the same."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import re
import tomllib
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tracker.foundation.configuration.tables import entries_of, named_of, path_mark
from tracker.foundation.errors import ConfigError

INPUTS = "inputs.json"
"""Fingerprints of what a result was made from, beside it."""

_BLOCK, _N_BLOCKS = 2**16, 64
"""Of a file larger than 4 MiB so many blocks are read, evenly spread: an hour of video takes milliseconds."""

Fingerprints = dict[str, str]
"""Path -> size and SHA-256."""


def fingerprints(job: Any, views: tuple[str, ...]) -> Fingerprints:
    """Size and SHA-256 of every input file that a job's fields name.

    Of a folder of numbered files these are the first, second, third, fifth, ninth, ...: a recording may grow, and
    hashing each of 100 000 pictures would take longer than looking at some.

    Args:
        job: a component; its fields that are paths are looked at, those of its components too.
        views: names that `{view}` stands for.
    """
    files = (file for text in _paths(job) for file in _files(text, views))
    files = (one for file in files for one in (file, *_skin_of(file)))
    return {str(file): _fingerprint(file) for file in dict.fromkeys(files)}


def _skin_of(path: Path) -> Iterator[Path]:
    """The files of the skin, if that is a model file that has one."""
    if path.suffix != ".toml":
        return
    with contextlib.suppress(OSError, ValueError):
        skin = tomllib.loads(path.read_text(encoding="utf-8")).get("skin")
        named = skin if isinstance(skin, dict) else {}
        files = (path.parent / str(named[name]) for name in ("surface", "weights") if named.get(name))
        yield from (file for file in files if file.is_file())


def check_inputs(folder: Path, now: Mapping[str, str]) -> None:
    """Compares fingerprints with those of a result's beginning; inputs that came later do not matter.

    Args:
        folder: the result.
        now: its inputs as they are.

    Raises:
        ConfigError: names the first input that is another one or gone, or tells that the file of them is damaged.
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
    """Those at the places 0, 1, 2, 4, 8, ...: the same ones after others were added behind them."""
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
