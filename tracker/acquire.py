"""What an acquisition file describes, and its execution: a person's model, a table and a picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tracker.acquisition.calibrated_views import (
    Seen,
    ViewSettings,
    Watching,
    chosen,
    fit_to_views,
    view_overlaps,
)
from tracker.acquisition.figures import Panel, fit_figure
from tracker.acquisition.fitting import Fit, Report, silent
from tracker.acquisition.pictures import Pair
from tracker.acquisition.result import BoneLength, PartResidual, bone_lengths, contour_rms_mm, model_of, part_residuals
from tracker.acquisition.shape_space import ShapeSpace, space_of
from tracker.acquisition.two_silhouettes import SilhouetteSettings, acquire
from tracker.body_files import BodyDescription, read_description, save_description
from tracker.config import Table, build_class, expanded, read_config
from tracker.errors import ConfigError, nearest
from tracker.initialization.given import GivenInitialization
from tracker.resources import model_path
from tracker.run import Run, Subject, cycle_of, run_from
from tracker.scene import Person, Scene
from tracker.tracking import track

_KEYS = ("name", "model", "stature_m", "pairs", "acquisition")


@dataclass(frozen=True)
class Acquisition:
    """What was acquired, in numbers."""

    model: Path
    picture: Path
    shaded_by: str
    stature_m: float
    overlaps: dict[str, float]
    """Silhouette intersection over union of each view."""

    before: dict[str, float]
    """The same with the general model, only scaled and posed; empty where not known."""

    turns_deg: tuple[float, ...]
    """Measured turns between front and side."""

    contour_rms_mm: float
    parts: tuple[PartResidual, ...]
    bones: tuple[BoneLength, ...]

    def as_dict(self) -> dict[str, Any]:
        """The content for a JSON file."""
        return {**asdict(self), "model": str(self.model), "picture": str(self.picture)}


def acquire_model(config: Path, output: Path | None, overrides: Sequence[str] = (), report: Report = silent) -> Acquisition:
    """Acquires the model of a person and writes it with a picture and its figures.

    Args:
        config: a file with `pairs` of silhouettes, or the configuration of a run (`reading` and `persons`).
        output: model file; None for `models/NAME.toml` under the working directory.
        overrides: `section.key=value`.
        report: told of the progress.

    Raises:
        TrackerError: a file or a picture cannot be used; nothing is written then.
    """
    table = read_config(config, overrides)
    if ("pairs" in table) == ("reading" in table):
        raise ConfigError(
            f"{config.name}: expected either [[pairs]] of front and side silhouettes, or the [reading] and persons "
            "of a run"
        )
    if "pairs" in table:
        return _from_silhouettes(table, config, output, report)
    return _from_run(table, config, output, report)


def _from_silhouettes(table: Table, config: Path, output: Path | None, report: Report) -> Acquisition:
    for key in table:
        if key not in _KEYS:
            raise ConfigError(f'{config.name}: unknown key "{key}"; {nearest(key, _KEYS)}')
    name = str(table.get("name", config.stem))
    entries = table["pairs"]
    if not isinstance(entries, list) or not entries:
        raise ConfigError(f"{config.name}: pairs: expected a list of tables with front and side")
    pairs = [
        build_class(Pair, entry, f"{config.name} [pairs {k + 1}]", config.parent) for k, entry in enumerate(entries)
    ]
    settings = build_class(
        SilhouetteSettings, table.get("acquisition", {}), f"{config.name} [acquisition]", config.parent
    )
    stature_m = table.get("stature_m")
    if stature_m is not None and (not isinstance(stature_m, (int, float)) or not 0.2 < stature_m < 5):
        raise ConfigError(f"{config.name}: stature_m = {stature_m!r}, expected a height in metres")
    description = read_description(_model(str(table.get("model", "gavrila22")), config))
    found = acquire(description, pairs, stature_m, settings, report)
    names = [f"{one.name} {k // 2 + 1}" if len(pairs) > 1 else one.name for k, one in enumerate(found.silhouettes)]
    panels = [
        Panel(f"{name}: IoU {share:.3f}", one.image, one.mask, one.camera, found.fit.pose(k))
        for k, (name, share, one) in enumerate(zip(names, found.overlaps, found.silhouettes, strict=True))
    ]
    outcome = _Outcome(
        found.fit,
        panels,
        dict(zip(names, found.overlaps, strict=True)),
        dict(zip(names, found.start_overlaps, strict=True)),
        found.turns_deg,
    )
    return _written(outcome, name, f"acquired from front and side silhouettes, from {description.name}", output)


def _model(model: str, config: Path) -> Path:
    return config.parent / expanded(model, config.name) if model.endswith(".toml") else model_path(model)


def _from_run(table: Table, config: Path, output: Path | None, report: Report) -> Acquisition:
    settings = build_class(ViewSettings, table.pop("acquisition", {}), f"{config.name} [acquisition]", config.parent)
    run = run_from(table, config.name, config.parent, config.stem)
    subject = run.persons[0]
    space = space_of(_scaled(subject), settings.prior)
    shape, found = np.zeros(len(space.names)), None
    for k in range(settings.rounds):
        seen, watching = _tracked(run, space, shape, settings, report)
        found = fit_to_views(space, (shape, 0), seen, watching, settings, report)
        shape = found.shape
        if k == 0:
            before = view_overlaps(replace(found, shape=np.zeros_like(shape), poses=_poses(seen)), seen, watching)
    assert found is not None
    overlaps = view_overlaps(found, seen, watching)
    panels = [
        Panel(f"{camera.name}: IoU {share:.3f}", image, _mask(found, v), camera, found.pose(0))
        for v, (camera, share) in enumerate(zip(watching.rig.cameras, overlaps, strict=True))
        if (image := seen[0].frame.images[v]) is not None
    ]
    names = watching.rig.names
    outcome = _Outcome(
        found,
        panels,
        dict(zip(names, overlaps.tolist(), strict=True)),
        dict(zip(names, before.tolist(), strict=True)),
        (),
    )
    about = f"acquired from {len(seen)} frame(s) of {len(names)} views, from {space.description.name}"
    return _written(outcome, subject.name, about, output)


def _scaled(subject: Subject) -> BodyDescription:
    description = read_description(subject.model)
    if subject.stature_m is None:
        return description
    if description.stature_m <= 0:
        raise ConfigError(f'person "{subject.name}": stature_m given, but {subject.model} does not tell its own')
    return description.scaled(subject.stature_m / description.stature_m)


def _tracked(
    run: Run, space: ShapeSpace, shape: np.ndarray[Any, Any], settings: ViewSettings, report: Report
) -> tuple[list[Seen], Watching]:
    """The chosen frames at the poses that tracking with the present shape gives."""
    sequence = run.reading.open()
    bodies = [space.body(shape), *(subject.body() for subject in run.persons[1:])]
    persons = tuple(Person(one.name, body, body.rest()) for one, body in zip(run.persons, bodies, strict=True))
    cycle = cycle_of(run, sequence.backgrounds)
    if sum(plate is not None for plate in sequence.backgrounds) < 2 and not isinstance(
        run.initialization, GivenInitialization
    ):
        cycle = replace(cycle, initialization=settings.stance)
    wanted, seen = chosen(sequence.n_frames, settings.frames), []
    for k, step in enumerate(track(sequence.frames(), Scene(persons, sequence.rig), cycle)):
        report("tracking", k + 1, sequence.n_frames)
        if k in wanted and not step.estimates[0].lost:
            seen.append(Seen(step.frame, step.scene))
    return seen, Watching(sequence.rig, run.synthesis, run.analysis, sequence.backgrounds)


def _poses(seen: Sequence[Seen]) -> np.ndarray[Any, Any]:
    return np.concatenate([one.scene.persons[0].q for one in seen])


def _mask(found: Fit, view: int) -> np.ndarray[Any, Any] | None:
    outlines = found.looks[0].outlines
    shown = None if outlines is None else outlines.views[view]
    return None if shown is None else shown.silhouette


@dataclass(frozen=True)
class _Outcome:
    fit: Fit
    panels: list[Panel]
    overlaps: dict[str, float]
    before: dict[str, float]
    turns_deg: tuple[float, ...]


def _written(outcome: _Outcome, name: str, about: str, output: Path | None) -> Acquisition:
    """Writes model, picture and figures side by side."""
    path = output or Path("models") / f"{name}.toml"
    if path.suffix != ".toml":
        raise ConfigError(f"--output {path}: expected a .toml file")
    description = model_of(outcome.fit, name, about)
    residuals = part_residuals(outcome.fit)
    figure, renderer = fit_figure(outcome.fit.body, outcome.panels, name)
    result = Acquisition(
        model=path,
        picture=path.with_suffix(".png"),
        shaded_by=renderer,
        stature_m=description.stature_m,
        overlaps=outcome.overlaps,
        before=outcome.before,
        turns_deg=outcome.turns_deg,
        contour_rms_mm=contour_rms_mm(residuals),
        parts=residuals,
        bones=bone_lengths(outcome.fit),
    )
    save_description(description, path)
    _save(figure, result.picture)
    path.with_suffix(".json").write_text(json.dumps(result.as_dict(), indent=1) + "\n", encoding="utf-8")
    return result


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=100)


