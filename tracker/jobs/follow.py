"""Following: points, or all of a surface, through a synchronized recording by least squares matching."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import dropwhile
from pathlib import Path
from typing import ClassVar, TextIO

import numpy as np
import pydantic

from tracker.arrays import Array, Image, Integers
from tracker.components import component
from tracker.errors import ConfigError, MatchingError, SequenceError, nearest
from tracker.files import replacing, write_json, write_whole
from tracker.following.births import (
    check_room,
    given_points,
    no_points,
    points_of_image,
    points_of_surface,
    textured_places,
    with_room,
)
from tracker.following.cuts import Cuts, cut_where_false, no_cuts
from tracker.following.density import Density
from tracker.following.filters import TrajectoryFilters
from tracker.following.following import Following
from tracker.following.key_points import (
    KEY_POINTS_HEADER,
    Surroundings,
    clicked_places,
    followed_key_points,
    key_points_csv,
    surroundings,
)
from tracker.following.marker_files import C3D_ASKED, marker_labels, trc_text, write_c3d
from tracker.following.motion import REACH_FRAMES, Motion, motion_of
from tracker.following.overview import Gathering, Overview
from tracker.following.pictures import counts_figure, points_picture, trajectories_figure, write_picture
from tracker.following.points import NewPoints
from tracker.following.record import Rows, append, between, read, shortened
from tracker.following.report import report_html
from tracker.following.saved_state import Counts, SavedState, save_state, saved_state
from tracker.following.sequence import follow, prepared, prepared_rig
from tracker.following.snake_files import FollowedSnake, Seen, drawn, seen_in, sheet, sheet_frames, snakes_csv
from tracker.following.snakes import Contour, Snake, snake_faults
from tracker.following.summary import Course, Summary, summarized
from tracker.following.tables import Names, csv_header, csv_lines, ply_bytes
from tracker.following.windows import Window, windows
from tracker.frame import Frame
from tracker.jobs import ResultFolder, described
from tracker.jobs._stopping import stopping
from tracker.kernels.ahead import Group
from tracker.lsm.surface import SurfaceMeasurement, measure_surface
from tracker.progress import Progress, silent
from tracker.reading import Reading, Sequence
from tracker.recording.c3d import c3d_library
from tracker.rig import Rig
from tracker.rig_layouts import save_rig

Places = tuple[tuple[float, float], ...] | dict[str, tuple[float, float]]

RECORD = "points.bin"


@component
class FollowJob:
    """Follows points through a recording: trajectories with velocities, accelerations and sigmas, and a report."""

    kernels: ClassVar[Group | None] = "matching"
    resumable: ClassVar[bool] = True

    name: str = "follow"
    """Of the results: they go to `results/NAME/TIME`."""

    reading: Reading = pydantic.Field(
        examples=['{ use = "video", path = "{view}.mp4", rig = "rig.toml" }; see configs/following/back.toml']
    )
    """The recording."""

    view: str | None = None
    """Follow in the image of this view alone: 2-D mode. None for all views, in space."""

    points: Places = ()
    """Points in the first frame of the template's view (or of `view`), px: `[[x, y], ...]` or a table of names.

    None for all points of the measured surface, or all textured places in 2-D mode.
    """

    key_points: dict[str, dict[str, tuple[float, float]]] = pydantic.Field(default_factory=dict)
    """Places inside or beside the surface, such as joints, which move with the points around them.

    Each has its positions in two or more views of the first frame: `right_elbow = { left = [x, y], centre = [x, y] }`.
    """

    key_point_reach_mm: float = pydantic.Field(default=120.0, gt=0)
    """Points farther from a key point than this do not move it, mm."""

    snakes: dict[str, Contour] = pydantic.Field(default_factory=dict)
    """Contours, of a limb for instance, to follow in the image of a view, led by the points around them.

    Each is clicked in the first frame: `right_arm = { view = "centre", points = [[x, y], ...], closed = false }`.
    """

    snake: Snake = pydantic.Field(default_factory=Snake)
    """How contours are followed."""

    surface: SurfaceMeasurement = pydantic.Field(default_factory=SurfaceMeasurement)
    """How the surface is measured that points are born on; `surface.growth.step_px` is their distance."""

    following: Following = pydantic.Field(default_factory=Following)
    """How they are followed."""

    density: Density | None = pydantic.Field(default_factory=Density)
    """New points on new surface; of no effect where `points` are given, or in 2-D mode."""

    filters: TrajectoryFilters = pydantic.Field(default_factory=TrajectoryFilters)
    """What cuts false trajectories; of no effect in 2-D mode."""

    picture_frames: int = pydantic.Field(default=25, ge=1)
    """Frames from one picture to the next."""

    cloud_frames: int = pydantic.Field(default=25, ge=0)
    """Frames from one PLY cloud to the next; 0 for none."""

    c3d: bool = False
    """Write `trajectories.c3d` beside `trajectories.trc`; needs the extra `export`."""

    most_markers: int = pydantic.Field(default=500, ge=1)
    """TRC and C3D hold no more points, named ones first, then those seen in most frames: programs that read them have a
    row or a column for each. CSV and PLY hold all."""

    saved_frames: int = pydantic.Field(default=50, ge=1)
    """Frames from one saved state to the next; an interrupted job goes on from the last one."""

    @pydantic.field_validator("points", mode="before")
    @classmethod
    def _whole_numbers_are_positions(cls, points: object) -> object:
        if isinstance(points, dict):
            return {name: _position(place) for name, place in points.items()}
        return tuple(map(_position, points)) if isinstance(points, tuple | list) else points

    @pydantic.field_validator("key_points", mode="before")
    @classmethod
    def _clicks_are_positions(cls, clicks: object) -> object:
        if not isinstance(clicks, dict):
            return clicks
        return {
            name: {view: _position(place) for view, place in views.items()} if isinstance(views, dict) else views
            for name, views in clicks.items()
        }

    def open(self, earlier: Path | None = None) -> OpenedFollow:
        """Opens the recording and what an interrupted job has left; see `tracker.jobs.Job.open`."""
        sequence = self.reading.open()
        if self.view is not None and self.view not in sequence.rig.names:
            raise ConfigError(f'view = "{self.view}": no such view; {nearest(self.view, sequence.rig.names)}')
        if self.view is None and len(sequence.rig) == 1:
            raise ConfigError(f'one view alone is followed in its image: say view = "{sequence.rig.names[0]}"')
        if self.view is None:
            self.surface.template_of(sequence.rig)
            clicked_places(self.key_points, sequence.rig)
        elif self.key_points:
            raise ConfigError("key_points move in space: they need all views, and no `view`")
        if fault := snake_faults(self.snakes, self._rig(sequence).names):
            raise ConfigError(fault)
        if self.c3d:
            c3d_library(C3D_ASKED)
        return OpenedFollow(sequence, None if earlier is None else saved_state(earlier))

    def execute(self, opened: OpenedFollow, folder: ResultFolder, progress: Progress = silent) -> FollowOutcome:
        """Follows, writing every frame as it comes, then the tables and pictures; see `tracker.jobs.Job.execute`."""
        rig = self._rig(opened.sequence)
        save_rig(rig, folder.path / "rig.toml")
        counts = self._followed(opened, rig, folder, progress)
        progress("writing", 0, 1)
        outcome = self._written(folder.path, opened.sequence, rig, counts)
        progress("writing", 1, 1)
        return outcome

    def _rig(self, sequence: Sequence) -> Rig:
        return sequence.rig if self.view is None else sequence.rig.select((self.view,))

    def _frames(self, opened: OpenedFollow) -> Iterator[Frame]:
        """From the saved state on, of the views that are followed in."""
        chosen = [v for v, name in enumerate(opened.sequence.rig.names) if self.view in (None, name)]
        frames = opened.sequence.frames()
        if opened.state is not None:
            frames = dropwhile(lambda frame: frame.index < opened.state.frame, frames)  # type: ignore[union-attr]
        for frame in frames:
            yield Frame(frame.index, frame.time_s, tuple(frame.images[v] for v in chosen))

    def _births(self, rig: Rig, counts: Counts) -> Callable[[Frame], NewPoints]:
        """What is followed from a frame on; what is doubtful of the first one is added to the warnings."""
        names = list(self.points) if isinstance(self.points, dict) else [str(k) for k in range(len(self.points))]
        places = list(self.points.values()) if isinstance(self.points, dict) else list(self.points)
        at = np.array(places, dtype=np.float64).reshape(-1, 2)

        def births(frame: Frame) -> NewPoints:
            if counts.frames:
                return self._born_later(frame, rig, counts)
            greys = self._shown(frame)
            self._check_snakes(rig, greys)
            if self.view is not None:
                assert greys[0] is not None
                return self._born_in_image(greys[0], at, names)
            surface = measure_surface(self.surface, frame, rig)
            counts.warnings.extend(surface.warnings)
            return given_points(surface, self.surface, at, names) if len(at) else points_of_surface(surface)

        return births

    def _born_in_image(self, grey: Image, at: Array, names: list[str]) -> NewPoints:
        patch_px = self.following.for_views(1).matching.patch_px
        if len(at):
            check_room(at, names, grey, patch_px)
            return points_of_image(at)
        places = textured_places(grey, self.surface.growth.step_px)
        return points_of_image(places[with_room(places, grey, patch_px)])

    def _born_later(self, frame: Frame, rig: Rig, counts: Counts) -> NewPoints:
        """Points of new surface; none where it cannot be measured, which is no reason to end."""
        try:
            return points_of_surface(measure_surface(self.surface, frame, rig))
        except (MatchingError, SequenceError) as error:
            if not any(warning.startswith(_NO_NEW) for warning in counts.warnings):
                counts.warnings.append(f"{_NO_NEW} in frame {frame.index}, perhaps in later ones neither: {error}")
            return no_points(len(rig), float(self.surface.growth.step_px))

    def _check_snakes(self, rig: Rig, greys: tuple[Image | None, ...]) -> None:
        """Begins all snakes, so that a contour that is none is told before anything is followed."""
        for name, contour in self.snakes.items():
            view = self._view_of(contour, rig)
            FollowedSnake(name, contour, view).look(
                self.snake, Seen(np.zeros(0, np.int64), np.zeros((0, 2))), 0, greys[view]
            )

    @staticmethod
    def _view_of(contour: Contour, rig: Rig) -> int:
        return 0 if contour.view is None else rig.names.index(contour.view)

    def _followed(self, opened: OpenedFollow, rig: Rig, folder: ResultFolder, progress: Progress) -> Counts:
        sequence, state = opened.sequence, opened.state
        density = None if self.view is not None or len(self.points) else self.density
        preparation, record = self.surface.preparation, folder.path / RECORD
        begin, counts = time.perf_counter(), Counts()
        if state is not None:
            shortened(record, state.n_bytes)
            counts = Counts(list(state.frames), list(state.times), warnings=list(state.warnings))
        else:
            record.touch()
        known = None if state is None else state.points
        steps = follow(
            self.following, preparation, rig, self._frames(opened), self._births(rig, counts), known, density=density
        )
        n_points = 0
        with stopping() as stop:
            try:
                for k, (frame, points) in enumerate(steps):
                    if not counts.frames and self.key_points:
                        self._around(frame.ids, frame.positions, rig)
                    append(record, frame)
                    counts.frames.append(frame.index)
                    counts.times.append(frame.time_s)
                    n_points += int(frame.alive.sum())
                    if len(counts.frames) % self.saved_frames == 0:
                        save_state(folder.path, points, counts, record.stat().st_size)
                    folder.keep()
                    seconds = max(time.perf_counter() - begin, 1e-9)
                    rate = f"{int(frame.alive.sum())} points seen, {n_points / seconds:.0f} points/s"
                    progress("following", len(counts.frames), sequence.n_frames, rate if k else "")
                    stop.patient = True
                    if stop.asked and len(counts.frames) < sequence.n_frames:
                        raise KeyboardInterrupt
            except KeyboardInterrupt:
                counts.interrupted = True
        counts.seconds = time.perf_counter() - begin
        return counts

    def _written(self, folder: Path, sequence: Sequence, rig: Rig, counts: Counts) -> FollowOutcome:
        rows, frames, times = read(folder / RECORD, len(rig)), np.array(counts.frames), np.array(counts.times)
        cuts = no_cuts(rows) if self.view is not None else cut_where_false(self.filters, rows, frames, times)
        overview = self._write_tables(folder, rig, (rows, frames, times), cuts)
        figures = {
            "trajectories.png": trajectories_figure(overview, cuts.steps, rig if self.view is None else None),
            "counts.png": counts_figure(overview, times),
        }
        for name, figure in figures.items():
            with replacing(folder / name) as path:
                figure.savefig(path, dpi=110)
        snakes = self._seen_again(folder, sequence, rig, (rows, frames), cuts)
        counts.warnings.extend(warning for snake in snakes if (warning := snake.warning))
        course = Course(counts.seconds, counts.interrupted, tuple(counts.warnings))
        summary = summarized(rows, frames, cuts, course)
        write_json(folder / "follow.json", {"config": described(self), **asdict(summary)})
        write_whole(folder / "report.html", report_html(self.name, summary, folder, flat=self.view is not None))
        return FollowOutcome(folder=folder, **asdict(summary))

    def _write_tables(self, folder: Path, rig: Rig, record: tuple[Rows, Integers, Array], cuts: Cuts) -> Overview:
        names: Names = dict(enumerate(self.points)) if isinstance(self.points, dict) else {}
        flat, times = self.view is not None, record[2]
        markers = cuts.longest(np.array(list(names), dtype=np.int64), 0 if flat else self.most_markers)
        gathering = Gathering(len(times), markers)
        with contextlib.ExitStack() as files:
            table = _opened(files, folder / "trajectories.csv", csv_header(rig.names))
            places = _opened(files, folder / "key_points.csv", KEY_POINTS_HEADER) if self.key_points else None
            around: Surroundings | None = None
            for window in windows(*record, 2 * REACH_FRAMES, cuts.relabelled):
                own, motion = window.trajectories, motion_of(window.trajectories)
                gathering.add(window, motion)
                table.writelines(csv_lines(own, motion, names, window.inner))
                self._write_clouds(folder, window, motion)
                if places is not None:
                    around = around or self._around(own.ids, own.positions[0], rig)
                    found = followed_key_points(own, around)
                    places.writelines(key_points_csv(found, own.frames, own.times, window.inner))
        if not flat:
            shown = gathering.as_markers(marker_labels(markers, names), times)
            write_whole(folder / "trajectories.trc", trc_text(shown, "trajectories.trc"))
            if self.c3d:
                write_c3d(folder / "trajectories.c3d", shown)
        return gathering.overview()

    def _write_clouds(self, folder: Path, window: Window, motion: Motion) -> None:
        own = window.trajectories
        for t in range(*window.inner.indices(len(own.frames))):
            if not own.flat and self.cloud_frames and own.frames[t] % self.cloud_frames == 0:
                write_whole(folder / f"points_{own.frames[t]:06d}.ply", ply_bytes(own, motion, t))

    def _around(self, ids: Integers, positions: Array, rig: Rig) -> Surroundings:
        places = clicked_places(self.key_points, rig)
        return surroundings(ids, positions, list(self.key_points), places, self.key_point_reach_mm / 1000)

    def _seen_again(
        self, folder: Path, sequence: Sequence, rig: Rig, record: tuple[Rows, Integers], cuts: Cuts
    ) -> list[FollowedSnake]:
        """Goes through the images once more: pictures of the points, and snakes that the trajectories lead."""
        rows, frames = record[0], record[1].tolist()
        snakes = [FollowedSnake(name, contour, self._view_of(contour, rig)) for name, contour in self.snakes.items()]
        views, watching = sorted({snake.view for snake in snakes}), prepared_rig(self.surface.preparation, rig)
        wanted, shown = {frames[0], *frames[:: self.picture_frames], frames[-1]}, set(sheet_frames(frames))
        pictures: list[tuple[int, int, Image]] = []
        for frame in self._frames(OpenedFollow(sequence, None)):
            if frame.index > frames[-1]:
                break
            greys = self._shown(frame) if snakes or frame.index in wanted else ()
            now = cuts.relabelled(between(rows, frame.index, frame.index + 1)) if snakes else rows
            for snake in snakes:
                snake.look(self.snake, seen_in(now, watching, snake.view), frame.index, greys[snake.view])
            for view in views if frame.index in shown else ():
                if (grey := greys[view]) is not None:
                    pictures.append((frame.index, view, drawn(snakes, grey, view, frame.index)))
            if frame.index in wanted:
                write_picture(folder / f"points_{frame.index:06d}.jpg", points_picture(greys, rows, frame.index))
        if snakes:
            write_whole(folder / "snakes.csv", "".join(snakes_csv(snakes, rig.names)))
        if pictures:
            write_picture(folder / "snakes.jpg", sheet(snakes, pictures))
        return snakes

    def _shown(self, frame: Frame) -> tuple[Image | None, ...]:
        return prepared(self.following, self.surface.preparation, frame).greys


_NO_NEW = "no new surface could be measured"


def _position(place: object) -> object:
    return tuple(map(float, place)) if isinstance(place, tuple | list) and len(place) == 2 else place


@dataclass(frozen=True)
class OpenedFollow:
    """What a following works on."""

    sequence: Sequence
    state: SavedState | None


@dataclass(frozen=True)
class FollowOutcome(Summary):
    """What a following left; the same numbers are in `follow.json`."""

    folder: Path


def _opened(files: contextlib.ExitStack, path: Path, header: str) -> TextIO:
    """A table that is there as a whole when the stack is left."""
    file = files.enter_context(files.enter_context(replacing(path)).open("w", encoding="utf-8"))
    file.write(header)
    return file
