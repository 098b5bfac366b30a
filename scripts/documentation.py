"""The pages of every setting and of the Python interface, made of the code as the site is built: a hook of MkDocs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tracker
from tracker.bodies.body import BodyModel
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.configuration.components import available, contract, find, stages
from tracker.foundation.configuration.tables import component_name, component_stage
from tracker.results.evaluation.comparison import Evaluation
from tracker.running.programs import Simulated
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Adds to two pages what the code says; called by MkDocs."""
    made = {"configuration.md": configuration_tables, "reference.md": reference_entries}.get(page.file.src_uri)
    return f"{markdown}\n{made()}" if made else markdown


def configuration_tables() -> str:
    """Every component with its fields, Markdown."""
    parts = ["## Jobs\n"]
    for use in available("jobs"):
        parts += _component(find("jobs", use), f"`{use}`")
    for stage in stages():
        parts.append(f"## {stage}\n")
        for use in available(stage):
            parts += _component(find(stage, use), f'{stage}: `use = "{use}"`')
    return "\n".join(parts)


def reference_entries() -> str:
    """Where mkdocstrings puts the documentation of a name, a line each."""
    offered = (getattr(tracker, name) for name in dir(tracker))
    public = [one for one in offered if getattr(one, "__module__", "").startswith("tracker.")]
    parts = ["## What `tracker` offers\n", *map(_entry, public)]
    parts += [
        "## What results are made of\n",
        *map(_entry, (Rig, Camera, BodyModel, Step, Estimate, Evaluation, Simulated)),
    ]
    parts += ["## Contracts of components\n", *(_entry(contract(stage)) for stage in stages())]
    return "\n".join(parts)


def _entry(public: Any) -> str:
    return f"::: {public.__module__}.{public.__qualname__}\n"


def _component(cls: Any, title: str) -> Iterator[str]:
    """Heading, documentation and fields of a component, then those of the sections that are no components."""
    yield f"### {title}\n"
    yield _prose(cls.__doc__)
    yield from _fields(cls)
    for name, section in _sections(cls):
        yield f"#### {title}: {name}\n"
        yield _prose(section.__doc__)
        yield from _fields(section)


def _fields(cls: Any) -> Iterator[str]:
    if not cls.__pydantic_fields__:
        yield "No settings.\n"
        return
    yield "| field | default | meaning |\n|---|---|---|"
    for name, field in cls.__pydantic_fields__.items():
        default = "required" if field.is_required() else f"`{_shown(field.get_default(call_default_factory=True))}`"
        meaning = " ".join(filter(None, (_cell(field.description or ""), _range(field))))
        yield f"| `{name}` | {_cell(default)} | {meaning} |"
    yield ""


def _range(field: Any) -> str:
    """What values may be, as far as bounds tell."""
    words = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
    bounds = [f"{word} {value:g}" for one in field.metadata for key, word in words.items()
              if isinstance(value := getattr(one, key, None), int | float)]  # fmt: skip
    return f"({', '.join(bounds)})" if bounds else ""


def _sections(cls: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Fields whose values are tables of fields, but no components of a stage; each followed by those in it, dotted."""
    for name, field in cls.__pydantic_fields__.items():
        for kind in _kinds(field.annotation):
            if hasattr(kind, "__pydantic_fields__") and not _is_choice(kind):
                yield f"{before}{name}", kind
                yield from _sections(kind, f"{before}{name}.")


def _kinds(annotation: Any) -> Iterator[Any]:
    yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _kinds(inner)


def _shown(value: Any) -> str:
    """A value as TOML would have it; `none` where there is no value, which TOML cannot say."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_shown, value))}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_shown(one)}' for key, one in value.items())} }}" if value else "{}"
    if _is_choice(type(value)):
        return f'{{ use = "{component_name(type(value))}" }}'
    if hasattr(value, "__pydantic_fields__"):
        return "{ ... }"
    if value is None or isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Path):
        return f'"{value.stem}"'
    return f"{value:.6g}" if isinstance(value, float) else f'"{value}"' if isinstance(value, str) else str(value)


def _is_choice(kind: Any) -> bool:
    """Whether a class is a component that `use` chooses, not a section of its own."""
    stage = component_stage(kind)
    return stage in stages() and component_name(kind) in available(stage)


def _prose(docstring: str | None) -> str:
    """A docstring as Markdown: its lines joined to paragraphs."""
    text = re.sub(r"\n[ \t]+", "\n", docstring or "").strip()
    return "\n\n".join(_escaped(" ".join(part.split())) for part in text.split("\n\n")) + "\n"


def _cell(text: str) -> str:
    return _escaped(" ".join(text.split())).replace("|", "\\|")


def _escaped(text: str) -> str:
    """Square brackets and stars are no links and no emphasis, outside of code."""
    pieces = re.split(r"(`[^`]*`)", text)
    return "".join(piece if k % 2 else re.sub(r"([\[\]*<])", r"\\\1", piece) for k, piece in enumerate(pieces))
