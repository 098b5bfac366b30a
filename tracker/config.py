"""Configuration: TOML tables to components and back."""

from __future__ import annotations

import dataclasses
import os
import re
import tomllib
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pydantic

from tracker.components import RelativePath, available, find
from tracker.errors import ConfigError, nearest

Table = dict[str, Any]


def read_config(path: Path, overrides: Sequence[str] = ()) -> Table:
    """Reads a configuration file and applies overrides.

    Args:
        path: TOML file.
        overrides: `section.key=value`, the value in TOML syntax; a bare word is taken as a string.

    Raises:
        ConfigError: the file cannot be read, or an override is no `key=value`.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the configuration: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not a TOML file: {error}") from error
    for override in overrides:
        _override(table, override)
    return table


def _override(table: Table, override: str) -> None:
    keys, sign, text = override.partition("=")
    if not sign or not keys.strip():
        raise ConfigError(f'--set {override}: expected section.key=value, e.g. "estimation.step_deg=3"')
    *sections, key = keys.strip().split(".")
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f'--set {override}: "{section}" is a value, not a section')
    try:
        table[key] = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        table[key] = text.strip()


def build(stage: str, table: Mapping[str, Any], where: str, folder: Path, default: str | None = None) -> Any:
    """Makes the component that a section describes.

    Args:
        stage: folder of the package the component is in.
        table: `use` names the component, the other keys are its fields.
        where: file and section for messages, e.g. `run.toml [reading]`.
        folder: where relative paths start.
        default: component used where `use` is not given.

    Raises:
        ConfigError: names file, section and key, what was found and the nearest valid name.
    """
    fields = dict(table)
    use = fields.pop("use", default)
    if not isinstance(use, str):
        raise ConfigError(f'{where}: no `use`, expected e.g. use = "{available(stage)[0]}"')
    try:
        cls = find(stage, use)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
    return build_class(cls, fields, where, folder)


def build_class(cls: type[Any], table: Mapping[str, Any], where: str, folder: Path) -> Any:
    """Makes a component of a known class from its fields; see `build`."""
    types = typing.get_type_hints(cls, include_extras=True)
    defaults = {field.name: _default(field) for field in dataclasses.fields(cls)}
    names = list(defaults)
    values: Table = {}
    for key, value in table.items():
        if key not in names:
            raise ConfigError(f'{where}: unknown key "{key}"; {nearest(key, names)}')
        values[key] = _value(types[key], _over_default(value, defaults[key]), f"{where} {key}", folder)
    try:
        return cls(**values)
    except pydantic.ValidationError as error:
        raise ConfigError(f"{where}: {_first_fault(error)}") from error


def _default(field: dataclasses.Field[Any]) -> Any:
    """The default of a component's field, MISSING if it has none."""
    return getattr(field.default, "default", field.default)


def _over_default(value: Any, default: Any) -> Any:
    """The table of a nested component with what it leaves out as the field's own default has it.

    A table that names another component starts from that one's defaults.
    """
    if not isinstance(value, dict) or not dataclasses.is_dataclass(default) or isinstance(default, type):
        return value
    usual = describe(default)
    return {**usual, **value} if value.get("use", usual["use"]) == usual["use"] else value


def _first_fault(error: pydantic.ValidationError) -> str:
    fault = error.errors()[0]
    key = ".".join(str(step) for step in fault["loc"])
    if fault["type"] in ("missing", "missing_argument", "missing_keyword_only_argument"):
        return f'the key "{key}" is missing'
    return f"{key} = {fault['input']!r}: {fault['msg'][0].lower()}{fault['msg'][1:]}"


def _value(kind: Any, value: Any, where: str, folder: Path) -> Any:
    """A TOML value as the field's type wants it: components built, lists as tuples, paths made absolute."""
    stage = component_stage(kind)
    if stage is not None:
        if not isinstance(value, dict):
            raise ConfigError(f'{where}: expected a table like {{ use = "{available(stage)[0]}" }}, found {value!r}')
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            return build_class(kind, {key: v for key, v in value.items() if key != "use"}, where, folder)
        return build(stage, value, where, folder)
    if (entries := _entries(kind)) is not None and isinstance(value, list):
        return tuple(_value(entries, entry, f"{where} {k + 1}", folder) for k, entry in enumerate(value))
    if _is_path(kind) and isinstance(value, str):
        return str(folder / expanded(value, where))
    return _tuples(value)


def _entries(kind: Any) -> Any:
    """What a field typed `tuple[X, ...]` holds, if X is a component or a contract; else None."""
    kinds = typing.get_args(kind) if typing.get_origin(kind) is tuple else ()
    return kinds[0] if len(kinds) == 2 and kinds[1] is Ellipsis and component_stage(kinds[0]) else None


def component_stage(kind: Any) -> str | None:
    """The stage whose contract, or whose component, a field is typed with; None for plain values."""
    module = getattr(kind, "__module__", "")
    if not isinstance(kind, type) or not module.startswith("tracker."):
        return None
    if getattr(kind, "_is_protocol", False) or "__pydantic_config__" in vars(kind):
        return module.split(".")[1]
    return None


def _is_path(kind: Any) -> bool:
    if any(isinstance(mark, RelativePath) for mark in getattr(kind, "__metadata__", ())):
        return True
    return any(_is_path(argument) for argument in typing.get_args(kind))


def _tuples(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_tuples(entry) for entry in value)
    if isinstance(value, dict):
        return {key: _tuples(entry) for key, entry in value.items()}
    return value


def expanded(text: str, where: str) -> str:
    """A path with `${NAME}` replaced by environment variables.

    Raises:
        ConfigError: such a variable is not set.
    """

    def variable(match: re.Match[str]) -> str:
        name = match[1]
        if name not in os.environ:
            raise ConfigError(f"{where}: the environment variable {name} is not set; set it to the folder meant")
        return os.environ[name]

    return re.sub(r"\$\{(\w+)\}", variable, text)


def describe(component: Any) -> Table:
    """The resolved configuration of a component: `use` and all fields; `build` makes an equal one of it."""
    cls = type(component)
    inside = cls.__module__.startswith("tracker.")
    use = cls.__module__.rpartition(".")[2] if inside else f"{cls.__module__}:{cls.__qualname__}"
    table: Table = {"use": use}
    for field in dataclasses.fields(component):
        value = _described(getattr(component, field.name))
        if value is not None:
            table[field.name] = value
    return table


def _described(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return describe(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (tuple, list)):
        return [_described(entry) for entry in value]
    if isinstance(value, dict):
        return {key: _described(entry) for key, entry in value.items()}
    return value
