"""Images made smaller, in which places are compared with what was seen there before, and persons made as small."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import cv2

from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image, Mask, Region
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis

_SMALL_PX = 180
"""The longer side of the largest image is brought to about this: a forearm is 5 px wide, and noise is a quarter."""


def reduction(rig: Rig) -> int:
    """How many pixels of an image, along each side, one of the small picture stands for, in all views."""
    return max(1, *(round(max(camera.size) / _SMALL_PX) for camera in rig.cameras))


def reduced(sight: Sight, v: int, image: Image, factor: int) -> Image:
    """The image (H, W, 3) of a view made smaller (h, w, 3); once a frame."""
    whole = 0, 0, image.shape[1], image.shape[0]
    found: Image = sight.once(_resized, v, whole, partial(_resized, image, factor))[1]
    return found


def reduced_silhouettes(scene: Scene, factor: int) -> tuple[Mask, ...]:
    """(h, w) what the persons cover of the small pictures."""
    return CpuSynthesis().silhouettes(replace(scene, rig=scene.rig.downscaled(factor)))


def _resized(image: Image, factor: int, region: Region) -> tuple[Region, Image]:
    size = image.shape[1] // factor, image.shape[0] // factor
    whole = image[: size[1] * factor, : size[0] * factor]
    small: Image = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
    return region, small
