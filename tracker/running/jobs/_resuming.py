"""Whether an interrupted job may be continued: half a result of one configuration and half of another is neither's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tracker.foundation.configuration.tables import Table, read_config
from tracker.foundation.errors import ConfigError
from tracker.running.jobs._folder import CONFIG

_END = "reading.stop"
"""The one setting that may change: a run may be extended. Its frames do not depend on those that follow, but for the
bodies fitted to the first ones, which it keeps."""


def check_same(now: Table, folder: Path) -> None:
    """Compares the configuration of a result with the one that is asked for.

    Args:
        now: the resolved configuration.
        folder: the result.

    Raises:
        ConfigError: names the first setting that is another one, or a range that ends earlier.
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
    """Whether an end, None for that of the recording, is behind another one."""
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
