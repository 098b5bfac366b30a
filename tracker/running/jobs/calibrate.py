"""Calibration: a rig from a recording of a bar, a board or measured points, with a report."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal, Self

import pydantic

from tracker.cameras.calibration import Calibrated, Calibration, report_html, report_text
from tracker.cameras.frame import Frame, Views
from tracker.cameras.rig_check import check_rig
from tracker.cameras.rig_layouts import FARTHEST_M, save_rig
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError, ConfigError, nearest
from tracker.foundation.files import write_whole
from tracker.foundation.progress import Progress
from tracker.images.reading import Reading
from tracker.running.jobs import ResultFolder, job_from, read_own


@dataclass(frozen=True)
class ThenAlone:
    """The common recording, followed by those of single cameras, in which the other cameras have no image."""

    common: Views
    alone: tuple[tuple[int, Views], ...]
    """Number of a camera, and its own recording."""

    @property
    def names(self) -> tuple[str, ...]:
        """The views in order."""
        return self.common.names

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Image widths and heights, px."""
        return self.common.sizes

    @property
    def n_frames(self) -> int:
        """Frames of all the recordings."""
        return self.common.n_frames + sum(views.n_frames for _, views in self.alone)

    def frames(self) -> Iterator[Frame]:
        """Frames of the common recording, then of the others; the numbers are unique."""
        last = -1
        for frame in self.common.frames():
            last = max(last, frame.index)
            yield frame
        numbers = itertools.count(last + 1)
        for view, views in self.alone:
            for frame in views.frames():
                images = tuple(frame.images[0] if v == view else None for v in range(len(self.names)))
                yield replace(frame, index=next(numbers), images=images)


def then_alone(common: Views, reading: Reading) -> ThenAlone:
    """Opens the recordings of single cameras. These need neither be synchronous nor of equal length.

    Args:
        common: recording of all cameras.
        reading: its `views` choose the cameras that have a recording; empty for all.

    Raises:
        ConfigError: it chooses none of the views.
        CalibrationError: an image size differs from the common recording.
        SequenceError: a file is missing or damaged.
    """
    if not dataclasses.is_dataclass(reading) or not hasattr(reading, "views"):
        raise ConfigError("[interiors]: a reading that has `views` is needed: video or images")
    chosen = tuple(reading.views) or common.names
    unknown = next((name for name in chosen if name not in common.names), None)
    if unknown is not None:
        raise ConfigError(f'[interiors]: views: "{unknown}"; {nearest(unknown, common.names)}')
    alone = []
    for name in chosen:
        view = common.names.index(name)
        opened = replace(reading, views=(name,)).open_uncalibrated()
        if opened.sizes[0] != common.sizes[view]:
            found, expected = ("x".join(map(str, size)) for size in (opened.sizes[0], common.sizes[view]))
            raise CalibrationError(
                f'camera "{name}": its own recording has {found} px, the common one {expected}: the interior holds for '
                "one image size only"
            )
        alone.append((view, opened))
    return ThenAlone(common, tuple(alone))


@component
class CalibrateJob:
    """Calibrates cameras: `rig.toml`, a report of its weaknesses, and the residuals."""

    resumable: ClassVar[bool] = False

    name: str = "calibrate"
    """Name of the results' folder: `results/NAME/TIME`."""

    reading: Reading = pydantic.Field(
        examples=['{ use = "video", path = "{view}.mp4", views = ["left", "right"] }; see configs/calibration/bar.toml']
    )
    """The recording; it has no `rig`, and `views` names the cameras."""

    calibration: Calibration = pydantic.Field(
        examples=['{ use = "reference_bar", length_m = 1.0 }; see configs/calibration/bar.toml']
    )
    """Target that the cameras saw: a bar, a board or measured points."""

    interiors: Reading | None = pydantic.Field(
        default=None, examples=['{ use = "video", path = "alone/{view}.mp4" }; see configs/calibration/charuco.toml']
    )
    """Recordings in which each camera sees the board alone, near and in all corners. They calibrate its lens, and need
    not be synchronous. Focus and zoom must be those of the common recording. Only with a chessboard."""

    @pydantic.field_validator("reading", "interiors")
    @classmethod
    def _is_not_calibrated(cls, reading: Reading | None) -> Reading | None:
        if getattr(reading, "rig", None) is not None:
            raise ValueError('the key "rig" is of no use: the job calibrates the cameras that `views` names')
        return reading

    @pydantic.model_validator(mode="after")
    def _has_a_board(self) -> Self:
        if self.interiors is not None and not getattr(self.calibration, "single_views", False):
            raise ValueError(
                'the section "interiors" is of use with a chessboard only, [calibration] use = "chessboard"'
            )
        return self

    def open(self, earlier: Path | None = None) -> Views:
        """Opens the views; see `tracker.running.jobs.Job.open`."""
        common = self.reading.open_uncalibrated()
        return common if self.interiors is None else then_alone(common, self.interiors)

    def execute(self, opened: Views, folder: ResultFolder, progress: Progress) -> CalibrateOutcome:
        """Calibrates; see `tracker.running.jobs.Job.execute`."""
        calibrated = looked_over(self.calibration.calibrate(opened, progress))
        save_rig(calibrated.rig, folder.path / "rig.toml")
        write_whole(folder.path / "report.txt", report_text(self.name, calibrated))
        write_whole(folder.path / "report.html", report_html(self.name, calibrated))
        write_whole(folder.path / "residuals.csv", _residuals(calibrated))
        return CalibrateOutcome(folder.path, calibrated)


@dataclass(frozen=True)
class CalibrateOutcome:
    """Outcome of a calibration."""

    folder: Path
    calibrated: Calibrated


def looked_over(calibrated: Calibrated) -> Calibrated:
    """The outcome; warnings of `bodytrack rig check` about the rig come before its advice.

    Raises:
        CalibrationError: the cameras are hundreds of metres apart, and no reader would accept the rig.
    """
    found = check_rig(calibrated.rig)
    widest = max(found.pairs, key=lambda pair: pair.distance_m, default=None)
    if widest is not None and widest.distance_m > FARTHEST_M:
        raise CalibrationError(
            f"{widest.first} and {widest.second} come out {widest.distance_m:.0f} m apart, expected a room: "
            f"{calibrated.scale or 'the lengths'} told the scale; is it in metres?"
        )
    return replace(calibrated, advice=(*found.doubts, *calibrated.advice))


def _residuals(calibrated: Calibrated) -> str:
    """A CSV table of the adjusted image points."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["view", "point", "u", "v", "residual_u", "residual_v", "used"])
    adjustment = calibrated.adjustment
    rows = adjustment.observations
    for k, (view, point, pixel) in enumerate(zip(rows.views, rows.points, rows.pixels, strict=True)):
        numbers = [f"{value:.4f}" for value in (*pixel, *adjustment.errors[k])]
        writer.writerow([adjustment.names[view], point, *numbers, int(adjustment.used[k])])
    return text.getvalue()


Kind = Literal["reference_bar", "chessboard", "scene_points"]


def load_calibration(path: Path, kind: Kind, overrides: Sequence[str] = ()) -> CalibrateJob:
    """Reads the configuration of a calibration of a kind; the file need not name the kind.

    Args:
        path: TOML file; relative paths in it start at its folder.
        kind: the component that `[calibration]` must describe.
        overrides: `section.key=value`.

    Raises:
        ConfigError: names file, section, key and the nearest valid one.
    """
    table = read_own("calibrate", path, overrides)
    section = table.get("calibration")
    if isinstance(section, dict):
        use = section.setdefault("use", kind)
        if use != kind and ":" not in str(use):
            raise ConfigError(f'{path.name} [calibration]: use = "{use}", but "{kind}" was asked for')
    job: CalibrateJob = job_from("calibrate", table, path.name, path.parent, path.stem)
    return job
