"""What a calibration's configuration describes, and its execution."""

from __future__ import annotations

import contextlib
import csv
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pydantic

from tracker.arrays import Image
from tracker.calibration import Calibrated, Calibration, Told, report_html, report_text
from tracker.components import PathPattern, component
from tracker.config import build, build_class, read_config
from tracker.errors import ConfigError, SequenceError, nearest
from tracker.frame import Frame
from tracker.reading.images import intact_image, numbered_files
from tracker.reading.video import open_clip
from tracker.rig_layouts import save_rig
from tracker.run import dated_folder, link_latest

_SECTIONS = ("name", "views", "calibration")


@component
class CalibrationViews:
    """Synchronized images of cameras that have no calibration yet."""

    path: PathPattern
    """Videos such as `videos/{view}.mp4`, or images such as `images/{view}/{frame}.png`."""

    names: tuple[str, ...]
    """The cameras; a name stands for `{view}` in the path."""

    offsets: dict[str, int] = pydantic.Field(default_factory=dict)
    """Frame of a view's file that belongs to frame 0, where it is not 0."""

    start: int = pydantic.Field(default=0, ge=0)
    """First frame."""

    stop: int | None = pydantic.Field(default=None, ge=1)
    """Frame after the last one; None for all."""

    stride: int = pydantic.Field(default=1, ge=1)
    """Deliver every so many frames."""

    def open(self) -> OpenViews:
        """Opens all views.

        Raises:
            SequenceError: files are missing or of unequal length.
        """
        if len(self.names) < 1 or len(set(self.names)) < len(self.names):
            raise ConfigError(f"[views] names = {list(self.names)}: expected different names, one a camera")
        for name in self.offsets:
            if name not in self.names:
                raise ConfigError(f'[views] offsets: no view "{name}"; {nearest(name, self.names)}')
        if "{view}" not in self.path and len(self.names) > 1:
            raise ConfigError(f'[views] path = "{self.path}": no {{view}} in it, so all views would show the same')
        sources = tuple(_source(name, Path(self.path.replace("{view}", name))) for name in self.names)
        shifts = tuple(self.offsets.get(name, 0) for name in self.names)
        first = max(0, self.start, *(source.first - shift for source, shift in zip(sources, shifts, strict=True)))
        end = min(source.end - shift for source, shift in zip(sources, shifts, strict=True))
        end = end if self.stop is None else min(end, self.stop)
        if end <= first:
            table = ", ".join(f"{name} {source.end}" for name, source in zip(self.names, sources, strict=True))
            raise SequenceError(f"[views] frames {first} to {end}: nothing to read; the views end at {table}")
        images = next(_images(sources, shifts, range(first, first + 1)))
        sizes = tuple((image.shape[1], image.shape[0]) for image in images if image is not None)
        if len(sizes) < len(sources):
            raise SequenceError(f"[views] frame {first} is missing in a view")
        return OpenViews(self.names, sizes, sources, shifts, range(first, end, self.stride))


@dataclass(frozen=True)
class _Source:
    """One view's files."""

    first: int
    end: int
    path: Path
    files: dict[int, Path] | None

    def images(self, wanted: range, shift: int) -> Iterator[Image | None]:
        """The images of the frames asked for, None for one that is missing."""
        if self.files is not None:
            for index in wanted:
                path = self.files.get(index + shift)
                yield None if path is None else intact_image(path)
            return
        _, _, clip = open_clip(self.path, self.path.stem)
        for index in wanted:
            yield clip.read(index + shift)


@dataclass(frozen=True)
class OpenViews:
    """Opened views; see `tracker.calibration.Views`."""

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    sources: tuple[_Source, ...]
    shifts: tuple[int, ...]
    indices: range

    @property
    def n_frames(self) -> int:
        """Number of frames that `frames()` delivers."""
        return len(self.indices)

    def frames(self) -> Iterator[Frame]:
        """All frames in order."""
        for index, images in zip(self.indices, _images(self.sources, self.shifts, self.indices), strict=True):
            for name, size, image in zip(self.names, self.sizes, images, strict=True):
                if image is not None and (image.shape[1], image.shape[0]) != size:
                    raise SequenceError(
                        f'view "{name}": frame {index} has {image.shape[1]}x{image.shape[0]} px, the first one '
                        f"{size[0]}x{size[1]}"
                    )
            yield Frame(index, float(index), images)


def _images(sources: Sequence[_Source], shifts: Sequence[int], wanted: range) -> Iterator[tuple[Image | None, ...]]:
    streams = [source.images(wanted, shift) for source, shift in zip(sources, shifts, strict=True)]
    yield from zip(*streams, strict=True)


def _source(name: str, path: Path) -> _Source:
    if "{frame}" in path.name:
        files = numbered_files(name, path)
        return _Source(min(files), max(files) + 1, path, files)
    n_frames, _, _ = open_clip(path, name)
    return _Source(0, n_frames, path, None)


@dataclass(frozen=True)
class CalibrationRun:
    """A calibration to make."""

    name: str
    views: CalibrationViews
    calibration: Calibration


Kind = Literal["reference_bar", "chessboard", "scene_points"]


def load_calibration(path: Path, kind: Kind, overrides: Sequence[str] = ()) -> CalibrationRun:
    """Reads a calibration's configuration.

    Args:
        path: TOML file; relative paths in it start at its folder.
        kind: the component it must describe.
        overrides: `section.key=value`.

    Raises:
        ConfigError: names file, section, key and the nearest valid one.
    """
    table: dict[str, Any] = read_config(path, overrides)
    for key in table:
        if key not in _SECTIONS:
            raise ConfigError(f'{path.name}: unknown section "{key}"; {nearest(key, _SECTIONS)}')
    for key in ("views", "calibration"):
        if not isinstance(table.get(key), dict):
            raise ConfigError(f"{path.name}: the section [{key}] is missing; see configs/calibration/bar.toml")
    use = table["calibration"].get("use", kind)
    if use != kind and ":" not in str(use):
        raise ConfigError(f'{path.name} [calibration]: use = "{use}", but "{kind}" was asked for')
    return CalibrationRun(
        name=str(table.get("name", path.stem)),
        views=build_class(CalibrationViews, table["views"], f"{path.name} [views]", path.parent),
        calibration=build("calibration", table["calibration"], f"{path.name} [calibration]", path.parent, kind),
    )


@dataclass(frozen=True)
class CalibrationResult:
    """What a calibration left."""

    folder: Path
    calibrated: Calibrated


def calibrate(run: CalibrationRun, output: Path | None, told: Told) -> CalibrationResult:
    """Calibrates and writes `rig.toml`, `report.html`, `report.txt` and `residuals.csv`, all of them or none.

    Args:
        run: what to do.
        output: result folder; None for `results/<name>/<time>`, with the link `latest`.
        told: told of the progress.

    Raises:
        TrackerError: nothing is written then.
    """
    folder = output or dated_folder(run.name)
    if folder.exists() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty: choose another --output")
    calibrated = run.calibration.calibrate(run.views.open(), told)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".unfinished_", dir=folder.parent) as unfinished:
        _write(run.name, calibrated, Path(unfinished))
        with contextlib.suppress(OSError):
            folder.rmdir()
        shutil.copytree(unfinished, folder)
    if output is None:
        link_latest(folder)
    return CalibrationResult(folder, calibrated)


def _write(name: str, calibrated: Calibrated, folder: Path) -> None:
    save_rig(calibrated.rig, folder / "rig.toml")
    (folder / "report.txt").write_text(report_text(name, calibrated), encoding="utf-8")
    (folder / "report.html").write_text(report_html(name, calibrated), encoding="utf-8")
    adjustment = calibrated.adjustment
    with (folder / "residuals.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["view", "point", "u", "v", "residual_u", "residual_v", "used"])
        rows = adjustment.observations
        for k, (view, point, pixel) in enumerate(zip(rows.views, rows.points, rows.pixels, strict=True)):
            numbers = [f"{value:.4f}" for value in (*pixel, *adjustment.errors[k])]
            writer.writerow([adjustment.names[view], point, *numbers, int(adjustment.used[k])])
