"""An opened recording: its frames, decoded ahead and made as they are asked for, with masks and plates."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame, Packed, Pictures
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image, Mask, frozen
from tracker.foundation.errors import CalibrationError, SequenceError
from tracker.images.operations.appearance import smoothed
from tracker.images.plate import Plate
from tracker.images.reading._footage import ImageStream, OnMissing, Selection, view_paths
from tracker.images.reading._pictures import Lines, brightened, check_size, downscaled, of_one_field, read_painted
from tracker.images.reading._plates import RecordedPlate, backdrop, clean_enough
from tracker.images.reading._timeline import ViewOffset


@dataclass(frozen=True)
class OpenViews:
    """Opened views of cameras that need no calibration; see `tracker.cameras.frame.Views`."""

    names: tuple[str, ...]
    source_sizes: tuple[tuple[int, int], ...]
    """Image sizes as on disk, px."""

    fps: float
    selection: Selection
    offsets: tuple[ViewOffset, ...]
    downscale: float
    gain: float
    smoothing_px: float
    lines: Lines
    on_missing: OnMissing
    open_views: Callable[[], tuple[ImageStream, ...]]
    first_number: int
    """That the file name of a view's image at position 0 has."""

    uneven: tuple[tuple[int, ...] | None, ...]
    """See `tracker.images.reading._footage.Footage.positions`."""

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

            def request(index: int) -> list[Future[Image | Packed | None]]:
                return [pool.submit(self._held, v, view, index) for v, view in enumerate(views)]

            indices = self.selection.indices
            waiting = request(indices[0]) if len(indices) else []
            for k, index in enumerate(indices):
                images = Pictures([future.result() for future in waiting])
                if k + 1 < len(indices):
                    waiting = request(indices[k + 1])
                yield Frame(index, index / self.fps, images, (), self.positions(index), self.first_number)

    def positions(self, index: int) -> tuple[int, ...]:
        """Of each view's image of a frame among all that it has; negative where there is none."""
        places = tuple(offset.number(index) for offset in self.offsets)
        if not self.uneven:
            return places
        pairs = zip(places, self.uneven, strict=True)
        return tuple(
            place if uneven is None or place < 0 else uneven[place] if place < len(uneven) else -1
            for place, uneven in pairs
        )

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
        found = self._held(v, view, index)
        return found.image() if isinstance(found, Packed) else found

    def _held(self, v: int, view: ImageStream, index: int) -> Image | Packed | None:
        """The same, packed if it is delivered as recorded."""
        name = self.names[v]
        try:
            number = self.offsets[v].number(index)
            image = view.held(number) if number >= 0 else None
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
        if isinstance(image, Packed):
            return image if self._as_recorded else self.delivered(image.image())
        return self.delivered(image)

    @property
    def _as_recorded(self) -> bool:
        """Whether images are delivered unchanged."""
        return self.gain == 1 and self.downscale == 1 and self.smoothing_px == 0 and self.lines == "all"

    def delivered(self, image: Image) -> Image:
        """An image or plate (h, w, 3), as recorded, as bright, as large and as smooth as images are delivered."""
        bright = brightened(of_one_field(image, self.lines), self.gain)
        return smoothed(downscaled(bright, self.downscale), self.smoothing_px)


@dataclass(frozen=True)
class MaskFiles:
    """Masks of a recording, read when their frames are."""

    files: tuple[dict[int, Path], ...]
    """For each view: number in the file name -> file."""

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    """Widths and heights of the images as on disk, px."""

    first: int
    """Number in a view's file names that belongs to its image at position 0."""

    downscale: float

    def read(self, view: int, position: int) -> Mask | None:
        """The mask (h, w) of a view's image as delivered; None where there is none.

        Raises:
            SequenceError: the file cannot be read.
            CalibrationError: it has another size than the images.
        """
        path = self.files[view].get(position + self.first)
        if path is None:
            return None
        covered = read_painted(path)
        if covered is None:
            raise SequenceError(f"{path}: not an image that can be read: the file is corrupt or truncated")
        size = covered.shape[1], covered.shape[0]
        if size != self.sizes[view]:
            raise CalibrationError(
                f'{path}: the mask has {size[0]}x{size[1]} px, the images of view "{self.names[view]}" have '
                f"{self.sizes[view][0]}x{self.sizes[view][1]} px"
            )
        mask: Mask = frozen(_smaller(covered, self.downscale), np.bool_)
        return mask


def _smaller(mask: Mask, factor: float) -> Mask:
    """What covers half of so many pixels in both directions, or more; of enlarged images, every pixel twice."""
    if factor == 1:
        return mask
    if factor < 1:
        times = round(1 / factor)
        return mask.repeat(times, axis=0).repeat(times, axis=1)
    factor = int(factor)
    height, width = (length // factor for length in mask.shape)
    whole = mask[: height * factor, : width * factor].reshape(height, factor, width, factor)
    most: Mask = whole.mean(axis=(1, 3)) >= 0.5
    return most


def checked_masks(masks: MaskFiles, views: OpenViews) -> MaskFiles:
    """The masks, if there is one for each image that is read, or some may be missing.

    Raises:
        SequenceError: names the first one that is missing, or the last of those that count what a video has dropped.
    """
    frames = {index: views.positions(index) for index in views.selection.indices}
    for v, name in enumerate(masks.names):
        numbers = {index: places[v] + masks.first for index, places in frames.items() if places[v] >= 0}
        lacking = [index for index, number in numbers.items() if number not in masks.files[v]]
        if lacking and views.on_missing == "error":
            raise SequenceError(
                f'masks of view "{name}": none numbered {numbers[lacking[0]]} for frame {lacking[0]}, '
                f"{len(lacking)} of {len(views.selection.indices)} frames have none; add them, choose others with "
                'start and stop, or set on_missing = "skip" to go on without'
            )
        uneven = views.uneven[v] if views.uneven else None
        if uneven is not None and masks.files[v] and max(masks.files[v]) > max(uneven) + 1:
            raise SequenceError(
                f'masks of view "{name}": numbered up to {max(masks.files[v])}, the video holds {max(uneven) + 1} '
                "images, for some were dropped: number the masks as the images in it, from 0 on"
            )
    return masks


def mask_paths(pattern: str, names: tuple[str, ...]) -> tuple[Path, ...]:
    """The pattern of every view, with `{frame}` in the file name.

    Raises:
        SequenceError: a placeholder is missing.
    """
    paths = view_paths(pattern, names)
    if paths[0].name.count("{frame}") != 1:
        raise SequenceError(
            f'masks = "{pattern}": no {{frame}} in the file name, expected e.g. masks/{{view}}/{{frame}}.png'
        )
    return paths


# What stands before the persons in a view, painted by the user: a table, a treadmill, a clock in the picture.


def load_occluders(rig: Rig, pattern: str, factor: float) -> tuple[Mask | None, ...]:
    """Where (h, w) each view shows what stands before the persons; None for a view without a picture of it.

    Args:
        rig: names the views, and has the image sizes as recorded.
        pattern: path with `{view}` to pictures; what is not black stands before the persons.
        factor: pixels, in both directions, that one of an image as delivered averages.

    Raises:
        SequenceError: there is no such picture for any view, one cannot be read, or covers all of its view.
        CalibrationError: one has not the calibrated size.
    """
    paths = view_paths(pattern, rig.names)
    if not any(path.exists() for path in paths):
        raise SequenceError(f"occluders: no file {paths[0]}, nor of another view; expected one for each that has some")
    found: list[Mask | None] = []
    for camera, path in zip(rig.cameras, paths, strict=True):
        painted = read_painted(path) if path.exists() else None
        if painted is None and path.exists():
            raise SequenceError(f'occluders of view "{camera.name}": {path} is not an image that can be read')
        found.append(None if painted is None else _mask(camera, painted, path, factor))
    return tuple(found)


def with_occluders(plates: Sequence[Plate | None], occluders: Sequence[Mask | None]) -> tuple[Plate | None, ...]:
    """The plates, which know what stands before the persons."""
    pairs = zip(plates, occluders, strict=True)
    return tuple(plate if plate is None or mask is None else replace(plate, occluder=mask) for plate, mask in pairs)


def _mask(camera: Camera, painted: Mask, path: Path, factor: float) -> Mask:
    white = np.where(painted[..., None], np.uint8(255), np.uint8(0))
    check_size(camera.name, white, camera.size, f"the picture of occluders {path}")
    # a pixel of which a part is covered shows the person only partly
    mask: Mask = downscaled(np.repeat(white, 3, axis=2), factor)[..., 0] > 0
    if mask.all():
        raise SequenceError(
            f'occluders of view "{camera.name}": all of the picture is painted; leave the view out with `views`'
        )
    return mask


@dataclass(frozen=True)
class OpenSequence(OpenViews):
    """An opened recording; see `tracker.images.reading.Sequence`."""

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
        """What each view shows most of the time; see `tracker.images.reading.Sequence.backdrops`."""
        return self._occluded(tuple(None if one is None else one.plate for one in self._recorded))

    @property
    def plates(self) -> tuple[Plate | None, ...]:
        """A clean plate for each view that has one; see `tracker.images.reading.Sequence.plates`."""
        return self._occluded(clean_enough(self._recorded)) if self.given is None else self.given

    def _occluded(self, plates: tuple[Plate | None, ...]) -> tuple[Plate | None, ...]:
        return with_occluders(plates, self.occluders) if self.occluders else plates

    @property
    def makes_plates(self) -> bool:
        """Whether plates are its own affair; see `tracker.images.reading.Sequence.makes_plates`."""
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
            read = (masks.read(v, frame.position(v)) for v in range(len(frame.images)))
            shown = zip(frame.images, read, strict=True)
            yield replace(frame, masks=tuple(None if image is None else mask for image, mask in shown))
