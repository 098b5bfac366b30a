"""What the type of a component's field says of its values: components, lists or tables of them, or paths."""

from __future__ import annotations

import types
import typing
from typing import Any

from tracker.foundation.configuration.components import RelativePath, stage_of


def component_stage(kind: Any) -> str | None:
    """The stage whose contract, or whose component, a field is typed with; None for plain values."""
    module = getattr(kind, "__module__", "")
    if not isinstance(kind, type) or not module.startswith("tracker."):
        return None
    if getattr(kind, "_is_protocol", False) or "__pydantic_config__" in vars(kind):
        return stage_of(module)
    return None


def path_mark(kind: Any) -> RelativePath | None:
    """How a field's path is resolved; None for fields that hold none."""
    marks = (mark for mark in getattr(kind, "__metadata__", ()) if isinstance(mark, RelativePath))
    inner = (path_mark(argument) for argument in typing.get_args(kind))
    return next(marks, None) or next((mark for mark in inner if mark is not None), None)


def entries_of(kind: Any) -> Any:
    """X of tuple[X, ...] and of tuple[X, ...] | None; None for other types."""
    told = [option for option in options_of(kind) if option is not type(None)]
    arguments = typing.get_args(told[0]) if len(told) == 1 and typing.get_origin(told[0]) is tuple else ()
    return arguments[0] if arguments[1:] == (Ellipsis,) else None


def named_of(kind: Any) -> Any:
    """X of dict[str, X], also as one of several types, where X is a component or a path; None for other types."""
    for option in options_of(kind):
        inner = typing.get_args(option)[1:] if typing.get_origin(option) is dict else ()
        if inner and (component_stage(inner[0]) is not None or path_mark(inner[0]) is not None):
            return inner[0]
    return None


def options_of(kind: Any) -> tuple[Any, ...]:
    """The types of a union, or the type itself."""
    return typing.get_args(kind) if typing.get_origin(kind) in (typing.Union, types.UnionType) else (kind,)
