"""A segmented frame as a picture, like figures 2 and 9 of Rosenhahn et al. 2006."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.bodies.contours import ViewContours
from tracker.foundation.arrays import Array, Image, Mask
from tracker.running.viewing.segmentation import Segmented, SegmentedView

# BGR; what lies between is blue, lighter step by step.
_START, _FIRST, _LAST, _RESULT = (60, 60, 255), (160, 60, 0), (255, 220, 90), (255, 255, 255)

_MARGIN = 1.15
"""Longer side of what is shown of a view, over that of the person."""

_HEIGHT = 1.3
"""Height over width of a view's picture: persons are upright."""

_SUBPIXEL = 4
"""Binary digits after the point in OpenCV's drawing."""


def picture_of(segmented: Segmented, width_px: int) -> Image:
    """A column a view: the pose found, the contour without the shape prior, the contour with it.

    Contours are red where they begin, blue on their way and white where they end.

    Args:
        segmented: a frame; at least one view.
        width_px: of the picture.
    """
    width = width_px // len(segmented.views)
    columns = [_column(view, (width, round(_HEIGHT * width))) for view in segmented.views]
    picture: Image = np.ascontiguousarray(np.hstack(columns))
    states = ", ".join(sorted(set(segmented.statuses)))
    _write(picture, f"frame {segmented.frame}, {segmented.time_s:.2f} s, {states}", (8, 18))
    return picture


def _column(view: SegmentedView, size: tuple[int, int]) -> Image:
    """The pictures (h, w, 3) of a view below each other, each of a size."""
    window = _window(view, size)
    found = cv2.warpAffine(view.image, window, size, flags=cv2.INTER_LINEAR)
    rows = [found.copy() for _ in range(3)]
    _draw_pose(rows[0], view.pose, window)
    for row, stages in zip(rows[1:], (view.alone, view.held), strict=True):
        for k, mask in enumerate(stages):
            _draw_outline(row, mask, window, _shade(k, len(stages)))
    for row, name in zip(rows, _told(view), strict=True):
        _write(row, f"{view.name}: {name}", (8, size[1] - 8))
    column: Image = np.vstack(rows)
    return column


def _told(view: SegmentedView) -> tuple[str, str, str]:
    """What is seen in the three pictures of a view."""
    ways = ("contour without shape", view.alone), ("contour with shape", view.held)
    alone, held = (what if stages else f"{what}: unknown" for what, stages in ways)
    return "pose found", alone, held


def _window(view: SegmentedView, size: tuple[int, int]) -> Array:
    """(2, 3) from pixels of the view to those of its picture, which the person fills."""
    drawn = np.any([view.silhouette, *view.alone, *view.held], axis=0)
    x, y, width, height = cv2.boundingRect(drawn.view(np.uint8)) if drawn.any() else (0, 0, *drawn.shape[::-1])
    scale = min(size[0] / width, size[1] / height) / _MARGIN
    centre = np.array([x + (width - 1) / 2, y + (height - 1) / 2])
    shift = (np.array(size) - 1) / 2 - scale * centre
    return np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])


def _draw_pose(picture: Image, pose: ViewContours, window: Array) -> None:
    """Draws each sample of the model's contours as a piece of it, those between touching parts not."""
    seen = ~pose.between
    along = np.stack([-pose.normals[seen, 1], pose.normals[seen, 0]], axis=1) * pose.weights[seen, None] / 2
    ends = np.stack([pose.pixels[seen] - along, pose.pixels[seen] + along], axis=1)
    places = 2**_SUBPIXEL * (ends @ window[:, :2].T + window[:, 2])
    pieces = [np.rint(piece).astype(np.int32) for piece in places]
    cv2.polylines(picture, pieces, False, _RESULT, 1, cv2.LINE_AA, _SUBPIXEL)


def _shade(k: int, n: int) -> tuple[float, ...]:
    """Colour of the k-th of n contours."""
    if k in (0, n - 1):
        return _START if k == 0 else _RESULT
    share = (k - 1) / max(n - 3, 1)
    return tuple((1 - share) * one + share * other for one, other in zip(_FIRST, _LAST, strict=True))


def _draw_outline(picture: Image, mask: Mask, window: Array, colour: tuple[float, ...]) -> None:
    """Draws the outline of a mask of the whole view."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    for outline in outlines:
        places = 2**_SUBPIXEL * (outline[:, 0] @ window[:, :2].T + window[:, 2])
        cv2.polylines(picture, [np.rint(places).astype(np.int32)], True, colour, 1, cv2.LINE_AA, _SUBPIXEL)


def _write(picture: Image, text: str, place: tuple[int, int]) -> None:
    for shift, shade in ((1, (0, 0, 0)), (0, _RESULT)):
        where = place[0] + shift, place[1] + shift
        cv2.putText(picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.45, shade, 1, cv2.LINE_AA)
