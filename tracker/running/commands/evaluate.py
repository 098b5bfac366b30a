"""`bodytrack result evaluate`, and the table of errors."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from tracker.running.commands.options import Overwrite
from tracker.running.commands.terminal import console

if TYPE_CHECKING:
    from tracker.results.evaluation.comparison import Evaluation
    from tracker.results.evaluation.person_errors import PersonErrors


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
    """A table of the errors of each person, what is looked for first on top, and the silhouettes' overlap."""
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
    """The person of the run, and whom of the truth it is compared with; a truth without names says nothing of one."""
    unnamed = len(evaluation.persons) == 1 and person.truth == "1"
    return person.person if unnamed or person.truth == person.person else f"{person.person} (truth: {person.truth})"


def _tell_crossed(evaluation: Evaluation) -> None:
    """That persons are compared with others than those of their names: who is nearest counts."""
    names = {person.person for person in evaluation.persons}
    crossed = [one for one in evaluation.persons if one.truth != one.person and one.truth in names]
    if crossed:
        pairs = ", ".join(f"{one.person} of the run with {one.truth} of the truth" for one in crossed)
        console.print(f"persons are paired by distance, not by name: {pairs}", highlight=False, soft_wrap=True)


def _headline(evaluation: Evaluation) -> list[tuple[str, list[str]]]:
    """How far off joints and angles are, and of how many frames."""
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
        rows.append((f"{hinge.replace('_', ' ')}, RMS (offset removed; told)", [_hinge(p, hinge) for p in persons]))
    rows.append(("frames lost", [f"{p.n_missing} of {p.n_frames}" for p in persons]))
    return rows


def _joint_rows(evaluation: Evaluation) -> list[tuple[str, list[str]]]:
    persons = evaluation.persons
    names = sorted({name for person in persons for name in person.joints_mm})
    rows = [(f"{name.replace('_', ' ')} (offset removed; told)", [_joint(p, name) for p in persons]) for name in names]
    if any(person.joint_sigmas_mm for person in persons):
        rows.append(("joints, error over told sigma", [_ratio(person.over_sigma()) for person in persons]))
    return rows


def _details(evaluation: Evaluation) -> list[tuple[str, list[str]]]:
    persons = evaluation.persons
    return [
        ("joint distance, median", [_mm(p.median_mm) for p in persons]),
        ("joint distance, 95 %", [_mm(p.p95_mm) for p in persons]),
    ]


def _mm(length: float) -> str:
    """A length, or that it is unknown: the person is lost in every frame."""
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
    """The standard deviation that the run tells, where it does."""
    return "" if sigma is None else f"; {sigma:{shown}}"


def _ratio(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "-"


def _tell_incomplete(person: PersonErrors) -> None:
    """Which joints are compared in some of the frames with a pose only, or in none."""
    partly = [f"{name} in {n} frames" for name, n in person.incomplete_frames.items() if n]
    never = [name for name, n in person.incomplete_frames.items() if not n]
    told = [("compared where both have them: ", partly), ("not compared, in no frame of both: ", never)]
    for what, names in told:
        if names:
            console.print(f"{person.person}: {what}{', '.join(names)}", highlight=False, soft_wrap=True)
