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
    check_overlaps,
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
from tracker.arrays import Array
from tracker.body_description import BodyDescription
from tracker.body_files import read_description, save_description
from tracker.config import Table, build_class, expanded, read_config
from tracker.errors import ConfigError, nearest
from tracker.frame import Frame
from tracker.initialization import Stages
from tracker.initialization.pca import PcaInitialization
from tracker.resources import model_path
from tracker.run import Run, Subject, cycle_of, run_from
from tracker.scene import Person, Scene
from tracker.start import Start
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
    """The same with the model begun with, only scaled and posed; empty where not known."""

    turns_deg: tuple[float, ...]
    """Measured turns between front and side."""

    contour_rms_mm: float
    parts: tuple[PartResidual, ...]
    bones: tuple[BoneLength, ...]

    def as_dict(self) -> dict[str, Any]:
        """The content for a JSON file."""
        return {**asdict(self), "model": str(self.model), "picture": str(self.picture)}


def acquire_model(
    config: Path, output: Path | None = None, overrides: Sequence[str] = (), report: Report = silent
) -> Acquisition:
    """Acquires the model of a person and writes it with a picture and its figures.

    Args:
        config: a file with `pairs` of silhouettes, or the configuration of a run (`reading` and `persons`).
        output: model file; None for `models/NAME.toml` under the working directory.
        overrides: `section.key=value`.
        report: told of the progress.

    Raises:
        TrackerError: a file or a picture cannot be used; nothing is written then.
    """
    return acquire_from(read_config(config, overrides), config, output, report)


def acquire_from(table: Table, config: Path, output: Path | None = None, report: Report = silent) -> Acquisition:
    """The same from the content of a configuration; `config` names it in messages, its folder is where paths start."""
    if output is not None and output.suffix != ".toml":
        raise ConfigError(f"--output {output}: expected a .toml file")
    if ("pairs" in table) == ("reading" in table):
        raise ConfigError(
            f"{config.name}: expected either [[pairs]] of front and side silhouettes, or the [reading] and persons "
            "of a run"
        )
    if "pairs" in table:
        return _from_silhouettes(table, config, output, report)
    return _from_run(dict(table), config, output, report)


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
    person = _position(run, settings.person, config)
    space = space_of(_scaled(run.persons[person]), settings.prior)
    found: Fit | None = None
    known: Start | None = None
    before: Array = np.full(0, np.nan)
    for _ in range(settings.rounds):
        shape = np.zeros(len(space.names)) if found is None else found.shape
        seen, watching, known = _tracked(run, (space, shape, person), settings, known, report)
        fitted = fit_to_views(space, (shape, person), seen, watching, settings, report)
        if found is None:
            poses = np.concatenate([one.scene.persons[person].q for one in seen])
            before = view_overlaps(replace(fitted, shape=shape, poses=poses), seen, watching)
        found = fitted
    assert found is not None
    overlaps = view_overlaps(found, seen, watching)
    check_overlaps(overlaps, watching.rig.names, settings)
    names = watching.rig.names
    about = f"acquired from {len(seen)} frame(s) of {len(names)} views, from {space.description.name}"
    outcome = _Outcome(
        found, _panels(found, seen[0], watching, overlaps), _known(names, overlaps), _known(names, before)
    )
    return _written(outcome, run.persons[person].name, about, output)


def _position(run: Run, name: str | None, config: Path) -> int:
    names = [subject.name for subject in run.persons]
    if name is None and len(names) > 1:
        raise ConfigError(f"{config.name}: several persons, name one: --set acquisition.person={names[0]}")
    if name is not None and name not in names:
        raise ConfigError(f'{config.name}: no person "{name}"; {nearest(name, names)}')
    return 0 if name is None else names.index(name)


def _known(names: tuple[str, ...], shares: Array) -> dict[str, float]:
    return {name: float(share) for name, share in zip(names, shares, strict=True) if np.isfinite(share)}


def _panels(found: Fit, seen: Seen, watching: Watching, overlaps: Array) -> list[Panel]:
    """The first frame's views."""
    outlines, panels = found.looks[0].outlines, []
    for v, (camera, image) in enumerate(zip(watching.rig.cameras, seen.frame.images, strict=True)):
        view = None if outlines is None else outlines.views[v]
        title = camera.name if np.isnan(overlaps[v]) else f"{camera.name}: IoU {overlaps[v]:.3f}"
        if image is not None:
            panels.append(Panel(title, image, None if view is None else view.silhouette, camera, found.pose(0)))
    return panels


def _scaled(subject: Subject) -> BodyDescription:
    description = read_description(subject.model)
    if subject.stature_m is None:
        return description
    if description.stature_m <= 0:
        raise ConfigError(f'person "{subject.name}": stature_m given, but {subject.model} does not tell its own')
    return description.scaled(subject.stature_m / description.stature_m)


@dataclass(frozen=True)
class _KnownStart:
    """Starts where an earlier pass has started."""

    found: Start

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """The poses of then."""
        return self.found


def _tracked(
    run: Run, subject: tuple[ShapeSpace, Array, int], settings: ViewSettings, known: Start | None, report: Report
) -> tuple[list[Seen], Watching, Start | None]:
    """The chosen frames at the poses that tracking with the present shape gives, and the poses it started at."""
    space, shape, person = subject
    sequence = run.reading.open()
    bodies = [one.body() for one in run.persons]
    bodies[person] = space.body(shape)
    persons = tuple(Person(one.name, body, body.rest()) for one, body in zip(run.persons, bodies, strict=True))
    cycle = cycle_of(run, sequence.backgrounds)
    if known is not None:
        cycle = replace(cycle, initialization=_KnownStart(known))
    elif sum(plate is not None for plate in sequence.backgrounds) < 2 and isinstance(
        run.initialization, PcaInitialization
    ):
        cycle = replace(cycle, initialization=settings.stance)
    wanted, seen, start = chosen(sequence.n_frames, settings.frames), [], known
    steps = track(sequence.frames(), Scene(persons, sequence.rig), cycle, reopen=sequence.frames)
    for k, step in enumerate(steps):
        report("tracking", k + 1, sequence.n_frames)
        lost = [estimate.lost for estimate in step.estimates]
        if k == 0 and not any(lost):
            start = Start(tuple(one.q for one in step.scene.persons))
        if k in wanted and not lost[person]:
            seen.append(Seen(step.frame, step.scene))
    return seen, Watching(sequence.rig, run.synthesis, settings.analysis, sequence.backgrounds), start


@dataclass(frozen=True)
class _Outcome:
    fit: Fit
    panels: list[Panel]
    overlaps: dict[str, float]
    before: dict[str, float]
    turns_deg: tuple[float, ...] = ()


def _written(outcome: _Outcome, name: str, about: str, output: Path | None) -> Acquisition:
    """Writes model, picture and figures side by side."""
    path = output or Path("models") / f"{name}.toml"
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
