"""`bodytrack init`: a first configuration."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from tracker.foundation.errors import ConfigError
from tracker.running.commands import Overwrite, console


def init(
    videos: Annotated[Path, typer.Argument(help="Folder of the videos or images, one a view.")],
    output: Annotated[Path, typer.Option(help="Configuration to write.")] = Path("run.toml"),
    rig: Annotated[Path | None, typer.Option(help="Calibration; default: looked for near the videos.")] = None,
) -> None:
    """Writes a commented run.toml for a folder of videos or images, with the cameras and plates that lie there."""
    from tracker.foundation.configuration.schema import schema_of_job
    from tracker.foundation.files import write_json, write_whole
    from tracker.running.drafts.configuration import draft

    schema = check_new_configuration(output)
    found = draft(videos, output, rig)
    write_json(schema, schema_of_job("track"))
    write_whole(output, found.text)
    for one in found.footage:
        frames = f", {one.n_frames} frames" if one.n_frames else ""
        rate = f", {one.fps:.4g} frames/s" if one.fps else ""
        console.print(f"{one.view}: {one.size[0]}x{one.size[1]} px{rate}{frames}", highlight=False)
    console.print(
        f"calibration: {found.rig or 'none'}; plates: {found.plates or 'none'}; keypoints: {found.keypoints or 'none'}",
        highlight=False,
        soft_wrap=True,
    )
    if found.world:
        console.print(found.world, highlight=False, soft_wrap=True)
    for remark in found.remarks:
        console.print(remark, style="yellow", highlight=False, soft_wrap=True)
    console.print(
        f"{output} written: set stature_m, the person's height with shoes, then `bodytrack run {output} --dry-run`",
        highlight=False,
        soft_wrap=True,
    )


def check_new_configuration(output: Path) -> Path:
    """Path of the schema of a new configuration.

    Args:
        output: the configuration.

    Raises:
        ConfigError: the configuration exists, its folder does not, or the schema would replace another file.
    """
    from tracker.foundation.configuration.schema import SCHEMA, is_schema
    from tracker.foundation.errors import ConfigError

    if output.exists():
        raise ConfigError(f"{output} is there already: choose another --output")
    if not output.resolve().parent.is_dir():
        raise ConfigError(f"{output}: no such folder; make it, or choose another --output")
    schema = output.with_name(SCHEMA)
    if schema.exists() and not is_schema(schema):
        raise ConfigError(f"{schema} is not a schema of bodytrack: choose another folder for --output")
    return schema


def show_frame(
    result: Path, frame: int, chosen: tuple[str | None, str | None], output: Path | None, overwrite: bool
) -> None:
    """Writes a PNG a view into the result's exports.

    Args:
        result: folder of a run.
        frame: its number.
        chosen: view and person; None for all views, and for the first person.
        output: folder to write to instead.
        overwrite: whether files that are there already are replaced.

    Raises:
        TrackerError: the frame, view or person does not exist, the recording is gone, or a file exists already.
    """
    from tracker.foundation.errors import nearest
    from tracker.foundation.files import check_free
    from tracker.images.film import write_picture
    from tracker.results.exports import EXPORTS
    from tracker.results.result import load_result
    from tracker.running.viewing.frame_evidence import evidence_picture, seen_in_frame

    (view, person), loaded = chosen, load_result(result)
    names = loaded.rig.names if view is None else (view,)
    if view is not None and view not in loaded.rig.names:
        raise ConfigError(f'{result}: no view is called "{view}"; {nearest(view, loaded.rig.names)}')
    who, folder = person or next(iter(loaded.bodies)), output or result / EXPORTS
    paths = {name: folder / f"frame_{frame:06d}_{who}_{name}.png" for name in names}
    check_free(paths.values(), overwrite)
    seen = seen_in_frame(loaded, frame, who)
    folder.mkdir(parents=True, exist_ok=True)
    for one in seen.views:
        if one.name in paths:
            write_picture(paths[one.name], evidence_picture(seen, one, _CELL_PX))
            left_out = "; ".join(made.title for made in one.pictures if made.picture is None)
            told = f"written: {paths[one.name]}" + (f"; left out: {left_out}" if left_out else "")
            console.print(told, highlight=False, soft_wrap=True)
    for name in names:
        if name not in {one.name for one in seen.views}:
            console.print(f"{name}: has no image in frame {frame}", highlight=False)
    if seen.differs:
        console.print(seen.differs, style="yellow", highlight=False, soft_wrap=True)


_CELL_PX = 480
"""Width of each picture in a row."""


FILES = {
    "model": "tracker.bodies.body.description:BodyDescription",
    "markers": "tracker.results.evaluation.marker_set:MarkerSet",
    "movement": "tracker.results.recognition.library:Description",
}
"""TOML files other than configurations -> the class that describes them, loaded on demand."""


def show(
    stage: Annotated[
        str | None,
        typer.Argument(help="A stage, `jobs` (the sections of each), a section such as `loss`; or `frame`."),
    ] = None,
    result: Annotated[Path | None, typer.Argument(help="For `frame`: result folder of a run.")] = None,
    schema: Annotated[
        bool,
        typer.Option("--schema", help=f"Print the JSON schema of a file: run (default), {', '.join(FILES)}, a job."),
    ] = False,
    frame: Annotated[int | None, typer.Option(help="Of `frame`: its number.")] = None,
    view: Annotated[str | None, typer.Option(help="For `frame`: one view alone.")] = None,
    person: Annotated[str | None, typer.Option(help="For `frame`: the person; default the first.")] = None,
    output: Annotated[Path | None, typer.Option(help="For `frame`: folder; default RESULT/exports.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Lists the components of the stages, or the fields of one stage's components, or of a section.

    `show frame RESULT --frame N` draws what each kind of evidence saw in a frame, a picture a view.
    """
    if stage == "frame":
        if result is None or frame is None or schema:
            raise ConfigError("show frame: expected a result and a frame: bodytrack show frame RESULT --frame 12")
        show_frame(result, frame, (view, person), output, overwrite)
        return
    _refuse_of_frame(stage, RESULT=result, frame=frame, view=view, person=person, output=output, overwrite=overwrite)
    if schema:
        console.print(json.dumps(_schema(stage or "run"), indent=1), highlight=False, soft_wrap=True)
        return
    from tracker.foundation.configuration.components import available, find, stages
    from tracker.foundation.errors import nearest

    shown = ("jobs", *stages())
    if stage is None:
        table = Table("stage", "component", "what it is", title="components")
        for name in shown:
            for use in available(name):
                table.add_row(name, use, (find(name, use).__doc__ or "").split("\n")[0])
        console.print(table)
        return
    sections = _sections()
    if stage in shown:
        for use in available(stage):
            title = use if stage == "jobs" else f'[{stage}] use = "{use}"'
            console.print(_fields_table(find(stage, use), title))
    elif stage in sections:
        for cls, jobs in sections[stage].items():
            console.print(_fields_table(cls, f"[{stage}] of {', '.join(jobs)}"))
    else:
        raise ConfigError(f'no stage or section "{stage}"; {nearest(stage, (*shown, *sections))}')


def _refuse_of_frame(stage: str | None, **options: object) -> None:
    """Refuses options of `show frame` without `frame`."""
    for name, value in options.items():
        if value not in (None, False):
            what = f'"{value}"' if name == "RESULT" else f"--{name}"
            asked = f"show {stage}" if stage else "show"
            raise ConfigError(f"{what}: {asked} has none; bodytrack show frame RESULT --frame 12 draws a frame")


def _schema(kind: str) -> dict[str, Any]:
    """The schema of a configuration, or of another file."""
    from tracker.foundation.configuration.components import available
    from tracker.foundation.configuration.schema import schema_of_job, schema_of_table
    from tracker.foundation.errors import nearest

    jobs = {use: use for use in available("jobs")} | {"run": "track"}
    if kind in jobs:
        return schema_of_job(jobs[kind])
    if kind not in FILES:
        raise ConfigError(f'no schema of "{kind}"; {nearest(kind, (*jobs, *FILES))}')
    module, _, name = FILES[kind].partition(":")
    return schema_of_table(getattr(importlib.import_module(module), name), kind)


def _sections() -> dict[str, dict[Any, list[str]]]:
    """Section -> its class, and the jobs that have it; only sections without a component to choose."""
    from tracker.foundation.configuration.components import available, find

    sections: dict[str, dict[Any, list[str]]] = {}
    for use in available("jobs"):
        cls: Any = find("jobs", use)
        for name, field in cls.__pydantic_fields__.items():
            if not field.is_required() and _is_section(field.get_default(call_default_factory=True), field):
                sections.setdefault(name, {}).setdefault(field.annotation, []).append(use)
    return sections


def _is_section(value: Any, field: Any) -> bool:
    """Whether a field is a section with fields of its own and no component to choose."""
    from tracker.foundation.configuration.tables import component_stage

    return field is not None and component_stage(type(value)) is not None and field.annotation is type(value)


def _fields_table(cls: Any, title: str) -> Table:
    table = Table("field", "default", "meaning", title=title, title_justify="left")
    for name, field in cls.__pydantic_fields__.items():
        default = "required" if field.is_required() else _shown(field.get_default(call_default_factory=True), field)
        table.add_row(name, default, (field.description or "").replace("\n", " "))
    return table


def _shown(value: Any, field: Any = None) -> str:
    from tracker.foundation.configuration.tables import component_name, component_stage

    if isinstance(value, tuple):
        return f"[{', '.join(map(_shown, value))}]"
    if _is_section(value, field):
        return "{ ... }"
    if component_stage(type(value)) is not None:
        return f'{{ use = "{component_name(type(value))}", ... }}'
    return str(value)
