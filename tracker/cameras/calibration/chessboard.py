"""A chessboard or ChArUco board moved before the cameras: OpenCV's detection, our bundle adjustment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
import pydantic

from tracker.cameras.calibration._adjustment import Adjustment, Calibrated, Measure
from tracker.cameras.calibration._board_start import BoardSearch, LensKind, board_start, patterns_of
from tracker.cameras.calibration._boards import Pattern, SeenCorners, charuco_detector, turns_of
from tracker.cameras.calibration._objects import Boards
from tracker.cameras.calibration._report import advice
from tracker.cameras.calibration._self_calibration import chosen_unknowns, self_calibrated
from tracker.cameras.calibration._world import WorldFrame, square_fault
from tracker.cameras.camera import told_end
from tracker.cameras.frame import Views
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError
from tracker.foundation.progress import Progress

__all__ = ["BoardImages", "ChessboardCalibration"]

Group = Literal["camera_constant", "principal_point", "affinity", "radial", "decentring"]

_WIDE_DEG, _BAD_FIT = 80.0, 1.5
"""Largest residual, as a share of a view's width, and times sigma_px: three radial terms follow a fisheye lens no
farther."""


@dataclass(frozen=True)
class BoardImages:
    """Images of the corners of a board."""

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    seen: SeenCorners


@component
class ChessboardCalibration:
    """Calibration from a flat board of known squares, moved and tilted before the cameras."""

    single_views: ClassVar[bool] = True
    """Frames of only one camera determine its interior; see `running.jobs.calibrate.CalibrateJob.interiors`."""

    columns: int = pydantic.Field(default=9, ge=3)
    """Chessboard: inner corners along a row. ChArUco: squares along a row. A number, no unit."""

    rows: int = pydantic.Field(default=6, ge=3)
    """Chessboard: rows of inner corners. ChArUco: rows of squares."""

    square_m: float = pydantic.Field(gt=0)
    """Side of a square, metres: the scale."""

    marker_m: float | None = pydantic.Field(default=None, gt=0)
    """ChArUco: side of a marker, metres; None for a plain chessboard."""

    dictionary: str = "4x4_50"
    """ChArUco: OpenCV's dictionary of markers, for instance `4x4_50`."""

    legacy: bool | None = None
    """ChArUco with an even number of rows: whether it begins with a white square, as OpenCV drew it before 4.6; None:
    the pictures decide."""

    inverted: bool = False
    """Whether the board is printed white on black."""

    both_sides: bool = False
    """ChArUco: whether the back shows the same board as if seen through the front, so that cameras behind see it."""

    sigma_px: float = pydantic.Field(default=0.2, gt=0)
    """Expected standard deviation of an image coordinate, px."""

    lens: LensKind = "pinhole"
    """Kind of the lenses: `fisheye` for those that see 100 degrees and more, as sports cameras do."""

    estimated: tuple[Group, ...] = ("camera_constant", "principal_point", "affinity", "radial", "decentring")
    """Parameters to determine beside the exterior orientation; those that cannot be are named and held."""

    world: WorldFrame = pydantic.Field(default_factory=WorldFrame)
    """The world frame."""

    @pydantic.field_validator("square_m", "marker_m")
    @classmethod
    def _is_in_metres(cls, length_m: float | None) -> float | None:
        if length_m is not None and (fault := square_fault(length_m)):
            raise ValueError(fault)
        return length_m

    def calibrate(self, views: Views, progress: Progress) -> Calibrated:
        """Finds the board in the views and adjusts; see `tracker.cameras.calibration.Calibration.calibrate`."""
        search = BoardSearch(views.names, self._patterns(), self.square_m, self.both_sides)
        pictures: dict[str, Image] = {}
        for k, frame in enumerate(views.frames()):
            progress("finding boards", k + 1, views.n_frames)
            for v, image in enumerate(frame.images):
                if image is not None:
                    pictures.setdefault(views.names[v], image)
                    search.look(v, frame.index, image)
            search.after(k + 1)
        search.finish()
        found = self.calibrate_images(BoardImages(views.names, views.sizes, search.seen), pictures)
        return replace(found, found_out="legacy = true" if self.legacy is None and search.patterns[0].legacy else "")

    def calibrate_images(self, images: BoardImages, pictures: dict[str, Image] | None = None) -> Calibrated:
        """Adjusts detected corners.

        Raises:
            CalibrationError: they are too few or do not fit together.
        """
        size = self.columns, self.rows
        turns = turns_of(*size, self.square_m) if self.marker_m is None else turns_of(0, 1, self.square_m)
        start, observations = board_start(images.seen, images.names, images.sizes, self.lens, turns)
        views = list(zip(images.names, images.sizes, strict=True))
        wanted = chosen_unknowns(self.estimated, len(views))
        adjustment = self_calibrated(start, observations, wanted, self.sigma_px, views)
        self._check_focal_lengths(adjustment)
        points = adjustment.state.objects.points
        _, motion, source = self.world.placed(Rig(adjustment.cameras), None, np.median(points, axis=0))
        adjustment = adjustment.in_world(motion)
        n_boards = len({frame for _, frame in images.seen})
        return Calibrated(
            kind="chessboard",
            adjustment=adjustment,
            n_objects=n_boards,
            measures=_distance_measures(adjustment),
            advice=(*self._about_the_lens(adjustment), *advice(adjustment, "board", n_boards)),
            world=source,
            pictures=pictures or {},
            scale=f"square_m = {self.square_m:g}",
            points=adjustment.state.objects.points,
        )

    def _check_focal_lengths(self, adjustment: Adjustment) -> None:
        """A camera constant that was held is a guess here, because none was given."""
        open_ = [held.camera for held in adjustment.held if held.parameter == "camera constant"]
        if open_:
            raise CalibrationError(
                f"{', '.join(open_)}: the positions of the board leave the focal length, and with it distances, open: "
                "hold it near, turned by 20 to 45 degrees to all sides, also alone before this camera ([interiors])"
            )

    def _about_the_lens(self, adjustment: Adjustment) -> Iterator[str]:
        """Advice if wide views fit badly."""
        wide = [camera.name for camera in adjustment.cameras if camera.field_deg[0] > _WIDE_DEG]
        if self.lens == "pinhole" and wide and adjustment.s0 > _BAD_FIT:
            yield (
                f"{', '.join(wide)}: more than {_WIDE_DEG:.0f} degrees wide, and the board is off by "
                f'{adjustment.s0:.1f} times sigma_px: try lens = "fisheye"'
            )
        yield from filter(None, map(told_end, adjustment.cameras))

    def _patterns(self) -> tuple[Pattern, ...]:
        """Possible patterns of the board.

        Raises:
            CalibrationError: a marker is not smaller than a square, or there is no such dictionary of markers.
        """
        if self.marker_m is None:
            given = [key for key in ("legacy", "both_sides") if getattr(self, key)]
            if given:
                raise CalibrationError(f"{given[0]} = true is of use with a ChArUco board only, which has a marker_m")
            return (Pattern(self.columns, self.rows, inverted=self.inverted),)
        if not self.marker_m < self.square_m:
            raise CalibrationError(f"marker_m = {self.marker_m:g}, expected less than square_m = {self.square_m:g}")
        marker = self.marker_m / self.square_m
        pattern = Pattern(self.columns, self.rows, marker, self.dictionary, inverted=self.inverted)
        charuco_detector(pattern)
        return patterns_of(pattern, self.legacy)


def _distance_measures(adjustment: Adjustment) -> tuple[Measure, ...]:
    """Distances between triangulated corners beside those of the board: what a user of the rig would measure."""
    boards, observations = adjustment.state.objects, adjustment.observations
    assert isinstance(boards, Boards)
    if len(adjustment.names) < 2:
        return ()
    pixels = np.full((len(adjustment.names), len(boards.shape), 2), np.nan)
    used = adjustment.used
    pixels[observations.views[used], observations.points[used]] = observations.pixels[used]
    points, _ = Rig(adjustment.cameras).triangulate(pixels)
    ratios, errors = [], []
    for g in range(len(boards.poses)):
        mine = np.flatnonzero((boards.owners == g) & np.isfinite(points).all(axis=1))
        found = np.linalg.norm(points[mine][:, None] - points[mine], axis=2)
        wanted = np.linalg.norm(boards.shape[mine][:, None] - boards.shape[mine], axis=2)
        pairs = np.triu(wanted, 1) > 0
        ratios.append(found[pairs] / wanted[pairs])
        errors.append(found[pairs] - wanted[pairs])
    ratio, error = np.concatenate(ratios), np.concatenate(errors)
    if not len(ratio):
        return ()
    low, middle, high = np.percentile(ratio, [25, 50, 75])
    return (
        Measure("board distances, median", 100 * (float(middle) - 1), "%", "measured with the rig, over those known"),
        Measure("board distances, quartiles", 100 * float(high - low), "%", "from the lower to the upper quartile"),
        Measure("board distances, RMS", 1000 * float(np.sqrt(np.mean(error**2))), "mm", f"{len(error)} distances"),
    )
