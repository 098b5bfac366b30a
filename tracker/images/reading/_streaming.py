"""Frames of opened views as they are delivered: decoded ahead, and as bright, as large and as smooth as is asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from tracker.cameras.frame import Frame, Packed, Pictures
from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError
from tracker.images.operations.light import smoothed
from tracker.images.reading._footage import ImageStream
from tracker.images.reading._offsets import ViewOffset
from tracker.images.reading._pictures import brightened, check_size, downscaled
from tracker.images.reading._selection import OnMissing, Selection


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
        return self.gain == 1 and self.downscale == 1 and self.smoothing_px == 0

    def delivered(self, image: Image) -> Image:
        """An image or plate (h, w, 3), as recorded, as bright, as large and as smooth as images are delivered."""
        return smoothed(downscaled(brightened(image, self.gain), self.downscale), self.smoothing_px)
