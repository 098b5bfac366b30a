"""Following: points, or a whole surface, through a synchronized recording by least squares matching."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from itertools import dropwhile
from pathlib import Path
from typing import ClassVar

import numpy as np
import pydantic

from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.c3d_format import c3d_library, check_frames
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.files import replacing, write_json, write_whole
from tracker.foundation.progress import Progress, silent
from tracker.images.reading import Reading, Sequence
from tracker.points.following.births import Density, clicked_places, surroundings
from tracker.points.following.filters import TrajectoryFilters, cut_where_false, no_cuts
from tracker.points.following.following import Following
from tracker.points.following.line_figure import check_lines, write_line_figure
from tracker.points.following.points import NewPoints, Points
from tracker.points.following.record import read
from tracker.points.following.report import Course, Summary, counts_figure, report_html, summarized, trajectories_figure
from tracker.points.following.sequence import Counts, SavedState, follow, prepared_rig, saved_state
from tracker.points.following.snakes import Contour, Snake, snake_faults
from tracker.points.following.tables import C3D_ASKED
from tracker.points.surfaces.surface import SurfaceMeasurement
from tracker.points.trajectories import PointFrame
from tracker.running.jobs import ResultFolder, described
from tracker.running.jobs._following import (
    RECORD,
    Around,
    Born,
    Places,
    SecondLook,
    TrajectoryFiles,
    begun,
    position,
    record_sightings,
)


@component
class FollowJob:
    """Follows points through a recording: trajectories with velocities, accelerations and sigmas, and a report."""

    resumable: ClassVar[bool] = True

    name: str = "follow"
    """Name of the results' folder: `results/NAME/TIME`."""

    reading: Reading = pydantic.Field(
        examples=['{ use = "video", path = "{view}.mp4", rig = "rig.toml" }; see configs/following/back.toml']
    )
    """The recording."""

    view: str | None = None
    """Follow only in the image of this view: 2-D mode. None for all views, in space."""

    points: Places = ()
    """Points in the first frame of the template's view (or of `view`), px: `[[x, y], ...]` or a table of names.

    None for all points of the measured surface; in 2-D mode for all textured places.
    """

    lines: tuple[tuple[str, ...], ...] = ()
    """Named points joined by lines, each line from point to point: `[["left_hip", "left_knee", "left_ankle"], ...]`.

    `figure.mp4` shows them over the images of the template's view (or of `view`), and alone beside.
    """

    key_points: dict[str, dict[str, tuple[float, float]]] = pydantic.Field(default_factory=dict)
    """Places inside or beside the surface, such as joints. They move with the points around them.

    Each has its positions in two or more views of the first frame: `right_elbow = { left = [x, y], centre = [x, y] }`.
    """

    key_point_reach_mm: float = pydantic.Field(default=120.0, gt=0)
    """Points farther from a key point than this do not move it, mm."""

    snakes: dict[str, Contour] = pydantic.Field(default_factory=dict)
    """Contours, of a limb for instance, to follow in the image of a view. The points around them lead them.

    Each is clicked in the first frame: `right_arm = { view = "centre", points = [[x, y], ...], closed = false }`.
    """

    snake: Snake = pydantic.Field(default_factory=Snake)
    """Settings of the contours."""

    surface: SurfaceMeasurement = pydantic.Field(default_factory=SurfaceMeasurement)
    """Settings of the surface on which points are born; `surface.growth.step_px` is their distance."""

    following: Following = pydantic.Field(default_factory=Following)
    """Settings of the following."""

    density: Density | None = pydantic.Field(default_factory=Density)
    """Settings of new points on new surface; without effect if `points` are given, or in 2-D mode."""

    filters: TrajectoryFilters = pydantic.Field(default_factory=TrajectoryFilters)
    """Limits that cut false trajectories; without effect in 2-D mode."""

    picture_frames: int = pydantic.Field(default=25, ge=1)
    """Frames between two pictures."""

    cloud_frames: int = pydantic.Field(default=25, ge=0)
    """Frames between two PLY clouds; 0 for none."""

    c3d: bool = False
    """Write `trajectories.c3d` beside `trajectories.trc`; needs the package ezc3d."""

    most_markers: int = pydantic.Field(default=500, ge=1)
    """Largest number of points in TRC and C3D: named points first, then those seen in most frames. Programs that read
    them have a row or a column for each. CSV and PLY hold all."""

    saved_frames: int = pydantic.Field(default=50, ge=1)
    """Frames between two saved states; an interrupted job goes on from the last one."""

    @pydantic.field_validator("points", mode="before")
    @classmethod
    def _whole_numbers_are_positions(cls, points: object) -> object:
        if isinstance(points, dict):
            return {name: position(place) for name, place in points.items()}
        return tuple(map(position, points)) if isinstance(points, tuple | list) else points

    @pydantic.field_validator("key_points", mode="before")
    @classmethod
    def _clicks_are_positions(cls, clicks: object) -> object:
        if not isinstance(clicks, dict):
            return clicks
        return {
            name: {view: position(place) for view, place in views.items()} if isinstance(views, dict) else views
            for name, views in clicks.items()
        }

    def open(self, earlier: Path | None = None) -> OpenedFollow:
        """Opens the recording and the state of an interrupted job; see `jobs.Job.open`."""
        sequence = self.reading.open()
        if self.view is not None and self.view not in sequence.rig.names:
            raise ConfigError(f'view = "{self.view}": no such view; {nearest(self.view, sequence.rig.names)}')
        if self.view is None and len(sequence.rig) == 1:
            raise ConfigError(f'2-D mode follows in the image of one view: say view = "{sequence.rig.names[0]}"')
        if self.view is None:
            self.surface.template_of(sequence.rig)
            clicked_places(self.key_points, prepared_rig(self.surface.preparation, sequence.rig))
        elif self.key_points:
            raise ConfigError("key_points move in space: they need all views, so leave `view` out")
        if fault := snake_faults(self.snakes, self._rig(sequence).names):
            raise ConfigError(fault)
        check_lines(self.lines, self._names)
        if self.c3d:
            c3d_library(C3D_ASKED)
            check_frames(sequence.n_frames, C3D_ASKED)
        return OpenedFollow(sequence, None if earlier is None else saved_state(earlier))

    def execute(self, opened: OpenedFollow, folder: ResultFolder, progress: Progress = silent) -> FollowOutcome:
        """Follows, writes every frame as it comes, then the tables and pictures; see `jobs.Job.execute`."""
        rig = self._rig(opened.sequence)
        save_rig(rig, folder.path / "rig.toml")
        counts = begun(folder.path, opened.state)
        planned = opened.sequence.n_frames, self.saved_frames
        record_sightings(self._steps(opened, rig, counts), folder, counts, planned, progress)
        progress("writing", 0, 1)
        outcome = self._written(folder.path, opened.sequence, rig, counts)
        progress("writing", 1, 1)
        return outcome

    @property
    def _names(self) -> tuple[str, ...]:
        """Names of points; their numbers are the ids in the record."""
        return tuple(self.points) if isinstance(self.points, dict) else ()

    def _template(self, rig: Rig) -> int:
        return self.surface.template_of(rig) if self.view is None else 0

    def _rig(self, sequence: Sequence) -> Rig:
        return sequence.rig if self.view is None else sequence.rig.select((self.view,))

    def _frames(self, opened: OpenedFollow) -> Iterator[Frame]:
        """The frames from the saved state on, of the views that are followed."""
        chosen = [v for v, name in enumerate(opened.sequence.rig.names) if self.view in (None, name)]
        frames = opened.sequence.frames()
        if opened.state is not None:
            frames = dropwhile(lambda frame: frame.index < opened.state.frame, frames)  # type: ignore[union-attr]
        for frame in frames:
            yield Frame(frame.index, frame.time_s, tuple(frame.images[v] for v in chosen))

    def _steps(self, opened: OpenedFollow, rig: Rig, counts: Counts) -> Iterator[tuple[PointFrame, Points]]:
        """The frames still to follow; fails before the first one without points around a key point."""
        density = None if self.view is not None or len(self.points) else self.density
        known, around = None if opened.state is None else opened.state.points, self._around(rig)
        frames, births = self._frames(opened), self._births(rig, counts)
        for frame, points in follow(
            self.following, self.surface.preparation, rig, frames, births, known, density=density
        ):
            if around is not None and not counts.frames:
                around(frame.ids, frame.positions)
            yield frame, points

    def _births(self, rig: Rig, counts: Counts) -> Callable[[Frame], NewPoints]:
        """The points followed from a frame on; doubts about the first frame are added to the warnings."""
        born, look = Born(self.surface, self.following, rig, self.points, counts.warnings), self._second_look(rig)

        def births(frame: Frame) -> NewPoints:
            if counts.frames:
                return born.later(frame)
            greys = look.greys(frame)
            look.check(greys)
            return born.first(frame, greys)

        return births

    def _around(self, rig: Rig) -> Around | None:
        if not self.key_points:
            return None
        places = clicked_places(self.key_points, prepared_rig(self.surface.preparation, rig))
        names = list(self.key_points)
        return partial(surroundings, names=names, places=places, reach_m=self.key_point_reach_mm / 1000)

    def _second_look(self, rig: Rig) -> SecondLook:
        return SecondLook(self.snake, self.snakes, rig, self.following, self.surface.preparation, self.picture_frames)

    def _written(self, folder: Path, sequence: Sequence, rig: Rig, counts: Counts) -> FollowOutcome:
        rows, frames, times = read(folder / RECORD, len(rig)), np.array(counts.frames), np.array(counts.times)
        cuts = no_cuts(rows) if self.view is not None else cut_where_false(self.filters, rows, frames, times)
        files = TrajectoryFiles(
            rig.names, dict(enumerate(self._names)), self._around(rig), self.cloud_frames, self.most_markers, self.c3d
        )
        overview = files.write(folder, (rows, frames, times), cuts)
        figures = {
            "trajectories.png": trajectories_figure(overview, cuts.steps, rig if self.view is None else None),
            "counts.png": counts_figure(overview, times),
        }
        for name, figure in figures.items():
            with replacing(folder / name) as path:
                figure.savefig(path, dpi=110)
        images = self._frames(OpenedFollow(sequence, None))
        snakes = self._second_look(rig).take(folder, images, (rows, frames), cuts)
        if self.lines:
            images = self._frames(OpenedFollow(sequence, None))
            shown = self._second_look(rig).places(images, (rows, frames), cuts, (self._template(rig), len(self._names)))
            lines = [[self._names.index(name) for name in line] for line in self.lines]
            write_line_figure(folder / "figure.mp4", shown, lines, 1 / sequence.interval_s)
        counts.warnings.extend(warning for snake in snakes if (warning := snake.warning))
        course = Course(counts.seconds, counts.interrupted, tuple(counts.warnings))
        summary = summarized(rows, frames, cuts, course)
        write_json(folder / "follow.json", {"config": described(self), **asdict(summary)})
        write_whole(folder / "report.html", report_html(self.name, summary, folder, flat=self.view is not None))
        return FollowOutcome(folder=folder, **asdict(summary))


@dataclass(frozen=True)
class OpenedFollow:
    """Inputs of a following."""

    sequence: Sequence
    state: SavedState | None


@dataclass(frozen=True)
class FollowOutcome(Summary):
    """Outcome of a following; the same numbers are in `follow.json`."""

    folder: Path
