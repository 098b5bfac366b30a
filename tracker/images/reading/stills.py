"""One still picture of each view."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pydantic

from tracker.foundation.arrays import Image
from tracker.foundation.configuration.components import FilePath, PathPattern, component
from tracker.foundation.errors import SequenceError
from tracker.images.reading._footage import Footage, chosen_names, chosen_rig, opened_views, view_paths
from tracker.images.reading._opening import Settings, opened, opened_uncalibrated
from tracker.images.reading._pictures import read_image
from tracker.images.reading._sequence import OpenSequence, OpenViews
from tracker.images.reading.video import plate_of_clip


@component
class StillReading:
    """One picture of each view, taken at one moment: a recording of a single frame."""

    path: PathPattern
    """Image files, for instance `images/{view}.png`; `{view}` stands for the camera's name."""

    rig: FilePath | None = None
    """Calibration: a file or folder in any layout that `bodytrack rig convert` reads; none in a calibration job."""

    views: tuple[str, ...] = ()
    """Cameras to use, in this order; empty for all of the rig."""

    background: PathPattern | None = None
    """Clean plates: images or short clips, for instance `background/{view}.png`."""

    downscale: int = pydantic.Field(default=1, ge=1, le=16)
    """Images are averaged over so many pixels in both directions; the rig follows."""

    def open(self) -> OpenSequence:
        """Opens all views; see `tracker.images.reading.Reading.open`."""
        rig = chosen_rig(self.rig, self.views)
        return opened(self._settings, self._footage(rig.names), rig)

    def open_uncalibrated(self) -> OpenViews:
        """Opens all views; see `tracker.images.reading.Reading.open_uncalibrated`."""
        return opened_uncalibrated(self._settings, self._footage(chosen_names(self.views)))

    @property
    def _settings(self) -> Settings:
        return Settings(path=self.path, background=self.background, downscale=self.downscale, stop=1)

    def _footage(self, names: tuple[str, ...]) -> Footage:
        paths = dict(zip(names, view_paths(self.path, names), strict=True))
        views = tuple(view for view in opened_views(names, lambda name: _still(name, paths[name]), "error") if view)
        return Footage(names, 1.0, (1,) * len(names), lambda: views, plate_of_clip)


def _still(name: str, path: Path) -> _Still:
    if not path.is_file():
        raise SequenceError(f'view "{name}": no file {path}')
    return _Still(path)


@dataclass(frozen=True)
class _Still:
    path: Path

    def read(self, index: int) -> Image | None:
        if index > 0:
            return None
        image = read_image(self.path)
        if image is None:
            raise SequenceError(f"{self.path}: not an image that can be read: the file is corrupt or truncated")
        return image

    def held(self, index: int) -> Image | None:
        return self.read(index)
