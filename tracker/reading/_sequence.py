"""What every reading shares: views, ranges, backgrounds, and the streaming of frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, TypeVar

import cv2
import numpy as np

from tracker.arrays import Image, frozen
from tracker.errors import CalibrationError, SequenceError
from tracker.frame import Frame
from tracker.imaging.plate_alignment import LEAST_INLIERS, aligned
from tracker.reading._masks import MaskFiles, checked_masks, mask_paths
from tracker.reading._selection import (
    OnMissing,
    Selection,
    chosen_offsets,
    common_length,
    numbered_files,
    selected,
    view_paths,
)
from tracker.rig import Rig

_View = TypeVar("_View")


class View(Protocol):
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
    def downscale(self) -> int: ...
    @property
    def on_missing(self) -> OnMissing: ...


@dataclass(frozen=True)
class Recording:
    """What a reading component has found on disk."""

    names: tuple[str, ...]
    """The views in order."""

    fps: float
    lengths: tuple[int, ...]
    """Number of images of each view, 0 where it is absent."""

    open_views: Callable[[], tuple[View, ...]]
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
    downscale: int
    on_missing: OnMissing
    open_views: Callable[[], tuple[View, ...]]

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Image widths and heights as delivered, px."""
        return tuple((width // self.downscale, height // self.downscale) for width, height in self.source_sizes)

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
                return [pool.submit(self._read, v, view, index) for v, view in enumerate(views)]

            indices = self.selection.indices
            waiting = request(indices[0]) if len(indices) else []
            for k, index in enumerate(indices):
                images = tuple(future.result() for future in waiting)
                if k + 1 < len(indices):
                    waiting = request(indices[k + 1])
                yield Frame(index, index / self.fps, images)

    def _read(self, v: int, view: View, index: int) -> Image | None:
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
        return downscaled(image, self.downscale)


@dataclass(frozen=True)
class OpenSequence(OpenViews):
    """An opened recording; see `tracker.reading.Sequence`."""

    rig: Rig
    """The cameras of the images as delivered (after downscaling)."""

    backgrounds: tuple[Image | None, ...]
    masks: MaskFiles | None = None
    """Silhouettes that the user brings."""

    @property
    def known(self) -> tuple[Image | None, ...]:
        """What the persons stand out against in each view: the plate, or nothing (h, w, 3) where masks tell."""
        if self.masks is None:
            return self.backgrounds
        blank = (np.zeros((height, width, 3), dtype=np.uint8) for width, height in self.sizes)
        pairs = zip(self.backgrounds, blank, self.masks.files, strict=True)
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


def check_size(name: str, image: Image, expected: tuple[int, int]) -> None:
    """Compares an image with the calibrated size.

    Raises:
        CalibrationError: they differ.
    """
    height, width = image.shape[:2]
    if (width, height) != tuple(expected):
        mended = "take the calibration of these images"
        if (height, width) == tuple(expected):
            mended = (
                "are the images turned upright? `bodytrack rig convert RIG rig.toml --upright` makes the rig of those"
            )
        raise CalibrationError(
            f'view "{name}": the images have {width}x{height} px, the rig was calibrated at '
            f"{expected[0]}x{expected[1]} px: {mended}"
        )


def downscaled(image: Image, factor: int) -> Image:
    """The image averaged over `factor` x `factor` pixels."""
    if factor == 1:
        return image
    size = image.shape[1] // factor, image.shape[0] // factor
    cropped = image[: size[1] * factor, : size[0] * factor]
    smaller: Image = cv2.resize(cropped, size, interpolation=cv2.INTER_AREA)
    return smaller


def opened(settings: Settings, recording: Recording, rig: Rig) -> OpenSequence:
    """The sequence that the settings choose from a recording.

    Raises:
        SequenceError: lengths, range or backgrounds do not fit.
    """
    views = _chosen_views(settings, recording, tuple(camera.size for camera in rig.cameras))
    firsts = _first_images(views) if settings.align_background else None
    return OpenSequence(
        **vars(views),
        rig=rig if settings.downscale == 1 else rig.downscaled(settings.downscale),
        backgrounds=load_backgrounds(rig, settings.background, settings.downscale, recording.plate_of_clip, firsts),
        masks=None if settings.masks is None else _opened_masks(settings.masks, recording, views),
    )


def _opened_masks(pattern: str, recording: Recording, views: OpenViews) -> MaskFiles:
    paths = mask_paths(pattern, views.names)
    by_name = dict(zip(views.names, paths, strict=True))
    files = opened_views(views.names, lambda name: numbered_files(name, by_name[name]), views.on_missing)
    offsets = tuple(recording.first + offset for offset in views.offsets)
    found = MaskFiles(tuple(one or {} for one in files), views.names, views.source_sizes, offsets, views.downscale)
    return checked_masks(found, views.selection, views.on_missing)


def opened_uncalibrated(settings: Settings, recording: Recording) -> OpenViews:
    """The views that the settings choose from a recording of cameras without a calibration.

    Raises:
        SequenceError: lengths or range do not fit, or a view lacks the first image, which tells its size.
    """
    views = _chosen_views(settings, recording, ())
    sizes = []
    for name, image in zip(views.names, _first_images(views), strict=True):
        if image is None:
            raise SequenceError(f'view "{name}": no image for the first frame, {views.selection.start}: mend start')
        sizes.append((image.shape[1], image.shape[0]))
    return replace(views, source_sizes=tuple(sizes))


def _chosen_views(settings: Settings, recording: Recording, sizes: tuple[tuple[int, int], ...]) -> OpenViews:
    offsets = chosen_offsets(recording.names, settings.offsets)
    length = common_length(recording.names, recording.lengths, offsets, settings.on_missing, settings.stop)
    return OpenViews(
        names=recording.names,
        source_sizes=sizes,
        fps=recording.fps,
        selection=selected(settings.start, settings.stop, settings.stride, length),
        offsets=offsets,
        downscale=settings.downscale,
        on_missing=settings.on_missing,
        open_views=recording.open_views,
    )


def _first_images(views: OpenViews) -> tuple[Image | None, ...]:
    """An image of each view as on disk: that of the first frame."""
    opened = zip(views.open_views(), views.offsets, strict=True)
    return tuple(view.read(max(views.selection.start + offset, 0)) for view, offset in opened)


def read_image(path: Path) -> Image | None:
    """A BGR image (h, w, 3), None if the file is none or is cut off."""
    content = path.read_bytes()
    # OpenCV fills a cut-off JPEG with grey without a word
    cut_off = content.startswith(_JPEG_START) and _JPEG_END not in content[-1024:]
    if not content or cut_off:
        return None
    image: Image | None = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    return image


def load_backgrounds(
    rig: Rig,
    pattern: str | None,
    downscale: int,
    clip: Callable[[Path], Image],
    fit_to: tuple[Image | None, ...] | None = None,
) -> tuple[Image | None, ...]:
    """Clean plates of all views.

    Args:
        rig: names the views, and has their image sizes.
        pattern: path with `{view}` to an image or a clip; None for no plates.
        downscale: as for the images.
        clip: reads a plate from a video file.
        fit_to: an image of each view that its plate is fitted to; None for plates that fit as they are.

    Raises:
        SequenceError: a plate is missing or unreadable, or does not show what its view does.
    """
    if pattern is None:
        return (None,) * len(rig)
    plates: list[Image | None] = []
    for v, (camera, path) in enumerate(zip(rig.cameras, view_paths(pattern, rig.names), strict=True)):
        plate = _read_plate(camera.name, path, clip)
        if fit_to is not None:
            plate = _fitted_plate(camera.name, plate, path, fit_to[v])
        check_size(camera.name, plate, camera.size)
        plates.append(frozen(downscaled(plate, downscale), np.uint8))
    return tuple(plates)


def _read_plate(name: str, path: Path, clip: Callable[[Path], Image]) -> Image:
    if not path.exists():
        raise SequenceError(f'background of view "{name}": no file {path}')
    plate = read_image(path) if path.suffix.lower() in _IMAGES else clip(path)
    if plate is None:
        raise SequenceError(f'background of view "{name}": {path} is not an image that can be read')
    return plate


def _fitted_plate(name: str, plate: Image, path: Path, image: Image | None) -> Image:
    if image is None:
        raise SequenceError(f'background of view "{name}": no first image to fit the plate to; unset align_background')
    fitted, n_agree = aligned(plate, image)
    if n_agree < LEAST_INLIERS:
        raise SequenceError(
            f'background of view "{name}": {path} and the first image have {n_agree} features in common, expected at '
            f"least {LEAST_INLIERS}: is it the plate of another view, or was the camera carried elsewhere?"
        )
    return fitted


_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}
