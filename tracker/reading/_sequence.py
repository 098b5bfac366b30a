"""What every reading shares: views, ranges, plates, and the streaming of frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from tracker.arrays import Image, Mask
from tracker.components import NO_PLATES, RECORDED
from tracker.errors import SequenceError
from tracker.frame import Frame
from tracker.imaging.noise import smoothed
from tracker.plate import Plate
from tracker.reading._masks import MaskFiles, checked_masks, mask_paths
from tracker.reading._occluders import load_occluders, with_occluders
from tracker.reading._pictures import brightened, check_size, downscaled
from tracker.reading._plates import backdrop, clean_enough, load_plates, recorded_plates
from tracker.reading._recorded_plate import N_SAMPLES, RecordedPlate
from tracker.reading._selection import (
    OnMissing,
    Selection,
    chosen_offsets,
    common_length,
    numbered_files,
    selected,
)
from tracker.rig import Rig

# Frames of a long recording in which what most of them show is looked for: all before the last have to be decoded.
_MOST_SEARCHED = 1500

_View = TypeVar("_View")


class ImageStream(Protocol):
    """One view's images, read in ascending order."""

    def read(self, index: int) -> Image | None:
        """Image number `index` of the view's own count, None past its end.

        Raises:
            SequenceError: it cannot be read.
        """
        ...


class Settings(Protocol):
    """Fields that every reading component has."""

    @property
    def background(self) -> str | None: ...
    @property
    def masks(self) -> str | None: ...
    @property
    def occluders(self) -> str | None: ...
    @property
    def align_background(self) -> bool: ...
    @property
    def offsets(self) -> dict[str, int]: ...
    @property
    def start(self) -> int: ...
    @property
    def stop(self) -> int | None: ...
    @property
    def stride(self) -> int: ...
    @property
    def downscale(self) -> float | None: ...
    @property
    def gain(self) -> float | None: ...
    @property
    def smoothing_px(self) -> float | None: ...
    @property
    def on_missing(self) -> OnMissing: ...


@dataclass(frozen=True)
class Footage:
    """What a reading component has found on disk."""

    names: tuple[str, ...]
    """The views in order."""

    fps: float
    lengths: tuple[int, ...]
    """Number of images of each view, 0 where it is absent."""

    open_views: Callable[[], tuple[ImageStream, ...]]
    plate_of_clip: Callable[[Path], Image]
    first: int = 0
    """Number in the file names of the images, or of masks, that belongs to a view's image 0."""


@dataclass(frozen=True)
class AbsentView:
    """A view whose files are missing or cannot be opened."""

    def read(self, index: int) -> Image | None:
        """None for every frame."""
        return None


def opened_views(names: tuple[str, ...], opened: Callable[[str], _View], on_missing: OnMissing) -> list[_View | None]:
    """What `opened` makes of each view; None for views that cannot be opened, where that is allowed.

    Raises:
        SequenceError: from `opened`, where nothing may be missing or no view can be opened.
    """
    views: list[_View | None] = []
    faults: list[SequenceError] = []
    for name in names:
        try:
            views.append(opened(name))
        except SequenceError as fault:
            views.append(None)
            faults.append(fault)
    if faults and (on_missing == "error" or len(faults) == len(names)):
        raise faults[0]
    return views


@dataclass(frozen=True)
class OpenViews:
    """Opened views of cameras that need no calibration; see `tracker.views.Views`."""

    names: tuple[str, ...]
    source_sizes: tuple[tuple[int, int], ...]
    """Image sizes as on disk, px."""

    fps: float
    selection: Selection
    offsets: tuple[int, ...]
    downscale: float
    gain: float
    smoothing_px: float
    on_missing: OnMissing
    open_views: Callable[[], tuple[ImageStream, ...]]

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Image widths and heights as delivered, px."""
        return tuple(
            (int(width // self.downscale), int(height // self.downscale)) for width, height in self.source_sizes
        )

    @property
    def n_frames(self) -> int:
        """Number of frames that `frames()` delivers."""
        return len(self.selection.indices)

    @property
    def interval_s(self) -> float:
        """Time from one delivered frame to the next, seconds."""
        return self.selection.stride / self.fps

    def frames(self) -> Iterator[Frame]:
        """All frames of the selection; the next one is decoded while the caller works on this one."""
        views = self.open_views()
        with ThreadPoolExecutor(max_workers=2) as pool:

            def request(index: int) -> list[Future[Image | None]]:
                return [pool.submit(self.image, v, view, index) for v, view in enumerate(views)]

            indices = self.selection.indices
            waiting = request(indices[0]) if len(indices) else []
            for k, index in enumerate(indices):
                images = tuple(future.result() for future in waiting)
                if k + 1 < len(indices):
                    waiting = request(indices[k + 1])
                yield Frame(index, index / self.fps, images)

    def image(self, v: int, view: ImageStream, index: int) -> Image | None:
        """An image (h, w, 3) of one view as delivered; None where it may be and is missing.

        Args:
            v: number of the view.
            view: the view, opened; it is read in ascending order.
            index: frame.

        Raises:
            SequenceError: it is missing or cannot be read.
            CalibrationError: it has not the calibrated size.
        """
        name = self.names[v]
        try:
            number = index + self.offsets[v]
            image = view.read(number) if number >= 0 else None
        except SequenceError:
            if self.on_missing == "skip":
                return None
            raise
        if image is None:
            if self.on_missing == "skip":
                return None
            raise SequenceError(
                f'view "{name}" has no image for frame {index}; set on_missing = "skip" to leave the view out '
                "of such frames, or a shorter range with start and stop"
            )
        check_size(name, image, self.source_sizes[v])
        return self.delivered(image)

    def delivered(self, image: Image) -> Image:
        """An image or plate (h, w, 3), as recorded, as bright, as large and as smooth as images are delivered."""
        return smoothed(downscaled(brightened(image, self.gain), self.downscale), self.smoothing_px)


@dataclass(frozen=True)
class OpenSequence(OpenViews):
    """An opened recording; see `tracker.reading.Sequence`."""

    rig: Rig
    """The cameras of the images as delivered (after downscaling)."""

    given: tuple[Plate | None, ...] | None
    """The plates that the settings ask for; None for those that the recording makes by itself."""

    spread: Callable[[int], list[Image]]
    """Images of a view, by its number, spread over the recording."""

    masks: MaskFiles | None = None
    """Silhouettes that the user brings."""

    occluders: tuple[Mask | None, ...] = ()
    """(h, w) where each view shows what stands before the persons; no views for none at all."""

    @cached_property
    def _recorded(self) -> tuple[RecordedPlate | None, ...]:
        return tuple(backdrop(self.spread(v)) for v in range(len(self.names)))

    @property
    def backdrops(self) -> tuple[Plate | None, ...]:
        """What each view shows most of the time; see `tracker.reading.Sequence.backdrops`."""
        return self._occluded(tuple(None if one is None else one.plate for one in self._recorded))

    @property
    def plates(self) -> tuple[Plate | None, ...]:
        """A clean plate for each view that has one; see `tracker.reading.Sequence.plates`."""
        return self._occluded(clean_enough(self._recorded)) if self.given is None else self.given

    def _occluded(self, plates: tuple[Plate | None, ...]) -> tuple[Plate | None, ...]:
        return with_occluders(plates, self.occluders) if self.occluders else plates

    @property
    def makes_plates(self) -> bool:
        """Whether plates are its own affair; see `tracker.reading.Sequence.makes_plates`."""
        return self.given is None

    @property
    def known(self) -> tuple[Plate | None, ...]:
        """What the persons stand out against in each view: the plate, or nothing (h, w, 3) where masks tell."""
        if self.masks is None:
            return self.plates
        blank = (Plate(np.zeros((height, width, 3), dtype=np.uint8)) for width, height in self.sizes)
        pairs = zip(self.plates, blank, self.masks.files, strict=True)
        return tuple(black if files else plate for plate, black, files in pairs)

    def frames(self) -> Iterator[Frame]:
        """All frames of the selection with their masks; see `OpenViews.frames`."""
        if self.masks is None:
            return super().frames()
        return self._masked(self.masks, super().frames())

    def _masked(self, masks: MaskFiles, frames: Iterator[Frame]) -> Iterator[Frame]:
        for frame in frames:
            read = (masks.read(v, frame.index) for v in range(len(frame.images)))
            shown = zip(frame.images, read, strict=True)
            yield replace(frame, masks=tuple(None if image is None else mask for image, mask in shown))


def opened(settings: Settings, footage: Footage, rig: Rig) -> OpenSequence:
    """The sequence that the settings choose from the footage.

    Raises:
        SequenceError: lengths, range or plates do not fit.
    """
    views = _chosen_views(settings, footage, tuple(camera.size for camera in rig.cameras))

    def spread(v: int) -> list[Image]:
        return _spread_images(views, footage.lengths[v], v)

    given, occluders = _opened_plates(settings, footage, views, rig), _opened_occluders(settings, rig, views.downscale)
    return OpenSequence(
        **vars(views),
        rig=rig if views.downscale == 1 else rig.downscaled(views.downscale),
        given=given if given is None or not occluders else with_occluders(given, occluders),
        spread=spread,
        masks=None if settings.masks is None else _opened_masks(settings.masks, footage, views),
        occluders=occluders,
    )


def _opened_occluders(settings: Settings, rig: Rig, factor: float) -> tuple[Mask | None, ...]:
    if settings.occluders is None:
        return ()
    if settings.background == NO_PLATES or settings.masks is not None:
        other = "masks" if settings.masks is not None else f'background = "{NO_PLATES}"'
        raise SequenceError(f"occluders and {other}: they say where plates know nothing; leave out one of the two")
    return load_occluders(rig, settings.occluders, factor)


def _opened_plates(settings: Settings, footage: Footage, views: OpenViews, rig: Rig) -> tuple[Plate | None, ...] | None:
    pattern = settings.background
    if pattern not in (None, RECORDED, NO_PLATES):
        firsts = _first_images(views) if settings.align_background else None
        return load_plates(rig, pattern, views.delivered, footage.plate_of_clip, firsts)
    if settings.align_background:
        raise SequenceError(
            "align_background: nothing to align, there are no plates but those of these images: unset it"
        )
    if pattern != RECORDED:
        return None if pattern is None and settings.masks is None else (None,) * len(rig)
    return recorded_plates(views.names, lambda v: _spread_images(views, footage.lengths[v], v))


def _spread_images(views: OpenViews, length: int, v: int) -> list[Image]:
    """Images of a view as delivered, spread over its recording; of a long one, over what follows the first frame."""
    if length == 0:
        return []
    first = 0 if length <= _MOST_SEARCHED else max(views.selection.start + views.offsets[v], 0)
    numbers = np.linspace(first, min(length, first + _MOST_SEARCHED) - 1, N_SAMPLES).round().astype(int)
    view = views.open_views()[v]
    found = (views.image(v, view, int(number) - views.offsets[v]) for number in np.unique(numbers))
    return [image for image in found if image is not None]


def _opened_masks(pattern: str, footage: Footage, views: OpenViews) -> MaskFiles:
    paths = mask_paths(pattern, views.names)
    by_name = dict(zip(views.names, paths, strict=True))
    files = opened_views(views.names, lambda name: numbered_files(name, by_name[name]), views.on_missing)
    offsets = tuple(footage.first + offset for offset in views.offsets)
    found = MaskFiles(tuple(one or {} for one in files), views.names, views.source_sizes, offsets, views.downscale)
    return checked_masks(found, views.selection, views.on_missing)


def opened_uncalibrated(settings: Settings, footage: Footage) -> OpenViews:
    """The views that the settings choose from a recording of cameras without a calibration.

    Raises:
        SequenceError: lengths or range do not fit, or a view lacks the first image, which tells its size.
    """
    views = _chosen_views(settings, footage, ())
    sizes = []
    for name, image in zip(views.names, _first_images(views), strict=True):
        if image is None:
            raise SequenceError(f'view "{name}": no image for the first frame, {views.selection.start}: mend start')
        sizes.append((image.shape[1], image.shape[0]))
    return replace(views, source_sizes=tuple(sizes))


def _chosen_views(settings: Settings, footage: Footage, sizes: tuple[tuple[int, int], ...]) -> OpenViews:
    offsets = chosen_offsets(footage.names, settings.offsets)
    length = common_length(footage.names, footage.lengths, offsets, settings.on_missing, settings.stop)
    return OpenViews(
        names=footage.names,
        source_sizes=sizes,
        fps=footage.fps,
        selection=selected(settings.start, settings.stop, settings.stride, length),
        offsets=offsets,
        downscale=settings.downscale or 1,
        gain=settings.gain or 1.0,
        smoothing_px=settings.smoothing_px or 0.0,
        on_missing=settings.on_missing,
        open_views=footage.open_views,
    )


def _first_images(views: OpenViews) -> tuple[Image | None, ...]:
    """An image of each view as on disk: that of the first frame."""
    opened = zip(views.open_views(), views.offsets, strict=True)
    return tuple(view.read(max(views.selection.start + offset, 0)) for view, offset in opened)
