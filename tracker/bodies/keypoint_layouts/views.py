"""The keypoints of all views of a rig, in pixels of the tracked images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoint_layouts import KeypointSource, open_keypoints
from tracker.bodies.keypoint_layouts.orders import LAYOUTS, Order
from tracker.bodies.keypoints import limbs, meant, skeletons, swapped_sides
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import PathPattern, component
from tracker.foundation.errors import SequenceError
from tracker.foundation.files import Stamp, stamp_of

USUAL = "keypoints/{view}_json"
"""Default place of keypoints: beside the configuration."""

_MOST_OUTSIDE = 0.3
"""Share of a view's keypoints that may lie outside of its image; detectors guess feet below the edge."""

_SHARES_END = 2.0
"""Numbers up to this are shares of an image, slightly above 1 for keypoints outside of it: no detector finds persons in
so few pixels."""


@dataclass(frozen=True)
class KeypointViews:
    """One source a view, all of the same keypoints."""

    views: tuple[str, ...]
    order: Order
    sources: tuple[KeypointSource, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the keypoints."""
        return self.order.names

    @staticmethod
    def open(
        pattern: str, views: tuple[str, ...], names: tuple[str, ...] = (), layout: str | None = None
    ) -> KeypointViews:
        """Opens the files of all views, once as long as they do not change.

        Args:
            pattern: path with `{view}`.
            views: names of the cameras.
            names: of the keypoints in files without names.
            layout: the order of those, see `open_keypoints`.

        Raises:
            SequenceError: a file is missing, or two have other keypoints.
        """
        if "{view}" not in pattern and len(views) > 1:
            raise SequenceError(f'path = "{pattern}": no {{view}} in it, expected e.g. keypoints/{{view}}_json')
        paths = tuple(Path(pattern.replace("{view}", view)) for view in views)
        return _opened(paths, views, names, layout, tuple(map(stamp_of, paths)))

    def at(
        self,
        frame: Frame,
        rig: Rig,
        downscale: int | None = None,
        least_confidence: float = 0.0,
        normalized: bool = False,
    ) -> list[Array]:
        """Detections in the images of one frame.

        Args:
            frame: gives the images of the views; named files have the images' numbers, tables count from 0 on.
            rig: the cameras of the tracked images.
            downscale: size of the detector's images over that of these; None: as recorded.
            least_confidence: least confidence of a keypoint.
            normalized: whether they are shares of the image's width and height.

        Returns:
            For each view (N, K, 3) pixel and confidence of N persons; NaN for keypoints that were not found.

        Raises:
            SequenceError: it is not a detector's file.
        """
        found = []
        for v, (source, camera) in enumerate(zip(self.sources, rig.cameras, strict=True)):
            persons = source.at(self.number(frame, v)).found.copy()
            persons[..., :2] = _in_pixels(persons[..., :2], camera, downscale, normalized)
            persons[persons[..., 2] < least_confidence] = np.nan
            found.append(persons)
        return found

    def number(self, frame: Frame, view: int) -> int:
        """Number of a frame in a view's file."""
        return frame.position(view) + (frame.first_number if self.sources[view].named else 0)

    def check(
        self, rig: Rig, downscale: int | None = None, least_confidence: float = 0.0, normalized: bool = False
    ) -> None:
        """Refuses keypoints that are not in pixels of the images, by some of those of each view.

        Raises:
            SequenceError: they are shares of the image, or most of a view lie outside of its image.
        """
        for source, camera in zip(self.sources, rig.cameras, strict=True):
            told = source.sample[source.sample[..., 2] >= least_confidence][:, :2]
            if len(told):
                _check_unit(told, camera, normalized)
                _check_size(_in_pixels(told, camera, downscale, normalized), camera)

    @property
    def numbering(self) -> str:
        """First numbers of named files, if not 0; empty otherwise."""
        firsts = {
            view: source.numbers[0]
            for view, source in zip(self.views, self.sources, strict=True)
            if source.named and source.numbers
        }
        told = (
            f"{', '.join(view for view, one in firsts.items() if one == first)} from {first} on"
            for first in dict.fromkeys(firsts.values())
        )
        return f", numbered: {'; '.join(told)}" if any(firsts.values()) else ""

    def gaps_told(self, frame: Frame) -> str:
        """Views without data for a frame, because their files have other numbers; empty for none."""
        told = (
            f"{view} has {source.numbers[0]} to {source.numbers[-1]}, this frame is {self.number(frame, v)}"
            for v, (view, source) in enumerate(zip(self.views, self.sources, strict=True))
            if source.numbers and self.number(frame, v) not in source.numbers
        )
        return ", ".join(told)


@component
class KeypointFiles:
    """Files of keypoints and their reading: common settings of the components that use them."""

    path: PathPattern
    """For each view a folder of JSON files as OpenPose writes them, one JSON file as AlphaPose writes it of a video, or
    a CSV table as DeepLabCut and SLEAP do: for instance `keypoints/{view}_json`. Files that name images are numbered
    as the images are, others from 0 at a view's first image."""

    names: tuple[str, ...] = ()
    """Names of the keypoints in JSON files, in their order; an empty one leaves a keypoint out. Or say `layout`."""

    layout: str | None = None
    """Order of the keypoints in JSON files: `coco_17`, `h36m_17`, `coco_18`, `body_25`, `body_25b`, `halpe_26`,
    `blazepose_33`, `halpe_68`, `wholebody_133`, `body_135`, `halpe_136`, `mpii_15` or `mpii_16`. Default by their
    number: 17 are `coco_17`, 25 `body_25`."""

    normalized: bool = False
    """Whether they are shares of the image's width and height, as MediaPipe's are, not pixels."""

    downscale: int | None = pydantic.Field(default=None, ge=1, le=16)
    """Size of the detector's images over that of the tracked ones; default: as recorded."""

    least_confidence: float = pydantic.Field(default=0.3, ge=0, le=1)
    """Least confidence of a keypoint, a share of 1."""

    def opened(self, rig: Rig) -> KeypointViews:
        """The files of all views.

        Raises:
            SequenceError: one is missing or not a file of keypoints, or two have other keypoints.
        """
        return KeypointViews.open(self.path, rig.names, self.names, self.layout)

    def checked(self, rig: Rig) -> KeypointViews:
        """The files of all views, checked before the first frame.

        Raises:
            SequenceError: as for `opened`, or the keypoints are not pixels of these images.
        """
        if self.normalized and self.downscale is not None:
            raise SequenceError("normalized keypoints are shares of any image: leave downscale out")
        views = self.opened(rig)
        views.check(rig, self.downscale, self.least_confidence, self.normalized)
        return views

    def found(self, views: KeypointViews, frame: Frame, rig: Rig) -> list[Array]:
        """Detections in the images of one frame; see `KeypointViews.at`."""
        return views.at(frame, rig, self.downscale, self.least_confidence, self.normalized)


def _in_pixels(told: Array, camera: Camera, downscale: int | None, normalized: bool) -> Array:
    """Keypoints (..., 2) of a file, in pixels of the tracked images."""
    recorded = told * (np.array(camera.size) * camera.downscale) if normalized else told
    # pixel centres lie at integer coordinates
    pixels: Array = (recorded + 0.5) / (downscale or camera.downscale) - 0.5
    return pixels


def _check_unit(told: Array, camera: Camera, normalized: bool) -> None:
    """Keypoints (N, 2) all of which are about 1 or less are no pixels, and others no shares of an image."""
    largest = float(np.percentile(np.abs(told), 95))
    if normalized and largest > _SHARES_END:
        raise SequenceError(
            f'view "{camera.name}": keypoints are as large as {largest:.0f}, expected shares of the image from 0 to 1: '
            "they are pixels, leave normalized out"
        )
    if normalized or largest > _SHARES_END:
        return
    signed = (told < 0).mean() > _MOST_OUTSIDE / 2
    mended = (
        "write pixels (OpenPose: --keypoint_scale 0)"
        if signed
        else "set normalized = true (OpenPose: --keypoint_scale 3)"
    )
    raise SequenceError(
        f'view "{camera.name}": keypoints lie between {told.min():.2f} and {told.max():.2f}: they are shares of the '
        f"image, no pixels; {mended}"
    )


def _check_size(pixels: Array, camera: Camera) -> None:
    """Keypoints (N, 2) most of which lie outside of the image were found in a larger one."""
    width, height = camera.size
    outside = (pixels < -0.5).any(axis=-1) | (pixels > np.array(camera.size) - 0.5).any(axis=-1)
    if outside.mean() > _MOST_OUTSIDE:
        x, y = pixels.max(axis=0)
        raise SequenceError(
            f'view "{camera.name}": keypoints lie as far as ({x:.0f}, {y:.0f}) px, the image has '
            f"{width}x{height} px; expected pixels of the images as recorded: for those of larger ones set downscale"
        )


@lru_cache(maxsize=8)
def _opened(
    paths: tuple[Path, ...],
    views: tuple[str, ...],
    names: tuple[str, ...],
    layout: str | None,
    _: tuple[Stamp, ...],
) -> KeypointViews:
    sources = [open_keypoints(path, names, layout) for path in paths]
    order = next((source.order for source in sources if source.order), Order(LAYOUTS["coco_17"], "coco_17"))
    first = next((view for view, source in zip(views, sources, strict=True) if source.order), views[0])
    for view, source in zip(views, sources, strict=True):
        if source.order and source.order.names != order.names:
            raise SequenceError(
                f'view "{view}" has {_told(source.order)}, view "{first}" has {_told(order)}: expected the same ones'
            )
    # a view that shows nobody says nothing of an order
    return KeypointViews(views, order, tuple(replace(source, order=source.order or order) for source in sources))


def _told(order: Order) -> str:
    return f"{len(order.names)} keypoints ({', '.join(order.names[:3])}, ...)"


_BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
"""Ends of the bones of a person's limbs, on both sides."""

_N_FRAMES = 3
"""Frames to measure, spread over all."""

_OTHER, _SAME = 0.3, 0.15
"""Mean natural logarithm of the ratio of limb lengths from which on keypoints have another layout, and up to which they
have this one. BlazePose's on seven recordings have 0.03 to 0.25, taken for another layout 0.37 to 1.05."""


def fitting_layout(files: KeypointFiles, rig: Rig, body: BodyModel) -> str | None:
    """The layout that fits a body, if the number of keypoints gave another one that does not fit.

    None if all is well, and if no layout fits: few views show the same person at the same number.

    Raises:
        SequenceError: it is not a file of keypoints.
    """
    views = files.opened(rig)
    if not views.order.by_number or not views.order.others or _off(views, files, rig, body) <= _OTHER:
        return None
    others = {other: KeypointViews.open(files.path, rig.names, layout=other) for other in views.order.others}
    return next((other for other, read in others.items() if _off(read, files, rig, body) < _SAME), None)


def _off(views: KeypointViews, files: KeypointFiles, rig: Rig, body: BodyModel) -> float:
    """Mean logarithmic difference of limb lengths from the body's in some frames; NaN if none is seen."""
    other_side, groups = swapped_sides(views.names, body.mirror), limbs(views.names, body)
    numbers = views.sources[0].numbers
    lengths = [np.zeros(0)]
    for number in numbers[:: max(1, len(numbers) // _N_FRAMES)][:_N_FRAMES]:
        frame = Frame(number, 0.0, (None,) * len(rig))
        for person in skeletons(rig, files.found(views, frame, rig), other_side, groups, 1):
            lengths.append(_log_ratios(views.names, person.points, body))
    off = np.abs(np.concatenate(lengths))
    return float(np.mean(off)) if len(off) else np.nan


def _log_ratios(names: tuple[str, ...], points: Array, body: BodyModel) -> Array:
    """Ratios of the visible limbs' lengths to the body's."""
    known = meant(names, body)
    place = {names[row]: k for k, row in enumerate(known.rows)}
    ends = [(f"{side}_{upper}", f"{side}_{lower}") for side in ("left", "right") for upper, lower in _BONES]
    pairs = [(place[one], place[two]) for one, two in ends if one in place and two in place]
    if not pairs:
        return np.zeros(0)
    first, last = np.array(pairs).T
    seen = np.linalg.norm(points[known.rows[last]] - points[known.rows[first]], axis=1)
    ratios: Array = np.log(seen / np.linalg.norm(known.points[last] - known.points[first], axis=1))
    return ratios[np.isfinite(ratios)]
