"""Components made from the shortest configuration that describes them."""

from __future__ import annotations

import typing
from pathlib import Path
from typing import Any

import pytest

from tracker.foundation.configuration.components import available, find
from tracker.foundation.configuration.tables import build

GIVEN: dict[tuple[str, str], dict[str, Any]] = {}
"""Fields of components that need files which a test has made."""


def minimal(stage: str, use: str) -> dict[str, Any]:
    """The shortest section that describes a component: only what has no default, pointing at nothing."""
    table: dict[str, Any] = {"use": use}
    types = typing.get_type_hints(find(stage, use))
    for name, field in find(stage, use).__pydantic_fields__.items():
        if field.is_required():
            values = {str: "absent/{view}/{frame}.png", Path: "absent.toml", float: 25.0, int: 25}
            values[str | dict[str, str]] = values[str]
            table[name] = 0.25 if name.endswith("_m") else values[types[name]]
    return table | GIVEN.get((stage, use), {})


def made(stage: str, use: str, **fields: Any) -> Any:
    return build(stage, {**minimal(stage, use), **fields}, f"test.toml [{stage}]", Path("/nowhere"))


def each(stage: str) -> pytest.MarkDecorator:
    """Runs a test with every component of a stage."""
    return pytest.mark.parametrize("use", available(stage))
