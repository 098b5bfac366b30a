"""Pictures of keypoints over the images in which they were found."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Image

_HEIGHT_PX = 288
"""Of a view in a picture of all."""

# BGR: a limb whose sides a detector has exchanged is seen by its colour.
_LEFT, _RIGHT, _MIDDLE = (220, 120, 60), (40, 140, 255), (220, 220, 220)

_LIMBS = (
    *(("shoulder", "elbow"), ("elbow", "wrist"), ("shoulder", "hip"), ("hip", "knee"), ("knee", "ankle")),
    *(("ankle", "heel"), ("ankle", "toe"), ("eye", "ear")),
)
_BONES = (
    *((f"{side}_{one}", f"{side}_{other}") for side in ("left", "right") for one, other in _LIMBS),
    *(("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")),
)


def drawn(frame: Frame, persons: list[list[Array]], names: tuple[str, ...]) -> Image:
    """All views of a frame side by side, left limbs blue, right ones orange; paler where less is sure.

    Args:
        frame: the images; a missing one is black.
        persons: for each view (K, 3) pixel and confidence of everybody.
        names: of the K keypoints.
    """
    cells = [_view(image, own, names) for image, own in zip(frame.images, persons, strict=True)]
    picture = np.hstack(cells)
    cv2.putText(
        picture, f"frame {frame.index}", (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA
    )
    return np.ascontiguousarray(picture[:, : picture.shape[1] // 2 * 2])


def _view(image: Image | None, persons: list[Array], names: tuple[str, ...]) -> Image:
    if image is None:
        return np.zeros((_HEIGHT_PX, _HEIGHT_PX, 3), dtype=np.uint8)
    scale = _HEIGHT_PX / image.shape[0]
    size = round(scale * image.shape[1]), _HEIGHT_PX
    small: Image = np.ascontiguousarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    for person in persons:
        at = {name: mark for name, mark in zip(names, person, strict=True) if name and np.isfinite(mark).all()}
        for one, other in _BONES:
            if one in at and other in at:
                sure = min(at[one][2], at[other][2])
                start, end = (_whole((at[end][:2] + 0.5) * scale - 0.5) for end in (one, other))
                colour = _colour(one if one[:4] == other[:4] else "", sure)
                cv2.line(small, start, end, colour, 2, cv2.LINE_AA)
        for name, mark in at.items():
            cv2.circle(small, _whole((mark[:2] + 0.5) * scale - 0.5), 2, _colour(name, mark[2]), -1, cv2.LINE_AA)
    return small


def _colour(name: str, sure: float) -> tuple[float, ...]:
    full = _LEFT if name.startswith("left") else _RIGHT if name.startswith("right") else _MIDDLE
    return tuple(float(128 + (value - 128) * min(max(sure, 0.2), 1.0)) for value in full)


def _whole(place: Array) -> tuple[int, int]:
    x, y = np.clip(np.round(place), -10_000, 10_000).astype(int).tolist()
    return x, y


def pages(pictures: list[Image]) -> Image:
    """Pictures one below the other; a view that is missing somewhere leaves its place black."""
    width = max(picture.shape[1] for picture in pictures)
    rows = [np.pad(one, ((0, 0), (0, width - one.shape[1]), (0, 0))) for one in pictures]
    whole: Image = np.vstack(rows)
    return whole
