"""Acquisition from views: fits a person's model over frames of a run while it is tracked."""

from __future__ import annotations

import itertools
import logging
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tracker.acquisition.body_fit import best_seen
from tracker.acquisition.calibrated_views import (
    Seen,
    ViewSettings,
    Watching,
    check_overlaps,
    fit_to_views,
    view_overlaps,
)
from tracker.acquisition.cells import How
from tracker.acquisition.fitting import Fit
from tracker.acquisition.result import Panel
from tracker.acquisition.shape_space import space_of
from tracker.acquisition.things import Thing, carried_of, entry_of, things_of, told_of_things, told_of_uncarried
from tracker.bodies.body.description import read_description, save_description
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.configuration.tables import Table
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.files import write_json, write_whole
from tracker.foundation.progress import Progress, silent
from tracker.images.reading import Sequence as Recording
from tracker.running.jobs import ResultFolder, described, execute, job_from
from tracker.running.jobs._acquisition import Acquired, AcquireOutcome
from tracker.running.jobs.track import OpenedTrack, TrackJob
from tracker.tracking.cycle import Cycle
from tracker.tracking.sequence import track
from tracker.tracking.trajectory import Step

log = logging.getLogger("tracker")

__all__ = ["AcquireJob", "AcquireOutcome", "acquire_to", "acquisition_from"]


@component
class AcquireJob(TrackJob):
    """Makes a person's model from the views of a run: `model.toml`, a picture and the figures of the fit."""

    resumable: ClassVar[bool] = False

    acquisition: ViewSettings = ViewSettings()
    """Frames and settings of the fit."""

    def execute(self, opened: OpenedTrack, folder: ResultFolder, progress: Progress) -> AcquireOutcome:  # type: ignore[override]
        """Tracks and fits in turn; see `tracker.running.jobs.Job.execute`."""
        settings, person = self.acquisition, self._person()
        name = self.persons[person].name
        space = space_of(opened.models[name], settings.prior)
        cycle = self.cycle(opened, progress)
        watching = Watching(opened.sequence.rig, self.synthesis, settings.analysis, cycle.plates)
        found: Fit | None = None
        before: Array = np.full(0, np.nan)
        for _ in range(settings.rounds):
            shape = np.zeros(len(space.names)) if found is None else found.shape
            scene, sequence = opened.scene.with_bodies({person: space.body(shape)}), opened.sequence
            frames, n_frames = _in_view(sequence, cycle)
            steps = _told(track(frames, scene, cycle, reopen=sequence.frames), n_frames, progress)
            first = next(steps)
            steps = itertools.chain([first], steps)
            cycle = cycle.knowing({first.frame.index: first.estimates}, first.start)
            seen = best_seen(steps, person, n_frames, settings.frames, doubted_too=True)
            fitted = fit_to_views(space, (shape, person), seen, watching, settings, progress)
            if found is None:
                poses = np.concatenate([one.scene.persons[person].q for one in seen])
                before = view_overlaps(replace(fitted, shape=shape, poses=poses), seen, watching)
            found = fitted
        assert found is not None
        if self.persons[person].carries is None:
            things = things_of(seen, person, space.described(found.shape), watching)
            _tell_of_things(name, things, progress)
        overlaps = view_overlaps(found, seen, watching)
        views = watching.rig.names
        check_overlaps(overlaps, views, settings)
        about = f"acquired from {len(seen)} frame(s) of {len(views)} views, from {space.description.name}"
        panels = _panels(found, seen[0], watching, overlaps)
        acquired = Acquired(
            name,
            about,
            found,
            panels,
            _known(views, overlaps),
            _known(views, before),
            carried=tuple(one.name for one in self.persons[person].carries or ()),
        )
        return acquired.written(folder.path, described(self))

    @property
    def model_name(self) -> str:
        """Name of the model: the person's."""
        return self.persons[self._person()].name

    def open(self, earlier: Path | None = None) -> OpenedTrack:
        """Opens a tracking job, and finds the person; see `tracker.running.jobs.Job.open`."""
        self._person()
        return super().open(earlier)

    def _person(self) -> int:
        """Index of the person to model.

        Raises:
            ConfigError: the configuration does not name the person, or the name is unknown.
        """
        names, name = [subject.name for subject in self.persons], self.acquisition.person
        if name is None and len(names) > 1:
            raise ConfigError(f"several persons, name one: --set acquisition.person={names[0]}")
        if name is not None and name not in names:
            raise ConfigError(f'[acquisition]: no person "{name}"; {nearest(name, names)}')
        return 0 if name is None else names.index(name)


def _in_view(sequence: Recording, cycle: Cycle) -> tuple[Iterator[Frame], int]:
    """The frames from the first one searched, and their number."""
    frames = enumerate(sequence.frames())
    n_before, first = next(one for one in frames if one[1].index >= cycle.nobody_before)
    return itertools.chain([first], (frame for _, frame in frames)), sequence.n_frames - n_before


def _told(steps: Iterator[Step], n_frames: int, progress: Progress) -> Iterator[Step]:
    """The steps, with progress."""
    for n, step in enumerate(steps, start=1):
        progress("tracking", n, n_frames)
        yield step


def _tell_of_things(name: str, things: Sequence[Thing], progress: Progress) -> None:
    """Warnings about carried things: a model is of the body alone."""
    for told in told_of_uncarried(name, things):
        log.warning("%s", told)
        progress(f"input: {told}")
    things = [one for one in things if one.how is How.CARRIED]
    if things:
        carried = carried_of(things)
        tell = f"; tell of it: {entry_of(carried)}" if carried else ""
        told = f"{told_of_things(name, things)}; the model is fitted without it{tell}"
        log.warning("%s", told)
        progress(f"input: {told}")


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


def acquisition_from(table: Table, source: str, folder: Path, name: str) -> Any:
    """Makes the job of a table: pairs of silhouettes, a scan, surface points, a robot, or a tracking job.

    Args:
        table: its sections.
        source: of the table, for messages.
        folder: where relative paths start.
        name: of the job if the table has none.

    Raises:
        ConfigError: the table describes none of them or several; else see `tracker.running.jobs.job_from`.
    """
    kinds = {"pairs": "acquire_from_pictures", "scan": "acquire_from_scan", "moments": "acquire_from_points"}
    kinds |= {"robot": "acquire_from_robot", "reading": "acquire"}
    given = [use for section, use in kinds.items() if section in table]
    if len(given) != 1:
        raise ConfigError(
            f"{source}: expected either [[pairs]] of front and side silhouettes, or a [scan] with its joints, "
            "or [[moments]] of surface points, or a [robot], or the [reading] and persons of a run"
        )
    use = given[0]
    return job_from(use, {key: value for key, value in table.items() if key != "job"}, source, folder, name)


def acquire_to(job: Any, path: Path, progress: Progress = silent) -> AcquireOutcome:
    """Acquires a model into a file; picture and figures lie beside it, each replaced as a whole.

    Args:
        job: an acquisition.
        path: model file to write; its folder is created.
        progress: told how far it is.

    Raises:
        TrackerError: nothing is written.
    """
    with tempfile.TemporaryDirectory() as scratch:
        found: AcquireOutcome = execute(job, Path(scratch) / "result", progress=progress)
        outcome = replace(found, model=path, picture=path.with_suffix(".png"))
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(outcome.picture, found.picture.read_bytes())
        write_json(path.with_suffix(".json"), {**outcome.as_dict(), "config": described(job)})
        save_description(read_description(found.model), path, decimals=None)
    return outcome
