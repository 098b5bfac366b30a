"""`bodytrack show`: the components, their fields, and the sections of the jobs."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.table import Table

from tracker.commands.terminal import console


def show(
    stage: Annotated[str | None, typer.Argument(help="A stage, or `jobs` for the sections of each.")] = None,
) -> None:
    """Lists the components of the stages, or the fields of one stage's components."""
    from tracker.components import available, find, stages
    from tracker.errors import ConfigError, nearest

    shown = ("jobs", *stages())
    if stage is None:
        table = Table("stage", "component", "what it is", title="components")
        for name in shown:
            for use in available(name):
                table.add_row(name, use, (find(name, use).__doc__ or "").split("\n")[0])
        console.print(table)
        return
    if stage not in shown:
        raise ConfigError(f'no stage "{stage}"; {nearest(stage, shown)}')
    for use in available(stage):
        console.print(_component_table(stage, use))


def _component_table(stage: str, use: str) -> Table:
    from tracker.components import find

    cls: Any = find(stage, use)
    title = use if stage == "jobs" else f'[{stage}] use = "{use}"'
    table = Table("field", "default", "meaning", title=title, title_justify="left")
    for name, field in cls.__pydantic_fields__.items():
        default = "required" if field.is_required() else _shown(field.get_default(call_default_factory=True), field)
        table.add_row(name, default, (field.description or "").replace("\n", " "))
    return table


def _shown(value: Any, field: Any = None) -> str:
    from tracker.config import component_name
    from tracker.field_types import component_stage

    if isinstance(value, tuple):
        return f"[{', '.join(map(_shown, value))}]"
    if component_stage(type(value)) is not None:
        if field is not None and field.annotation is type(value):
            return "{ ... }"  # a section of its own fields: there is nothing to choose
        return f'{{ use = "{component_name(type(value))}", ... }}'
    return str(value)
