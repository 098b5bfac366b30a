"""Configuration: components from TOML tables and back."""

from __future__ import annotations

import dataclasses
import itertools
import os
import re
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pydantic

from tracker.foundation.configuration.components import ReadBy, RelativePath, available, find, stage_of
from tracker.foundation.errors import ConfigError, ModelError, nearest
from tracker.foundation.source_files import toml_of


def component_stage(kind: Any) -> str | None:
    """The stage whose contract, or whose component, is a field's type; None for plain values."""
    module = getattr(kind, "__module__", "")
    if not isinstance(kind, type) or not module.startswith("tracker."):
        return None
    if getattr(kind, "_is_protocol", False) or "__pydantic_config__" in vars(kind):
        return stage_of(module)
    return None


def path_mark(kind: Any) -> RelativePath | None:
    """Function that resolves a field's path; None for fields without paths."""
    marks = (mark for mark in getattr(kind, "__metadata__", ()) if isinstance(mark, RelativePath))
    inner = (path_mark(argument) for argument in typing.get_args(kind))
    return next(marks, None) or next((mark for mark in inner if mark is not None), None)


def entries_of(kind: Any) -> Any:
    """X of tuple[X, ...] and of tuple[X, ...] | None; None for other types."""
    told = [option for option in options_of(kind) if option is not type(None)]
    arguments = typing.get_args(told[0]) if len(told) == 1 and typing.get_origin(told[0]) is tuple else ()
    return arguments[0] if arguments[1:] == (Ellipsis,) else None


def named_of(kind: Any) -> Any:
    """X of dict[str, X], also in a union, if X is a component or a path; None for other types."""
    for option in options_of(kind):
        inner = typing.get_args(option)[1:] if typing.get_origin(option) is dict else ()
        if inner and (component_stage(inner[0]) is not None or path_mark(inner[0]) is not None):
            return inner[0]
    return None


def options_of(kind: Any) -> tuple[Any, ...]:
    """The types of a union, or the type itself."""
    return typing.get_args(kind) if typing.get_origin(kind) in (typing.Union, types.UnionType) else (kind,)


# Configuration files: TOML tables, and changes to them by `section.key=value`.

Table = dict[str, Any]


def read_config(path: Path, overrides: Sequence[str] = ()) -> Table:
    """Reads a configuration file and applies overrides.

    Args:
        path: TOML file.
        overrides: `section.key=value`, the value in TOML syntax; a bare word is a string.

    Raises:
        ConfigError: the file cannot be read, or an override is not `key=value`.
    """
    table = toml_of(path, ConfigError, "the configuration")
    override_table(table, overrides)
    return table


def override_table(table: Table, overrides: Sequence[str]) -> None:
    """Changes a table by `--set`: `section.key=value`; entries of lists go by number, `persons.0.model=human`.

    Raises:
        ConfigError: an override is not `key=value`, or its section or entry does not exist.
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
    """Index of a list in an override."""
    if not number.isdecimal() or int(number) >= len(entries):
        most = len(entries) - 1
        raise ConfigError(f'--set {override}: "{number}", expected the number of an entry, from 0 on, at most {most}')
    return int(number)


def build(stage: str, table: Mapping[str, Any], where: str, folder: Path, default: str | None = None) -> Any:
    """Makes the component of a section.

    Args:
        stage: folder of the component.
        table: `use` names the component, the other keys are its fields.
        where: file and section for messages, e.g. `run.toml [reading]`.
        folder: where relative paths start.
        default: component without `use`.

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
    """Makes a component of a known class from its fields; see `build`.

    Keys are only checked here: sections of a job, fields of a component, entries of a list.
    """
    kinds = typing.get_type_hints(cls, include_extras=True)
    defaults = {field.name: _default(cls, field.name) for field in dataclasses.fields(cls)}
    values: Table = {}
    for key, value in table.items():
        if key not in defaults:
            kind = "section" if isinstance(value, dict) else "key"
            raise ConfigError(f'{where}: unknown {kind} "{key}"; {nearest(key, defaults)}')
        inner = f"{where} {key}" if where.endswith("]") or "] " in where else f"{where} [{key}]"
        values[key] = _value(kinds[key], _over_default(value, defaults[key]), inner, folder)
    try:
        return cls(**values)
    except pydantic.ValidationError as error:
        raise ConfigError(f"{where}: {_first_fault(cls, error)}") from error


def _default(cls: type[Any], key: str) -> Any:
    """The default of a component's field; another object if it has none."""
    field = getattr(cls, "__pydantic_fields__", {}).get(key)
    return None if field is None else field.get_default(call_default_factory=True)


def _over_default(value: Any, default: Any) -> Any:
    """The table of a nested component, completed with the field's own default.

    A table with another component starts from that component's defaults.
    """
    if not isinstance(value, dict) or not dataclasses.is_dataclass(default) or isinstance(default, type):
        return value
    usual = describe(default)
    return {**usual, **value} if value.get("use", usual["use"]) == usual["use"] else value


def _first_fault(cls: type[Any], error: pydantic.ValidationError) -> str:
    fault = error.errors()[0]
    if not fault["loc"]:
        return fault["msg"].removeprefix("Value error, ")
    field = getattr(cls, "__pydantic_fields__")[str(fault["loc"][0])]  # noqa: B009
    one_of_several = len(set(options_of(field.annotation)) - {types.NoneType}) > 1
    key = ".".join(str(step) for step in (fault["loc"][:1] if one_of_several else fault["loc"]))
    if fault["type"] in ("missing", "missing_argument", "missing_keyword_only_argument"):
        return f'the key "{key}" is missing' + (
            f", expected e.g. {key} = {field.examples[0]}" if field.examples else ""
        )
    if fault["type"] == "value_error":
        return f"[{key}]: {fault['msg'].removeprefix('Value error, ')}"
    told = [other["msg"] for other in error.errors() if one_of_several and other["loc"][:1] == fault["loc"][:1]]
    expected = " or ".join(dict.fromkeys(_as_expected(text) for text in told or [fault["msg"]]))
    meaning = " ".join((field.description or "").split())
    message = f"{key} = {fault['input']!r}: {expected}"
    return f"{message} ({meaning[0].lower()}{meaning[1:].rstrip('.')})" if meaning else message


def _as_expected(message: str) -> str:
    """A validator's sentence in this program's words."""
    asked = message.removeprefix("Input should be ")
    return f"expected {asked}" if asked != message else f"{message[0].lower()}{message[1:]}"


def _value(kind: Any, value: Any, where: str, folder: Path) -> Any:
    """A TOML value in the field's type: components built, lists as tuples, paths made absolute."""
    for mark in getattr(kind, "__metadata__", ()):
        if isinstance(mark, ReadBy):
            return mark.function(value, where, folder)
    entries = entries_of(kind)
    if entries is not None:
        if not isinstance(value, (list, tuple)):
            raise ConfigError(f"{where}: expected a list, found {value!r}")
        numbered = (f"{where[:-1]} {k}]" if where.endswith("]") else f"{where} {k}" for k in itertools.count(1))
        return tuple(_value(entries, entry, next(numbered), folder) for entry in value)
    named = named_of(kind)
    if named is not None and isinstance(value, dict):
        label = f"{where[:-1]}." if where.endswith("]") else f"{where} "
        end = "]" if where.endswith("]") else ""
        return {name: _value(named, entry, f"{label}{name}{end}", folder) for name, entry in value.items()}
    for option in options_of(kind):
        if component_stage(option) is not None:
            return _component(option, value, where, folder)
    path = path_mark(kind)
    if path is not None and isinstance(value, str):
        try:
            return path.resolved(expanded(value, where), folder)
        except ModelError as error:
            raise ConfigError(f"{where}: {error}") from error
    return _tuples(value)


def _component(kind: type[Any], value: Any, where: str, folder: Path) -> Any:
    """The component of a table, or of a name alone."""
    chosen, stage = not dataclasses.is_dataclass(kind), component_stage(kind) or ""
    if chosen and isinstance(value, str):
        value = {"use": value}
    if not isinstance(value, dict):
        hint = f'like {{ use = "{available(stage)[0]}" }}' if chosen else "of its fields"
        raise ConfigError(f"{where}: expected a table {hint}, found {value!r}")
    if chosen:
        return build(stage, value, where, folder)
    return build_class(kind, {key: v for key, v in value.items() if key != "use"}, where, folder)


def _tuples(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_tuples(entry) for entry in value)
    if isinstance(value, dict):
        return {key: _tuples(entry) for key, entry in value.items()}
    return value


def expanded(text: str, where: str) -> str:
    """A path with `${NAME}` replaced by environment variables.

    Raises:
        ConfigError: the variable is not set.
    """

    def variable(match: re.Match[str]) -> str:
        name = match[1]
        if name not in os.environ:
            raise ConfigError(f"{where}: the environment variable {name} is not set; set it to the folder meant")
        return os.environ[name]

    return re.sub(r"\$\{(\w+)\}", variable, text)


def component_name(cls: type[Any]) -> str:
    """A component's name in `use`: its file, or `package.module:Class` outside the package."""
    inside = cls.__module__.startswith("tracker.")
    return cls.__module__.rpartition(".")[2] if inside else f"{cls.__module__}:{cls.__qualname__}"


def describe(component: Any) -> Table:
    """The resolved configuration of a component: `use` and all fields; `build` makes an equal component of it."""
    return {"use": component_name(type(component)), **described_fields(component)}


def described_fields(component: Any) -> Table:
    """All fields of a component, without its name; None, which TOML lacks, is left out."""
    kinds = typing.get_type_hints(type(component), include_extras=True)
    table = {
        field.name: _described(getattr(component, field.name), kinds[field.name])
        for field in dataclasses.fields(component)
    }
    return {key: value for key, value in table.items() if value is not None}


def _described(value: Any, kind: Any) -> Any:
    for mark in getattr(kind, "__metadata__", ()):
        if isinstance(mark, ReadBy):
            return mark.described(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        # where the type is a class there is nothing to choose, and so nothing to name
        return described_fields(value) if type(value) in options_of(kind) else describe(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (tuple, list)):
        return [_described(entry, entries_of(kind)) for entry in value]
    if isinstance(value, dict):
        return {key: _described(entry, named_of(kind)) for key, entry in value.items()}
    return value
