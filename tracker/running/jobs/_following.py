"""Start, record and results of a following: points, sightings, pictures and tables."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

import numpy as np

from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.errors import MatchingError, SequenceError
from tracker.foundation.files import replacing, write_whole
from tracker.foundation.progress import Progress
from tracker.images.film import write_picture
from tracker.points.following.births import (
    KEY_POINTS_HEADER,
    Surroundings,
    check_room,
    followed_key_points,
    given_points,
    key_points_csv,
    no_points,
    points_of_image,
    points_of_surface,
    textured_places,
    with_room,
)
from tracker.points.following.filters import Cuts
from tracker.points.following.following import Following
from tracker.points.following.led_snakes import FollowedSnake, Seen, drawn, seen_in, sheet, sheet_frames, snakes_csv
from tracker.points.following.points import NewPoints, Points
from tracker.points.following.record import (
    REACH_FRAMES,
    Motion,
    Rows,
    Window,
    append,
    between,
    motion_of,
    shortened,
    windows,
)
from tracker.points.following.report import Gathering, Overview, points_picture
from tracker.points.following.sequence import Counts, SavedState, prepared, prepared_rig, save_state
from tracker.points.following.snakes import Contour, Snake
from tracker.points.following.tables import Names, csv_header, csv_lines, marker_labels, ply_bytes, trc_text, write_c3d
from tracker.points.surfaces.points import one_a_voxel
from tracker.points.surfaces.surface import Preparation, Surface, SurfaceMeasurement, measure_surface
from tracker.points.trajectories import PointFrame
from tracker.running.jobs import ResultFolder
from tracker.running.jobs._folder import stopping

Places = tuple[tuple[float, float], ...] | dict[str, tuple[float, float]]

_NO_NEW = "no new surface could be measured"


def position(place: object) -> object:
    """Clicked coordinates: whole numbers become fractions; anything else stays."""
    return tuple(map(float, place)) if isinstance(place, tuple | list) and len(place) == 2 else place


@dataclass(frozen=True)
class Born:
    """The points that are followed from a frame on."""

    surface: SurfaceMeasurement
    """Settings of the surface on which points are born."""

    following: Following
    """Settings of the following."""

    rig: Rig
    """The cameras; one in 2-D mode."""

    places: Places
    """Clicked in the first frame, px; empty for all visible points."""

    warnings: list[str]
    """Warnings; those about a surface are added."""

    def first(self, frame: Frame, greys: tuple[Image | None, ...]) -> NewPoints:
        """Points of the first frame.

        Args:
            frame: as recorded.
            greys: its images, prepared for matching.

        Raises:
            TrackerError: there is no surface, or no room around a clicked point.
        """
        names = list(self.places) if isinstance(self.places, dict) else [str(k) for k in range(len(self.places))]
        places = list(self.places.values()) if isinstance(self.places, dict) else list(self.places)
        at = np.array(places, dtype=np.float64).reshape(-1, 2)
        if len(self.rig) == 1:
            assert greys[0] is not None
            return self._in_image(greys[0], at, names)
        surface = self._measured(frame)
        self.warnings.extend(surface.warnings)
        return given_points(surface, self.surface, at, names) if len(at) else points_of_surface(surface)

    def _measured(self, frame: Frame) -> Surface:
        """A surface whose points are centres of their pixels: a centre of gravity of several cannot be followed."""
        surface = measure_surface(replace(self.surface, voxel_mm=None), frame, self.rig)
        if self.surface.voxel_mm is None:
            return surface
        return replace(surface, points=one_a_voxel(surface.points, self.surface.voxel_mm / 1000))

    def _in_image(self, grey: Image, at: Array, names: list[str]) -> NewPoints:
        patch_px = self.following.for_views(1).matching.patch_px
        if len(at):
            check_room(at, names, grey, patch_px)
            return points_of_image(at)
        places = textured_places(grey, self.surface.growth.step_px)
        room = with_room(places, grey, patch_px)
        if not room.any():
            raise MatchingError(
                f"the first image has texture only so near its border that no patch of {patch_px} px around it is "
                "within the image: lower following.alone_patch_px, or choose another reading.start"
            )
        return points_of_image(places[room])

    def later(self, frame: Frame) -> NewPoints:
        """Points of new surface; empty if it cannot be measured, and the following goes on."""
        try:
            return points_of_surface(self._measured(frame))
        except (MatchingError, SequenceError) as error:
            if not any(warning.startswith(_NO_NEW) for warning in self.warnings):
                self.warnings.append(f"{_NO_NEW} in frame {frame.index}, perhaps in later ones neither: {error}")
            return no_points(len(self.rig), float(self.surface.growth.step_px))


# The sightings of a following, recorded frame by frame, with the state from which an interrupted one goes on.

RECORD = "points.bin"
"""File in the result folder."""


def begun(folder: Path, state: SavedState | None) -> Counts:
    """What has been followed so far; the record in the folder then holds exactly that.

    Raises:
        SequenceError: the record is shorter than the state says.
    """
    record = folder / RECORD
    if state is None:
        record.touch()
        return Counts()
    shortened(record, state.n_bytes)
    return Counts(list(state.frames), list(state.times), state.seconds, warnings=list(state.warnings))


def record_sightings(
    steps: Iterable[tuple[PointFrame, Points]],
    folder: ResultFolder,
    counts: Counts,
    planned: tuple[int, int],
    progress: Progress,
) -> None:
    """Writes each frame as it comes, until the last one or a request to stop, which saves the state.

    Args:
        steps: the frames, each with its points.
        folder: place of the record; it is kept from the first frame on.
        counts: frames and points before; these frames are added.
        planned: frames of the recording, and frames between two saved states.
        progress: told how far it is.

    Raises:
        KeyboardInterrupt: the request came before the first frame.
    """
    n_frames, saved_frames = planned
    record, begin, n_points = folder.path / RECORD, time.perf_counter(), 0
    seconds_before = counts.seconds
    with stopping() as stop:
        try:
            for k, (frame, points) in enumerate(steps):
                append(record, frame)
                counts.frames.append(frame.index)
                counts.times.append(frame.time_s)
                n_points += int(frame.alive.sum())
                counts.seconds = seconds_before + time.perf_counter() - begin
                if len(counts.frames) % saved_frames == 0:
                    save_state(folder.path, points, counts, record.stat().st_size)
                folder.keep()
                seconds = max(counts.seconds - seconds_before, 1e-9)
                rate = f"{int(frame.alive.sum())} points seen, {n_points / seconds:.0f} points/s"
                progress("following", len(counts.frames), n_frames, rate if k else "")
                stop.patient = True
                if stop.asked and len(counts.frames) < n_frames:
                    save_state(folder.path, points, counts, record.stat().st_size)
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            if not counts.frames:
                raise
            counts.interrupted = True
    counts.seconds = seconds_before + time.perf_counter() - begin


@dataclass(frozen=True)
class SecondLook:
    """What the images show after all points have been followed."""

    snake: Snake
    """Settings of the contours."""

    contours: dict[str, Contour]
    """The contours, by their names."""

    rig: Rig
    """The cameras in which points were followed."""

    following: Following
    """Settings of the points."""

    preparation: Preparation
    """Size of the images."""

    picture_frames: int
    """Frames from one picture to the next."""

    def greys(self, frame: Frame) -> tuple[Image | None, ...]:
        """The images of a frame as they are matched."""
        return prepared(self.following, self.preparation, frame).greys

    def check(self, greys: tuple[Image | None, ...]) -> None:
        """Begins all snakes, so that a bad contour fails before anything is followed.

        Args:
            greys: images of the first frame, prepared for matching.

        Raises:
            ConfigError: names the contour.
        """
        for snake in self._snakes():
            snake.look(self.snake, Seen(np.zeros(0, np.int64), np.zeros((0, 2))), 0, greys[snake.view])

    def _snakes(self) -> list[FollowedSnake]:
        return [
            FollowedSnake(name, contour, 0 if contour.view is None else self.rig.names.index(contour.view))
            for name, contour in self.contours.items()
        ]

    def take(
        self, folder: Path, images: Iterable[Frame], record: tuple[Rows, Integers], cuts: Cuts
    ) -> list[FollowedSnake]:
        """Follows the snakes, and writes them and the pictures.

        Args:
            folder: place of the files.
            images: all frames of the recording, of the views of the rig.
            record: sightings, and the numbers (T,) of the frames that were followed.
            cuts: of the trajectories.

        Returns:
            The snakes in all frames.
        """
        rows, frames = record[0], record[1].tolist()
        snakes, watching = self._snakes(), prepared_rig(self.preparation, self.rig)
        views = sorted({snake.view for snake in snakes})
        wanted, shown = {frames[0], *frames[:: self.picture_frames], frames[-1]}, set(sheet_frames(frames))
        pictures: list[tuple[int, int, Image]] = []
        for path in folder.glob("points_*.jpg"):  # of this run as it was interrupted, also of its last frame
            path.unlink()
        for frame in images:
            if frame.index > frames[-1]:
                break
            greys = self.greys(frame) if snakes or frame.index in wanted else ()
            now = cuts.relabelled(between(rows, frame.index, frame.index + 1)) if snakes else rows
            for snake in snakes:
                snake.look(self.snake, seen_in(now, watching, snake.view), frame.index, greys[snake.view])
            for view in views if frame.index in shown else ():
                if (grey := greys[view]) is not None:
                    pictures.append((frame.index, view, drawn(snakes, grey, view, frame.index)))
            if frame.index in wanted and any(grey is not None for grey in greys):
                write_picture(folder / f"points_{frame.index:06d}.jpg", points_picture(greys, rows, frame.index))
        if snakes:
            write_whole(folder / "snakes.csv", "".join(snakes_csv(snakes, self.rig.names)))
        if pictures:
            write_picture(folder / "snakes.jpg", sheet(snakes, pictures))
        return snakes

    def places(
        self, images: Iterable[Frame], record: tuple[Rows, Integers], cuts: Cuts, of: tuple[int, int]
    ) -> Iterator[tuple[Image | None, Array]]:
        """The images of a view, prepared for matching, each with the positions of the first points.

        Args:
            images: all frames of the recording.
            record: sightings, and the numbers (T,) of the frames that were followed.
            cuts: of the trajectories.
            of: number of the view, and number of points, N.

        Yields:
            An image (h, w), None if the view has none, and (N, 2) px, NaN for points that are not seen.
        """
        view, n_points = of
        for frame in images:
            if frame.index > record[1][-1]:
                return
            now = cuts.relabelled(between(record[0], frame.index, frame.index + 1))
            own, places = now["id"] < n_points, np.full((n_points, 2), np.nan)
            places[now["id"][own]] = now["pixels"][own, view]
            yield self.greys(frame)[view], places


# Results of a following from its trajectories: tables, clouds, and files for programs that read markers.

Around = Callable[[Integers, Array], Surroundings]
"""The points around the key points, of the ids (N,) and positions (N, 3) m in the first frame."""


@dataclass(frozen=True)
class TrajectoryFiles:
    """Chooses the files."""

    views: tuple[str, ...]
    """Names of the views that were followed; in 2-D mode one, with a table and nothing else."""

    names: Names
    """Names of points."""

    around: Around | None
    """None without key points."""

    cloud_frames: int
    """Frames from one PLY cloud to the next; 0 for none."""

    most_markers: int
    """Largest number of points in TRC and C3D."""

    c3d: bool
    """Whether to write C3D beside TRC."""

    def write(self, folder: Path, record: tuple[Rows, Integers, Array], cuts: Cuts) -> Overview:
        """Reads the record once, and writes.

        Args:
            folder: place of the files.
            record: sightings, all frame numbers (T,), and their times (T,) s.
            cuts: of its trajectories.

        Returns:
            The data of the pictures.
        """
        flat, times = len(self.views) == 1, record[2]
        markers = cuts.longest(np.array(list(self.names), dtype=np.int64), 0 if flat else self.most_markers)
        gathering = Gathering(len(times), markers)
        with contextlib.ExitStack() as files:
            table = _opened(files, folder / "trajectories.csv", csv_header(self.views))
            places = _opened(files, folder / "key_points.csv", KEY_POINTS_HEADER) if self.around else None
            first = between(record[0], int(record[1][0]), int(record[1][0]) + 1)
            # before the cuts, as when the following began: too few points may be left after them
            around = self.around(first["id"].astype(np.int64), first["position"]) if self.around else None
            for window in windows(*record, 2 * REACH_FRAMES, cuts.relabelled):
                own, motion = window.trajectories, motion_of(window.trajectories)
                gathering.add(window, motion)
                table.writelines(csv_lines(own, motion, self.names, window.inner))
                self._write_clouds(folder, window, motion)
                if places is not None and around is not None:
                    found = followed_key_points(own, around)
                    places.writelines(key_points_csv(found, own.frames, own.times, window.inner))
        if not flat:
            shown = gathering.as_markers(marker_labels(markers, self.names), times)
            write_whole(folder / "trajectories.trc", trc_text(shown, "trajectories.trc"))
            if self.c3d:
                write_c3d(folder / "trajectories.c3d", shown)
        return gathering.overview()

    def _write_clouds(self, folder: Path, window: Window, motion: Motion) -> None:
        own = window.trajectories
        for t in range(*window.inner.indices(len(own.frames))):
            if not own.flat and self.cloud_frames and own.frames[t] % self.cloud_frames == 0:
                write_whole(folder / f"points_{own.frames[t]:06d}.ply", ply_bytes(own, motion, t))


def _opened(files: contextlib.ExitStack, path: Path, header: str) -> TextIO:
    """A table that appears as a whole when the stack is left."""
    file = files.enter_context(files.enter_context(replacing(path)).open("w", encoding="utf-8"))
    file.write(header)
    return file
