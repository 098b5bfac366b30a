"""JSON schemas of configurations and of other TOML files, for editors: draft 7, for Taplo and others."""

from __future__ import annotations

import copy
import dataclasses
import typing
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, models_json_schema

from tracker.foundation.configuration.components import ModelName, ReadBy, available, find
from tracker.foundation.configuration.tables import component_name, component_stage, entries_of, options_of, path_mark
from tracker.foundation.errors import ConfigError
from tracker.foundation.resources import models_folder
from tracker.foundation.source_files import json_of

Schema = dict[str, Any]

SCHEMA = "bodytrack.schema.json"
"""File beside the configurations that `bodytrack init` writes; their first line names it."""

_TITLE = "bodytrack: "
"""Title of this program's schemas."""

_DIALECT = "http://json-schema.org/draft-07/schema#"
_REFERENCE = "#/definitions/{model}"
_FOREIGN = ":"
"""Character in the name of a component from outside the package, `my_lab.module:Class`: its fields are unknown to a
schema."""

_STAGE = "x-stage"
"""Stands for a component of a stage until `_Writer` lists its components."""


class _Generator(GenerateJsonSchema):
    """Pydantic's schemas, adapted to TOML, which has no null, and to contracts in place of classes."""

    schema_dialect = _DIALECT
    ignored_warning_kinds = {"skipped-choice", "non-serializable-default"}  # noqa: RUF012 - as the base class has it

    def is_instance_schema(self, schema: Any) -> Schema:
        stage = component_stage(schema["cls"])
        return {_STAGE: stage} if stage else {}

    def nullable_schema(self, schema: Any) -> Schema:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: Any) -> Schema:
        found = super().default_schema(schema)
        if found.get("default", ...) is None:
            del found["default"]
        return found

    def tuple_schema(self, schema: Any) -> Schema:
        found = super().tuple_schema(schema)
        if "prefixItems" in found:
            found["items"] = found.pop("prefixItems")
        return found


def schema_of_job(use: str) -> Schema:
    """The schema of a job's configuration: sections, components and their fields.

    A configuration that it accepts may still fail to load: files may be missing, fields may exclude each other.

    Args:
        use: the job, a file in `tracker/running/jobs/`.

    Raises:
        ConfigError: there is no such job.
    """
    return _Writer(find("jobs", use)).written(use)


def schema_of_table(kind: type[Any], title: str) -> Schema:
    """The schema of a TOML file that a pydantic model describes, a body model for instance."""
    _, found = models_json_schema([(kind, "validation")], schema_generator=_Generator, ref_template=_REFERENCE)
    definitions = found.get("$defs", {})
    return _whole(definitions.pop(kind.__name__) | {"title": title}, definitions)


def is_schema(path: Path) -> bool:
    """Whether a file is a schema of this program."""
    try:
        told = json_of(path, ConfigError)
    except ConfigError:
        return False
    return isinstance(told, dict) and str(told.get("title", "")).startswith(_TITLE)


def _whole(root: Schema, definitions: Mapping[str, Schema]) -> Schema:
    """A schema with all definitions that it needs."""
    needed: dict[str, Schema] = {}
    waiting = list(_named(root))
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed[name] = definitions[name]
            waiting += _named(definitions[name])
    return {
        "$schema": _DIALECT,
        **root,
        "title": f"{_TITLE}{root['title']}",
        "definitions": dict(sorted(needed.items())),
    }


def _named(schema: Any) -> Iterable[str]:
    """Names of the definitions that a schema uses directly."""
    for key, value in _pairs(schema):
        if key == "$ref":
            yield value.rpartition("/")[2]


def _pairs(value: Any) -> Iterable[tuple[str, Any]]:
    """All keys with their values, at any depth."""
    if isinstance(value, dict):
        yield from value.items()
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _pairs(inner)


def _reference(name: str) -> Schema:
    return {"$ref": _REFERENCE.format(model=name)}


class _Writer:
    """Writes the schema of a job: gathers the classes of its fields, and lists the components."""

    def __init__(self, job: type[Any]) -> None:
        self._job = job
        self._stages: dict[str, dict[str, type[Any] | None]] = {}
        self._references, self._plain = self._gathered()

    def written(self, use: str) -> Schema:
        """The schema."""
        self._definitions = {name: self._resolved(schema) for name, schema in self._plain.items()}
        self._definitions |= {self._name_of(cls): self._fields(cls) for cls in self._classes()}
        for stage, components in self._stages.items():
            self._define(stage, components)
        root = self._fields(self._job)
        root["properties"]["job"] = {"const": use, "description": "What is configured."}
        root["title"] = f"configuration of the job {use}"
        return _whole(root, self._definitions)

    def _gathered(self) -> tuple[dict[Any, Schema], dict[str, Schema]]:
        """Class -> reference to its definition; name -> definition. Finds the stages on the way."""
        while True:
            asked: Any = [(cls, "validation") for cls in self._classes()]
            made, found = models_json_schema(asked, schema_generator=_Generator, ref_template=_REFERENCE)
            plain = found["$defs"]
            new = {value for key, value in _pairs(plain) if key == _STAGE} - self._stages.keys()
            if not new:
                return {cls: reference for (cls, _), reference in made.items()}, plain
            for stage in sorted(new):
                self._stages[stage] = {use: _loadable(stage, use) for use in available(stage)}

    def _classes(self) -> list[Any]:
        components = (cls for found in self._stages.values() for cls in found.values() if cls is not None)
        return list(dict.fromkeys(inner for cls in (self._job, *components) for inner in _with_inner(cls)))

    def _name_of(self, cls: type[Any]) -> str:
        return str(self._references[cls]["$ref"]).rpartition("/")[2]

    def _fields(self, cls: type[Any]) -> Schema:
        """The table of a class's fields; those of components list the choices."""
        schema: Schema = self._resolved(self._plain[self._name_of(cls)])
        kinds = typing.get_type_hints(cls, include_extras=True)
        for name, field in cls.__pydantic_fields__.items():
            known = {"description": field.description} if field.description else {}
            if special := self._special(kinds[name], field):
                schema["properties"][name] = {**known, **special}
        return schema

    def _special(self, kind: Any, field: Any) -> Schema | None:
        """Schema of a field where pydantic has none; None elsewhere."""
        if any(isinstance(mark, ReadBy) for mark in getattr(kind, "__metadata__", ())):
            return self._chosen(component_stage(entries_of(typing.get_args(kind)[0])) or "")
        stages = [stage for option in options_of(kind) if _is_contract(option) and (stage := component_stage(option))]
        if stages:
            default = field.get_default(call_default_factory=True)
            chosen = component_name(type(default)) if dataclasses.is_dataclass(default) else None
            return self._component(stages[0], chosen)
        if isinstance(path_mark(kind), ModelName) and entries_of(kind) is None:
            return {
                "type": "string",
                **_one_of(sorted(path.stem for path in models_folder().glob("*.toml")), r"\.toml$"),
            }
        return None

    def _resolved(self, schema: Any) -> Any:
        """A copy with the components listed."""
        if isinstance(schema, list):
            return [self._resolved(entry) for entry in schema]
        if not isinstance(schema, dict):
            return copy.copy(schema)
        if _STAGE in schema:
            return self._component(schema[_STAGE], None)
        return {key: self._resolved(value) for key, value in schema.items()}

    def _component(self, stage: str, usual: str | None) -> Schema:
        """A component's name, or its table; without `use` it is the default.

        Editors offer the `anyOf`, whose last entry accepts all; `if` and `else` check, so that a message names only the
        one component concerned.
        """
        names = list(self._stages[stage])
        nameless = _reference(f"{stage}.{usual}.usual") if usual in names else {"type": "object", "required": ["use"]}
        return {
            "anyOf": [{"enum": names}, *(_reference(f"{stage}.{name}") for name in names), {}],
            "if": {"type": "string"},
            "then": _one_of(names, _FOREIGN),
            "else": {"if": {"required": ["use"]}, "then": _reference(stage), "else": nameless},
        }

    def _define(self, stage: str, components: dict[str, type[Any] | None]) -> None:
        """Definitions of a stage's components, and of the one that `use` names."""
        names = list(components)
        chosen: Schema = {"properties": {"use": _one_of(names, _FOREIGN)}}
        for name in reversed(names):
            this = {"properties": {"use": {"const": name}}}
            chosen = {"if": this, "then": _reference(f"{stage}.{name}"), "else": chosen}
        self._definitions[stage] = chosen
        for name, cls in components.items():
            fields: Schema = self._fields(cls) if cls is not None else {"type": "object", "properties": {}}
            fields["properties"] = {"use": {"const": name}, **fields["properties"]}
            self._definitions[f"{stage}.{name}.usual"] = {k: v for k, v in fields.items() if k != "required"}
            self._definitions[f"{stage}.{name}"] = {**fields, "required": ["use", *fields.get("required", ())]}

    def _chosen(self, stage: str) -> Schema:
        """A list of components, or a table of changes to the default: true, false, or fields."""
        either = {"type": ["boolean", "object"]}
        return {
            "type": ["array", "object"],
            "items": self._component(stage, None),
            "properties": {
                use: either if cls is None else self._fields(cls) | either for use, cls in self._stages[stage].items()
            },
            "patternProperties": {_FOREIGN: either},
            "additionalProperties": False,
        }


def _one_of(names: Sequence[str], others: str) -> Schema:
    """Text that is one of some names, which editors offer and messages list, or matches a pattern."""
    return {"anyOf": [{"enum": list(names)}, {}], "pattern": f"^({'|'.join(names)})$|{others}"}


def _with_inner(cls: type[Any]) -> Iterable[type[Any]]:
    """A class of fields, and those of its fields that are tables with a class of their own, at any depth."""
    yield cls
    for kind in typing.get_type_hints(cls).values():
        for inner in _classes_in(kind):
            yield from _with_inner(inner)


def _classes_in(kind: Any) -> Iterable[type[Any]]:
    if isinstance(kind, type) and dataclasses.is_dataclass(kind) and component_stage(kind):
        yield kind
    for argument in typing.get_args(kind):
        yield from _classes_in(argument)


def _loadable(stage: str, use: str) -> type[Any] | None:
    """The component; None if it needs a package that is not installed."""
    try:
        return find(stage, use)
    except ConfigError:
        return None


def _is_contract(kind: Any) -> bool:
    """Whether a type is a stage's contract, for which a component is chosen."""
    return isinstance(kind, type) and not dataclasses.is_dataclass(kind) and component_stage(kind) is not None
