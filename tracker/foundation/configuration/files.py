"""Configuration files: TOML tables, and changes to them by `section.key=value`."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tracker.foundation.errors import ConfigError
from tracker.foundation.source_files import toml_of

Table = dict[str, Any]


def read_config(path: Path, overrides: Sequence[str] = ()) -> Table:
    """Reads a configuration file and applies overrides.

    Args:
        path: TOML file.
        overrides: `section.key=value`, the value in TOML syntax; a bare word is taken as a string.

    Raises:
        ConfigError: the file cannot be read, or an override is no `key=value`.
    """
    table = toml_of(path, ConfigError, "the configuration")
    override_table(table, overrides)
    return table


def override_table(table: Table, overrides: Sequence[str]) -> None:
    """Changes a table as `--set` asks for: `section.key=value`; entries of lists go by number, `persons.0.model=human`.

    Raises:
        ConfigError: an override is no `key=value`, or its section or entry is none.
    """
    for override in overrides:
        keys, sign, text = override.partition("=")
        if not sign or not keys.strip():
            raise ConfigError(f'--set {override}: expected section.key=value, e.g. "estimation.step_deg=3"')
        *sections, key = keys.strip().split(".")
        place: Any = table
        for section in sections:
            place = (
                place.setdefault(section, {}) if isinstance(place, dict) else place[_entry(place, section, override)]
            )
            if not isinstance(place, dict | list):
                raise ConfigError(f'--set {override}: "{section}" is a value, not a section')
        try:
            read = tomllib.loads(f"value = {text}")
        except (ValueError, RecursionError):
            read = {"value": text.strip()}
        if len(read) > 1:
            raise ConfigError(f"--set {override}: expected one value")
        place[key if isinstance(place, dict) else _entry(place, key, override)] = read["value"]


def _entry(entries: list[Any], number: str, override: str) -> int:
    """The place in a list that an override names."""
    if not number.isdecimal() or int(number) >= len(entries):
        most = len(entries) - 1
        raise ConfigError(f'--set {override}: "{number}", expected the number of an entry, from 0 on, at most {most}')
    return int(number)
