"""The images of a following gone through once more: pictures of its points, and snakes that trajectories lead."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image, Integers
from tracker.foundation.files import write_whole
from tracker.images.picture_files import write_picture
from tracker.points.following.filters import Cuts
from tracker.points.following.following import Following
from tracker.points.following.led_snakes import FollowedSnake, Seen, drawn, seen_in, sheet, sheet_frames, snakes_csv
from tracker.points.following.record import Rows, between
from tracker.points.following.report import points_picture
from tracker.points.following.sequence import prepared, prepared_rig
from tracker.points.following.snakes import Contour, Snake
from tracker.points.surfaces.views import Preparation


@dataclass(frozen=True)
class SecondLook:
    """What is looked for in the images when all points have been followed."""

    snake: Snake
    """How contours are followed."""

    contours: dict[str, Contour]
    """The contours, by their names."""

    rig: Rig
    """The cameras that points were followed in."""

    following: Following
    """How they were."""

    preparation: Preparation
    """Of the images."""

    picture_frames: int
    """Frames from one picture to the next."""

    def greys(self, frame: Frame) -> tuple[Image | None, ...]:
        """The images of a frame as they are matched."""
        return prepared(self.following, self.preparation, frame).greys

    def check(self, greys: tuple[Image | None, ...]) -> None:
        """Begins all snakes, so that a contour that is none is told before anything is followed.

        Args:
            greys: images of the first frame, as they are matched.

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
            folder: where they go.
            images: all frames of the recording, of the views of the rig.
            record: sightings, and the numbers (T,) of the frames that were followed.
            cuts: of the trajectories.

        Returns:
            The snakes as they went.
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
