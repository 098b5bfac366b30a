"""`bodytrack result evaluate`, and the table of errors."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Column, Table

from tracker.foundation.errors import ConfigError
from tracker.running.commands import Overwrite, console

if TYPE_CHECKING:
    from tracker.results.evaluation.comparison import Evaluation, PersonErrors
    from tracker.results.recognition.matching import Stretch
    from tracker.results.result import Track


def evaluate(
    result: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    truth: Annotated[Path, typer.Option(help="Table of true joints, or the folder it is in.")],
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default: the result folder.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Compares a result with a truth: joint distances, angles, silhouettes; writes evaluation.json and .png."""
    from tracker.foundation.files import check_free, replacing, write_json
    from tracker.results.evaluation.comparison import error_figure
    from tracker.results.evaluation.comparison import evaluate as compared

    folder = output or result
    values, figure = folder / "evaluation.json", folder / "evaluation.png"
    check_free((values, figure), overwrite)
    evaluation = compared(result, truth)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(values, evaluation.as_dict())
    with replacing(figure) as picture:
        error_figure(evaluation).savefig(picture, dpi=110)
    print_evaluation(evaluation)


def print_evaluation(evaluation: Evaluation) -> None:
    """A table of each person's errors, the important ones first, and the overlap of the silhouettes."""
    table = Table(title="errors against the truth", title_justify="left")
    table.add_column("")
    for person in evaluation.persons:
        table.add_column(_heading(person, evaluation), justify="right")
    for rows in (_headline(evaluation), _joint_rows(evaluation), _details(evaluation)):
        for name, values in rows:
            table.add_row(name, *values)
        table.add_section()
    console.print(table)
    _tell_crossed(evaluation)
    for whose, names in (("run", evaluation.left_out), ("truth", evaluation.truths_left_out)):
        if names:
            console.print(f"compared with nobody: {', '.join(names)} of the {whose}", highlight=False, soft_wrap=True)
    for person in evaluation.persons:
        _tell_incomplete(person)
    if evaluation.silhouette_iou:
        views = ", ".join(f"{view} {value:.3f}" for view, value in evaluation.silhouette_iou.items())
        mean = sum(evaluation.silhouette_iou.values()) / len(evaluation.silhouette_iou)
        console.print(f"silhouette IoU {mean:.3f} ({views})", highlight=False)


def _heading(person: PersonErrors, evaluation: Evaluation) -> str:
    """The person of the run, and the person of the truth; a truth without names gives none."""
    unnamed = len(evaluation.persons) == 1 and person.truth == "1"
    return person.person if unnamed or person.truth == person.person else f"{person.person} (truth: {person.truth})"


def _tell_crossed(evaluation: Evaluation) -> None:
    """A warning if persons are paired by distance and their names differ."""
    names = {person.person for person in evaluation.persons}
    crossed = [one for one in evaluation.persons if one.truth != one.person and one.truth in names]
    if crossed:
        pairs = ", ".join(f"{one.person} of the run with {one.truth} of the truth" for one in crossed)
        console.print(f"persons are paired by distance, not by name: {pairs}", highlight=False, soft_wrap=True)


def _headline(evaluation: Evaluation) -> list[tuple[str, list[str]]]:
    """Errors of joints and angles, and the number of frames."""
    persons = evaluation.persons
    rows = [
        ("joint distance, mean", [_mm(p.mean_mm) for p in persons]),
        ("mean, joint offsets removed", [_mm(p.mean_offset_removed_mm) for p in persons]),
    ]
    if any(math.isfinite(person.mean_trunk_offset_removed_mm) for person in persons):
        rows.append(("mean, removed as the trunk turns", [_mm(p.mean_trunk_offset_removed_mm) for p in persons]))
    if any(person.parameters for person in persons):
        rows.append(("joint angles, RMS", [f"{p.angles_rms_deg:.2f} deg" if p.parameters else "-" for p in persons]))
    for hinge in dict.fromkeys(hinge for person in persons for hinge in person.hinges_deg):
        rows.append((f"{hinge.replace('_', ' ')}, RMS (offset removed; sigma)", [_hinge(p, hinge) for p in persons]))
    rows.append(("frames lost", [f"{p.n_missing} of {p.n_frames}" for p in persons]))
    return rows


def _joint_rows(evaluation: Evaluation) -> list[tuple[str, list[str]]]:
    persons = evaluation.persons
    names = sorted({name for person in persons for name in person.joints_mm})
    rows = [(f"{name.replace('_', ' ')} (offset removed; sigma)", [_joint(p, name) for p in persons]) for name in names]
    if any(person.joint_sigmas_mm for person in persons):
        rows.append(("joints, error over sigma", [_ratio(person.over_sigma()) for person in persons]))
    return rows


def _details(evaluation: Evaluation) -> list[tuple[str, list[str]]]:
    persons = evaluation.persons
    return [
        ("joint distance, median", [_mm(p.median_mm) for p in persons]),
        ("joint distance, 95 %", [_mm(p.p95_mm) for p in persons]),
    ]


def _mm(length: float) -> str:
    """A length, or "unknown" if the person is lost in every frame."""
    return f"{length:.1f} mm" if math.isfinite(length) else "-"


def _hinge(person: PersonErrors, hinge: str) -> str:
    if hinge not in person.hinges_deg:
        return "-"
    raw, removed = person.hinges_deg[hinge]
    return f"{raw:.2f} deg ({removed:.2f}{_told(person.hinge_sigmas_deg.get(hinge), '.2f')})"


def _joint(person: PersonErrors, joint: str) -> str:
    if joint not in person.joints_mm:
        return "-"
    raw, removed = person.joints_mm[joint]
    return f"{raw:.1f} mm ({removed:.1f}{_told(person.joint_sigmas_mm.get(joint), '.1f')})"


def _told(sigma: float | None, shown: str) -> str:
    """The standard deviation of the run, if it gives one."""
    return "" if sigma is None else f"; {sigma:{shown}}"


def _ratio(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "-"


def _tell_incomplete(person: PersonErrors) -> None:
    """Joints that are compared in only some of the frames with a pose, or in none."""
    partly = [f"{name} in {n} frames" for name, n in person.incomplete_frames.items() if n]
    never = [name for name, n in person.incomplete_frames.items() if not n]
    told = [("compared where both have them: ", partly), ("not compared, in no frame of both: ", never)]
    for what, names in told:
        if names:
            console.print(f"{person.person}: {what}{', '.join(names)}", highlight=False, soft_wrap=True)


BUNDLED = "bundled"
"""The library that comes with the package, in place of a folder."""

_COLUMNS = ("from s", "to s", "angle deg", "misfit", "size", "tempo", "speed", "next best", "its angle")


def recognize(
    result: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    name: Annotated[str | None, typer.Argument(help="With --add: name of the movement.", show_default=False)] = None,
    library: Annotated[
        list[str] | None, typer.Option(help="Folder of known movements; repeatable. Default: bundled.")
    ] = None,
    output: Annotated[Path | None, typer.Option(help="Folder to write to; default: the result folder.")] = None,
    overwrite: Overwrite = False,
    add: Annotated[bool, typer.Option("--add", help="Add the result to --library as the movement NAME.")] = False,
    frames: Annotated[str | None, typer.Option(help="With --add: range A:B of its frames.")] = None,
    person: Annotated[str | None, typer.Option(help="With --add: which person; default: the only one.")] = None,
    performance: Annotated[str | None, typer.Option(help="With --add: its name; default: run and person.")] = None,
    repeats: Annotated[
        bool, typer.Option("--repeats/--no-repeats", help="With --add: the movement is a cycle, as walking is.")
    ] = False,
    about: Annotated[str, typer.Option(help="With --add: a sentence about the movement.")] = "",
) -> None:
    """Finds known movements in a result, by dynamic time warping of its joint angles; or adds one to a library."""
    if add:
        _add(result, name, (library, frames, person, performance), (repeats, about))
        return
    given = {"NAME": name, "--frames": frames, "--person": person, "--performance": performance, "--about": about}
    for option, value in given.items():
        if value:
            raise ConfigError(f"{option} {value}: only with --add; or bodytrack result recognize {result} --add NAME")
    from tracker.foundation.files import check_free, csv_lines, replacing, write_whole
    from tracker.results.recognition import course_of
    from tracker.results.recognition.library import load_library
    from tracker.results.recognition.matching import recognize as recognized
    from tracker.results.recognition.matching import strip, table_rows, timeline
    from tracker.results.result import load_result

    folder = output or result
    check_free((folder / name for name in ("movements.csv", "movements.png")), overwrite)
    known = load_library(_folders(library))
    loaded = load_result(result)
    courses = {track.name: course_of(track.body, track.times_s, track.poses) for track in loaded.persons}
    persons = {who: timeline(course, recognized(course, known)) for who, course in courses.items()}
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "movements.csv", csv_lines(table_rows(persons)))
    with replacing(folder / "movements.png") as picture:
        strip(loaded.name, persons).savefig(picture, dpi=110)
    _print(persons, len(known.movements))
    console.print(f"written: {folder / 'movements.csv'}, movements.png", highlight=False, soft_wrap=True)


def _folders(library: list[str] | None) -> tuple[Path, ...]:
    from tracker.results.recognition.library import bundled_library

    return tuple(bundled_library() if name == BUNDLED else Path(name) for name in library or ())


def _print(persons: dict[str, tuple[Stretch, ...]], n_known: int) -> None:
    for person, stretches in persons.items():
        found = [one.recognized for one in stretches if one.recognized is not None]
        seconds = sum(one.seconds for one in stretches if one.what == "unknown")
        if stretches and all(one.what == "lost" for one in stretches):
            console.print(f"{person}: lost in every frame", highlight=False)
            continue
        if not found:
            console.print(f"{person}: none of {n_known} known movements fits", highlight=False)
            continue
        table = Table(Column("movement", no_wrap=True), *_COLUMNS, title=person)
        for one in found:
            what = f"{one.movement} (mirrored)" if one.mirrored else one.movement
            second = (one.second, f"{one.second_deg:.1f}") if one.second else ("none fits its length", "")
            alike = f"{one.angle_deg:.1f}", f"{one.misfit:.2f}"
            done = ("" if value != value else f"{value:.2f}" for value in (one.size, one.tempo, one.speed))
            numbers = f"{one.start_s:.2f}", f"{one.end_s:.2f}", *alike, *done
            table.add_row(what, *numbers, *second)
        console.print(table)
        if seconds > 0:
            console.print(f"{person}: {seconds:.1f} s resemble none of {n_known} known movements", highlight=False)
    console.print(
        "angle: RMS between the limbs of the person and of the known movement; "
        "misfit: that angle over the largest that counts; "
        "size, tempo: how many times as large and as fast as the known one; "
        "speed: over the floor, leg lengths a second",
        style="dim",
    )


def _add(
    result: Path,
    name: str | None,
    chosen: tuple[list[str] | None, str | None, str | None, str | None],
    told: tuple[bool, str],
) -> None:
    from tracker.results.recognition import RATE_HZ, course_of
    from tracker.results.recognition.library import Description, add_performance
    from tracker.results.result import load_result

    library, frames, person, performance = chosen
    if not name:
        raise ConfigError(f"--add: expected a name: bodytrack result recognize --add {result} NAME --library movements")
    if not library or len(library) != 1 or library[0] == BUNDLED:
        raise ConfigError("--add: expected one folder of your own: --library movements; it is made if there is none")
    loaded = load_result(result)
    track = _only(loaded.persons) if person is None else loaded.person(person)
    first, behind = _range(frames, track)
    course = course_of(track.body, track.times_s[first:behind], track.poses[first:behind])
    key = performance or f"{loaded.name}_{track.name}"
    path, kept = add_performance(Path(library[0]), name, key, course, Description(about=told[1], repeats=told[0]))
    seconds = len(kept.known) / RATE_HZ
    round_ = ", one cycle of it" if told[0] else ""
    console.print(
        f'"{name}" of {track.name}, {kept.start_s:.2f} to {kept.start_s + seconds:.2f} s{round_}: {path}',
        highlight=False,
        soft_wrap=True,
    )


def _only(persons: tuple[Track, ...]) -> Track:
    if len(persons) > 1:
        names = ", ".join(track.name for track in persons)
        raise ConfigError(f"--add: {len(persons)} persons in the result: choose one with --person: {names}")
    return persons[0]


def _range(frames: str | None, track: Track) -> tuple[int, int]:
    """Positions of the frames numbered A to B - 1."""
    import numpy as np

    match = re.fullmatch(r"(\d*):(\d*)", frames or ":")
    if match is None:
        raise ConfigError(f"--frames {frames}: expected A:B, for instance 0:100, 50: or :100")
    numbers = track.frames
    first = int(np.searchsorted(numbers, int(match[1]))) if match[1] else 0
    behind = int(np.searchsorted(numbers, int(match[2]))) if match[2] else len(numbers)
    if behind - first < 2:
        told = "--add" if frames is None else f"--frames {frames}"
        raise ConfigError(
            f"{told}: the result has frames {numbers[0]} to {numbers[-1]}, and a movement takes two or more"
        )
    return first, behind
