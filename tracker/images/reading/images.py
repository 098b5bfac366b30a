"""Folders of numbered images, one a view."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pydantic

from tracker.foundation.arrays import Image
from tracker.foundation.configuration.components import PathPattern, ViewPaths, component
from tracker.foundation.errors import SequenceError
from tracker.images.reading._footage import (
    LEAST_FPS,
    MOST_FPS,
    Footage,
    chosen_names,
    chosen_rig,
    numbered_files,
    opened_views,
    view_paths,
)
from tracker.images.reading._opening import Settings, opened, opened_uncalibrated
from tracker.images.reading._pictures import read_image
from tracker.images.reading._sequence import OpenSequence, OpenViews
from tracker.images.reading._timeline import Offsets
from tracker.images.reading.video import plate_of_clip


@component
class ImageReading(Settings):
    """Numbered images; `{view}` stands for the camera's name, `{frame}` for the number, with any leading zeros."""

    path: ViewPaths
    """Image files, for instance `images/{view}/{frame}.png`; numbers need not start at 0. Or a table, one entry a view:
    `{ left = "images/a/{frame}.png", ... }`."""

    fps: float = pydantic.Field(ge=LEAST_FPS, le=MOST_FPS, allow_inf_nan=False)
    """Frames per second."""

    offsets: Offsets = pydantic.Field(default_factory=dict)
    """Position in a view's images, counted from the lowest number of all views, that belongs to frame 0; or pairs of a
    frame and the offset from it on, `{ left = [[0, 3], [120, 2]] }`."""

    in_step: Literal["auto", "long", "off"] = "auto"
    """"auto": the run measures the delay of each view by the movements in its first 100 frames, and corrects it by
    `offsets`. "long": it measures 1000 frames, in which clocks of other rates show. "off": views are paired as they
    are, and poses stay as tracked. Otherwise the run also brings views that the person shows to be late by parts of a
    frame to the first view's moment."""

    masks: PathPattern | None = None
    """Your own silhouettes, in place of plates or beside them, for instance `masks/{view}/{frame}.png`, numbered as the
    images; pixels that are neither black nor transparent are a person."""

    start: int = pydantic.Field(default=0, ge=0)
    """First frame, counted from the lowest number of all views."""

    def open(self) -> OpenSequence:
        """Opens all views; see `tracker.images.reading.Reading.open`."""
        rig = chosen_rig(self.rig, self.views)
        return opened(self, self._footage(rig.names), rig)

    def open_uncalibrated(self) -> OpenViews:
        """Opens all views; see `tracker.images.reading.Reading.open_uncalibrated`."""
        return opened_uncalibrated(self, self._footage(chosen_names(self.views)))

    def _footage(self, names: tuple[str, ...]) -> Footage:
        paths = dict(zip(names, view_paths(self.path, names), strict=True))
        found = opened_views(names, lambda name: numbered_files(name, paths[name]), self.on_missing)
        # one origin for all views: one that lacks its first images must not be shifted against the others
        first = min(min(numbered) for numbered in found if numbered)
        views = tuple(_ImageView(numbered or {}, first) for numbered in found)
        lengths = tuple(max(view.files, default=first - 1) - first + 1 for view in views)
        return Footage(names, self.fps, lengths, lambda: views, plate_of_clip, first)


def intact_image(path: Path) -> Image:
    """A BGR image (h, w, 3).

    Raises:
        SequenceError: it cannot be read as a whole.
    """
    image = read_image(path)
    if image is None:
        raise SequenceError(f"{path}: not an image that can be read: the file is corrupt or truncated")
    return image


@dataclass(frozen=True)
class _ImageView:
    files: dict[int, Path]
    first: int

    def read(self, index: int) -> Image | None:
        path = self.files.get(self.first + index)
        if path is None:
            return None
        return intact_image(path)

    def held(self, index: int) -> Image | None:
        return self.read(index)
