"""A frame: the synchronized images of all views at one time instant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, overload, runtime_checkable

import numpy as np

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image, Integers, Mask


def seen_pixels(camera: Camera, points: Array, spacing_px: int = 1) -> tuple[Integers, Mask]:
    """Nearest pixels (N, 2) of points, x and y, and which of the points (N,) the camera sees.

    Args:
        camera: it.
        points: (N, 3) in the world, metres.
        spacing_px: of the pixels counted, every second one for 2: those of `image[::spacing_px, ::spacing_px]`.
    """
    # near the plane of the lens the distortion runs away
    before = camera.in_camera(points)[:, 2] > 0.1
    pixels = np.full((len(points), 2), -1.0)
    pixels[before] = np.nan_to_num(camera.project(points[before]) / spacing_px, nan=-1.0)
    nearest = np.round(np.clip(pixels, -1.0, 1e6)).astype(np.int64)
    n_pixels = -(-np.array(camera.size) // spacing_px)
    seen: Mask = before & (nearest >= 0).all(axis=1) & (nearest < n_pixels).all(axis=1)
    return nearest, seen


@runtime_checkable
class Packed(Protocol):
    """An image as a codec leaves it, which takes half the memory of the image."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """(h, w, 3) of the image."""
        ...

    def image(self) -> Image:
        """The image (h, w, 3), made anew at each request."""
        ...


class Pictures(Sequence[Image | None]):
    """Images of all views, some of them packed until requested."""

    def __init__(self, views: Sequence[Image | Packed | None]) -> None:
        """Nothing is unpacked yet."""
        self.packed = tuple(views)

    def __len__(self) -> int:
        return len(self.packed)

    @overload
    def __getitem__(self, view: int) -> Image | None: ...
    @overload
    def __getitem__(self, view: slice) -> tuple[Image | None, ...]: ...
    def __getitem__(self, view: int | slice) -> Image | tuple[Image | None, ...] | None:
        if isinstance(view, slice):
            return tuple(_unpacked(one) for one in self.packed[view])
        return _unpacked(self.packed[view])


def _unpacked(view: Image | Packed | None) -> Image | None:
    return view.image() if isinstance(view, Packed) else view


@dataclass(frozen=True)
class Frame:
    """Synchronized images of all V views."""

    index: int
    """Position in the sequence, counted in frames of the reference view."""

    time_s: float
    """Time since frame 0, seconds."""

    images: Sequence[Image | None]
    """One BGR image `(h, w, 3)` a view, in the rig's order; None where that view is missing."""

    masks: tuple[Mask | None, ...] = ()
    """Silhouettes `(h, w)` of the persons that the user brings; empty for none, None where a view has none."""

    positions: tuple[int, ...] = ()
    """Number of each view's image among all that it has, from 0 on; empty if they are the frame's, negative for
    none."""

    first_number: int = 0
    """Number in the file name of an image at position 0."""

    def position(self, view: int) -> int:
        """Number of a view's image among all that it has, from 0 on."""
        return self.positions[view] if self.positions else self.index

    def unpacked(self) -> Frame:
        """The same with its images at hand: whoever looks at them again and again unpacks them once."""
        return replace(self, images=tuple(self.images)) if isinstance(self.images, Pictures) else self

    def mask(self, view: int) -> Mask | None:
        """The silhouette that the user brings for a view."""
        return self.masks[view] if self.masks else None

    @property
    def missing(self) -> tuple[int, ...]:
        """Indices of the views without an image."""
        views = self.images.packed if isinstance(self.images, Pictures) else self.images
        return tuple(v for v, image in enumerate(views) if image is None)


@runtime_checkable
class Views(Protocol):
    """Opened views: what a calibration is made from."""

    @property
    def names(self) -> tuple[str, ...]:
        """The views in order."""
        ...

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Image widths and heights, px."""
        ...

    @property
    def n_frames(self) -> int:
        """Number of frames that `frames()` delivers."""
        ...

    def frames(self) -> Iterator[Frame]:
        """All frames of the chosen range in order; may be iterated more than once."""
        ...
