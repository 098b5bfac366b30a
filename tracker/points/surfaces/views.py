"""Images made ready for a surface measurement, and checked for what makes one impossible."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pydantic

from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array32, Image
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import MatchingError, SequenceError
from tracker.images.operations.appearance import wallis_filter

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
    """What happens to the images before they are matched."""

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
