"""Surface measurement from two or more images of one moment (D'Apuzzo, Plaenkers, Fua 2000, section 2.2)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
import pydantic

from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Image
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError, MatchingError, SequenceError, nearest
from tracker.foundation.progress import Progress, silent, within
from tracker.images.operations.appearance import wallis_filter
from tracker.points.surfaces import LeastSquaresMatching, Matches, PatchImage
from tracker.points.surfaces.growth import Growth, MatchField, corrected_for_curvature
from tracker.points.surfaces.points import (
    Attempt,
    Coverage,
    NeighbourhoodFilter,
    SurfacePoints,
    coverage_of,
    intersect,
    voxel_filtered,
)
from tracker.points.surfaces.seeds import Candidates, Seeds, matched_seeds

# Grey levels between the darkest and the brightest percentile: a lens cap's noise.
_BLANK_GREY = 3.0
# What is added to measure how much is there already.
_BLUR_TEST_PX = 1.5
# Against the noise of single pixels, which would be taken for sharpness; taken off again.
_PRESMOOTHING_PX = 0.8


@dataclass(frozen=True)
class PreparedView:
    """An image with its camera, ready to be matched."""

    camera: Camera
    """Of this image: of a field if only odd lines are used."""

    picture: Image
    """(h, w, 3) BGR."""

    grey: Array32
    """(h, w) grey levels."""

    enhanced: Array32 | None = None
    """(h, w) grey levels of enhanced local contrast, if that is wanted."""

    @property
    def grey8(self) -> Image:
        """(h, w) grey levels in whole numbers, of enhanced contrast if there are such."""
        grey = self.grey if self.enhanced is None else self.enhanced
        return np.clip(np.round(grey), 0, 255).astype(np.uint8)

    @property
    def greys(self) -> tuple[Array32, ...]:
        """What is matched, one after the other: the image, then that of enhanced contrast."""
        return (self.grey,) if self.enhanced is None else (self.grey, self.enhanced)


@component
class Preparation:
    """Preparation of the images before matching."""

    odd_lines_only: bool = False
    """Interlaced images: use the 1st, 3rd, 5th ... line alone, which were all taken at one time.

    Pixel positions, of all that is clicked and in results, are then those of the images of half the height.
    """

    enhance_contrast: bool = False
    """Wallis filter, for images of poor texture such as skin: what the images as they are leave open is matched again.

    It enhances the noise too: matched instead of the images it measured 8 to 18 % fewer points of three recordings,
    after them 1 to 5 % more.
    """

    window_px: int = pydantic.Field(default=31, ge=5, le=501)
    """Side of the window of the local contrast, odd, px."""

    contrast_grey: float = pydantic.Field(default=40.0, gt=0)
    """Local standard deviation aimed at, grey levels."""

    expansion: float = pydantic.Field(default=0.8, gt=0, lt=1)
    """Constant e of the filter: the contrast is raised e / (1 - e) times at most; near 1 it is the same everywhere."""

    max_blur_px: float = pydantic.Field(default=2.5, gt=0)
    """Images whose edges are wider than this (standard deviation) are refused as blurred, px."""

    def views(self, frame: Frame, rig: Rig) -> tuple[PreparedView, ...]:
        """The views of a frame, in the rig's order.

        Raises:
            SequenceError: a view has no image in this frame.
            MatchingError: an image is blank or blurred.
        """
        return tuple(self._view(camera, image, frame) for camera, image in zip(rig.cameras, frame.images, strict=True))

    def _view(self, camera: Camera, image: Image | None, frame: Frame) -> PreparedView:
        if image is None:
            raise SequenceError(f'view "{camera.name}" has no image in frame {frame.index}')
        if self.odd_lines_only:
            camera, image = field_camera(camera), image[::2]
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
        picture = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        self._check(camera.name, grey)
        enhanced = None
        if self.enhance_contrast:
            enhanced = wallis_filter(grey, self.window_px | 1, self.contrast_grey, self.expansion)
        return PreparedView(camera, picture, grey.astype(np.float32), enhanced)

    def _check(self, name: str, grey: Image) -> None:
        darkest, brightest = np.percentile(grey, (0.5, 99.5))
        if brightest - darkest < _BLANK_GREY:
            raise MatchingError(
                f'view "{name}": a blank image (grey levels {darkest:.0f} to {brightest:.0f}): was the lens covered?'
            )
        blur = blur_px(grey)
        if blur > self.max_blur_px:
            raise MatchingError(
                f'view "{name}": a blurred image: its edges are about {blur:.1f} px wide (standard deviation), '
                f"expected less than {self.max_blur_px:g}: out of focus, or moved? take a sharp image, use smaller "
                "ones (reading.downscale), or raise preparation.max_blur_px"
            )


def field_camera(camera: Camera) -> Camera:
    """The camera of every second line of its images, from the first line on."""
    matrix = np.array(camera.matrix)
    matrix[1] /= 2
    return replace(camera, matrix=matrix, size=(camera.size[0], (camera.size[1] + 1) // 2))


def blur_px(grey: Image | Array32) -> float:
    """About how wide the edges of an image (h, w) are, standard deviation in px.

    Blurring by s lowers the energy of the gradients at edges of width b to ``b / sqrt(b^2 + s^2)`` of what it was.
    """
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _PRESMOOTHING_PX)
    energy = _gradient_energy(smooth)
    if energy <= 0:
        return np.inf
    left = _gradient_energy(cv2.GaussianBlur(smooth, (0, 0), _BLUR_TEST_PX)) / energy
    width2 = (_BLUR_TEST_PX * left) ** 2 / max(1 - left * left, 1e-6)
    return float(np.sqrt(max(width2 - _PRESMOOTHING_PX**2, 0.0)))


def _gradient_energy(grey: Array32) -> float:
    dx, dy = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    return float(np.mean(dx * dx + dy * dy))


@dataclass(frozen=True)
class Surface:
    """A measured surface, and what it was measured from."""

    points: SurfacePoints
    views: tuple[PreparedView, ...]
    template: int
    """Index of the view that the others were compared with."""

    fields: tuple[MatchField | None, ...]
    """Matches of each view after filtering, None for the template."""

    coverages: tuple[Coverage | None, ...]
    """How far the measurement of each view reached, None for the template, and for views of which nothing matched."""

    unmatched: tuple[str, ...] = ()
    """Why nothing of a view matched, where `min_views` does without it."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for users of the surface."""
        names = [view.camera.name for view in self.views]
        said = [
            coverage.warning(names[self.template], name)
            for name, coverage in zip(names, self.coverages, strict=True)
            if coverage is not None
        ]
        return (*self.unmatched, *(warning for warning in said if warning))


@component
class SurfaceMeasurement:
    """Settings of a surface measurement."""

    template: str | None = None
    """View that the others are compared with; None for the one in the middle of the views."""

    min_views: int | None = pydantic.Field(default=None, ge=2)
    """Views, the template included, that must show a point; None for all."""

    max_residual_px: float = pydantic.Field(default=0.5, gt=0)
    """Points whose rays miss one another by more (RMS of the reprojection) are mismatches, px."""

    max_sigma_mm: float | None = pydantic.Field(default=None, gt=0)
    """Points less precise than this are left out, mm; None keeps all."""

    voxel_mm: float | None = pydantic.Field(default=None, gt=0)
    """Points within a voxel of that side are replaced by their centre of gravity, mm; None keeps all."""

    correct_curvature: Literal["auto"] | bool = "auto"
    """Correct the matches for the curvature of the surface within a patch; `auto`: as far as neighbours agree on it.

    A smooth surface is measured up to 2.5 times more precisely, most so with large patches; rough ones are noisier
    where all is corrected (true), and hardly are where neighbours must agree.
    """

    preparation: Preparation = pydantic.Field(default_factory=Preparation)
    """Preparation of the images."""

    matching: LeastSquaresMatching = pydantic.Field(default_factory=LeastSquaresMatching)
    """Finding of a patch in another view."""

    seeds: Seeds = pydantic.Field(default_factory=Seeds)
    """Search for the first matches."""

    growth: Growth = pydantic.Field(default_factory=Growth)
    """Spread of matches."""

    neighbourhood: NeighbourhoodFilter = pydantic.Field(default_factory=NeighbourhoodFilter)
    """Removal of matches that contradict their neighbours."""

    def template_of(self, rig: Rig) -> int:
        """Index of the template view.

        Raises:
            ConfigError: there is no such view, or no second one.
        """
        if len(rig) < 2:
            raise ConfigError("a surface is measured from two or more views, the rig has one")
        if self.min_views is not None and self.min_views > len(rig):
            raise ConfigError(f"min_views = {self.min_views}: there are {len(rig)} views")
        if self.template is None:
            return len(rig) // 2 if len(rig) > 2 else 0
        if self.template not in rig.names:
            raise ConfigError(f'template = "{self.template}": no such view; {nearest(self.template, rig.names)}')
        return rig.names.index(self.template)


def measure_surface(measurement: SurfaceMeasurement, frame: Frame, rig: Rig, progress: Progress = silent) -> Surface:
    """Measures the surface that the views of a frame show.

    Prepare the images; per search image: seeds, growth, neighbourhood filter, re-measurement; then merge,
    forward ray intersection, voxel filter.

    Args:
        measurement: its parameters.
        frame: images of all cameras of the rig.
        rig: the cameras.
        progress: gets the progress.

    Raises:
        SequenceError: a view has no image.
        MatchingError: fewer images than must show a point show a common surface that can be measured; why is said.
        ConfigError: the parameters do not fit the rig.
    """
    template = measurement.template_of(rig)
    progress("preparing the images", 0, 1)
    views = measurement.preparation.views(frame, rig)
    images = tuple(tuple(map(measurement.matching.prepared, view.greys)) for view in views)
    progress("preparing the images", 1, 1)
    fields: list[MatchField | None] = [None] * len(views)
    attempts: list[Attempt | None] = [None] * len(views)
    min_views, unmatched = measurement.min_views or len(views), list[str]()
    for v in range(len(views)):
        if v != template:
            pairs = tuple(zip(images[template], images[v], strict=True))
            try:
                fields[v], attempts[v] = _matched(measurement, (views[template], views[v]), pairs, progress)
            except MatchingError as error:
                unmatched.append(str(error))
                if len(views) - len(unmatched) < min_views:
                    raise
                fields[v] = MatchField.empty(pairs[0][0].size, measurement.growth.step_px)
    cameras = tuple(view.camera for view in views)
    points = intersect(cameras, template, fields, min_views, measurement.max_residual_px)
    reach_px = max(measurement.growth.step_px, measurement.matching.patch_px / 2)
    coverages = tuple(None if a is None else coverage_of(a, points.pixels[template], reach_px) for a in attempts)
    n_points, points = len(points), _finished(measurement, _coloured(points, views[template], template))
    if n_points and len(points) == 0:
        raise MatchingError(
            f"none of {n_points} points is as precise as {measurement.max_sigma_mm:g} mm (max_sigma_mm): raise it, or "
            "set views farther from one another"
        )
    if len(points) == 0:
        raise MatchingError(
            f"no point was matched in {min_views} views with rays that meet within {measurement.max_residual_px:g} px: "
            "is this the rig of these images? lower min_views if not all views show the surface"
        )
    return Surface(points, views, template, tuple(fields), coverages, tuple(unmatched))


_Pairs = tuple[tuple[PatchImage, PatchImage], ...]
"""Template and search image as they are, then of enhanced contrast if that is wanted."""


def _matched(
    measurement: SurfaceMeasurement, views: tuple[PreparedView, PreparedView], pairs: _Pairs, progress: Progress
) -> tuple[MatchField, Attempt]:
    """Seeds, growth and neighbourhood filter for one search image."""
    growth, neighbourhood = measurement.growth, measurement.neighbourhood
    label = f"{views[0].camera.name} - {views[1].camera.name}"
    progress = within(progress, label)
    progress("seeds", 0, len(MatchField.empty(pairs[0][0].size, growth.step_px).ended))
    cameras = views[0].camera, views[1].camera
    candidates = measurement.seeds.candidates((views[0].grey8, views[1].grey8), cameras)
    seeds, faults = _seeds(measurement, candidates, pairs)
    if not any(len(own.at) for own in seeds):
        raise MatchingError(
            f"views {label}: none of {len(candidates.at)} approximate seed points could be matched "
            f"({Counter(faults).most_common(1)[0][0]}): is the perspective too different for matching.patch_px, or are "
            "the limits of [growth] too strict?"
        )
    field = MatchField.empty(pairs[0][0].size, growth.step_px)
    for own, images in zip(seeds, pairs, strict=True):
        field = growth.grown(measurement.matching, images, own, progress, field)
    for _ in range(neighbourhood.rounds):
        field = field.without(neighbourhood.doubtful(field))
        for images in pairs:
            field = growth.continued(measurement.matching, images, field, within(progress, "again"))
    field = field.without(neighbourhood.doubtful(field))
    if measurement.correct_curvature:
        field = corrected_for_curvature(field, where_consistent=measurement.correct_curvature == "auto")
    return field, Attempt(candidates.at, sum(len(own.at) for own in seeds), faults)


def _seeds(
    measurement: SurfaceMeasurement, candidates: Candidates, pairs: _Pairs
) -> tuple[list[Matches], tuple[str, ...]]:
    """Good seeds of each pair of images, every candidate in the first that shows it, and why the rest failed."""
    good, faults = [], tuple[str, ...]()
    for images in pairs:
        seeds = matched_seeds(candidates, measurement.matching, measurement.growth, images)
        good.append(seeds.matches)
        candidates, faults = seeds.failed, seeds.faults
    return good, faults


def _coloured(points: SurfacePoints, view: PreparedView, template: int) -> SurfacePoints:
    if len(points) == 0:
        return points
    columns, rows = np.round(points.pixels[template]).astype(int).T
    return replace(points, colours=view.picture[rows, columns])


def _finished(measurement: SurfaceMeasurement, points: SurfacePoints) -> SurfacePoints:
    if measurement.max_sigma_mm is not None:
        points = points.select(points.sigma_m <= measurement.max_sigma_mm / 1000)
    return voxel_filtered(points, measurement.voxel_mm / 1000) if measurement.voxel_mm else points


def residual_rms_px(points: SurfacePoints) -> float:
    """RMS of the reprojection over all points, px."""
    squares: Array = points.residual_px**2
    return float(np.sqrt(squares.mean())) if len(points) else float("nan")
