"""Images made smaller, in which places are compared with what was seen there before, and persons made as small."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import cv2

from tracker.arrays import Image, Mask, Region
from tracker.scene import Scene
from tracker.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis

_SMALL_PX = 180
"""The longer side of an image is brought to about this: a forearm is then 5 px wide, and noise is a quarter."""


def reduction(image: Image) -> int:
    """How many pixels of an image, along each side, one of the small picture stands for."""
    longest: int = max(image.shape[:2])
    return max(1, round(longest / _SMALL_PX))


def common_reduction(images: Iterable[Image | None]) -> int:
    """The reduction that all views of a frame have in common; 1 where every image is missing."""
    return max((reduction(image) for image in images if image is not None), default=1)


def reduced(sight: Sight, v: int, image: Image) -> Image:
    """The image (H, W, 3) of a view made smaller (h, w, 3); once a frame."""
    whole = 0, 0, image.shape[1], image.shape[0]
    found: Image = sight.once(_resized, v, whole, partial(_resized, image))[1]
    return found


def reduced_silhouettes(scene: Scene, sight: Sight) -> tuple[Mask, ...]:
    """(h, w) what the persons cover of the small pictures."""
    return CpuSynthesis().silhouettes(replace(scene, rig=scene.rig.downscaled(common_reduction(sight.frame.images))))


def _resized(image: Image, region: Region) -> tuple[Region, Image]:
    factor = reduction(image)
    size = image.shape[1] // factor, image.shape[0] // factor
    whole = image[: size[1] * factor, : size[0] * factor]
    small: Image = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
    return region, small
