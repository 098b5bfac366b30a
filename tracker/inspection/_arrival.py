"""From which frame on somebody is there: many recordings begin before who is filmed walks in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from tracker.arrays import Mask
from tracker.frame import Frame
from tracker.inspection._survey import LEAST_SHARE, is_cut, small, small_plates
from tracker.plate import MOST_LEVEL, Plate, changed
from tracker.progress import Progress, silent

_LEAST_VIEWS = 2
"""In which somebody has to be seen, whole, by a start that has them and need not wait for more."""

_ENTERING_S = 2.0
"""How long somebody takes from the edge of two images to where most cameras see all of him, walking."""


@dataclass(frozen=True, order=True)
class _Seen:
    """In how many views somebody is seen: whole, that is not cut by the border of the image, and at all."""

    whole: int
    views: int


def first_in_view(frames: Iterable[Frame], plates: tuple[Plate | None, ...], progress: Progress = silent) -> int | None:
    """The number of the first frame that shows somebody well enough for a start.

    The first one in which two views show somebody whole. Where that is not so at once, one of the two seconds from the
    first frame on in which two views show somebody at all: the first one in which all but one of those views do so that
    show all of him at once in any.

    Args:
        frames: from the first one on.
        plates: the clean plates of the views.
        progress: told if it is not the first one.

    Returns:
        None if none shows anybody, or fewer than two views have a plate, or masks, to tell.
    """
    backgrounds = small_plates(plates)
    coming: dict[int, _Seen] = {}
    end_s = np.inf
    for n, frame in enumerate(frames):
        if frame.time_s > end_s or _n_telling(frame, plates) < _LEAST_VIEWS:
            break
        seen = _seen(frame, backgrounds)
        if not coming and seen.whole >= _LEAST_VIEWS:
            return frame.index
        if n == 0:
            progress("looking for the first frame that shows somebody")
        if coming or seen.views >= _LEAST_VIEWS:
            end_s = min(end_s, frame.time_s + _ENTERING_S)
            coming[frame.index] = seen
    if not coming:
        return None
    best = max(coming.values())
    enough = _Seen(max(best.whole - 1, 0), best.views if best.whole == 0 else _LEAST_VIEWS)
    return next(index for index, seen in coming.items() if seen >= enough)


def _n_telling(frame: Frame, plates: tuple[Plate | None, ...]) -> int:
    return sum(plate is not None or frame.mask(v) is not None for v, plate in enumerate(plates))


def _seen(frame: Frame, plates: tuple[Plate | None, ...]) -> _Seen:
    views = [_shown(frame, v, plate) for v, plate in enumerate(plates)]
    return _Seen(sum(whole for _, whole in views), sum(somebody for somebody, _ in views))


def _shown(frame: Frame, v: int, plate: Plate | None) -> tuple[bool, bool]:
    """Whether a view shows somebody, and whole; one that cannot tell, in another light, may show anybody."""
    image, mask = frame.images[v], frame.mask(v)
    if mask is not None:
        foreground = small(mask.astype(np.uint8)) > 0
    elif image is None or plate is None:
        return False, False
    else:
        found = changed(small(image), plate)
        if found.level > MOST_LEVEL or plate.unknown is not None:
            return True, True
        foreground = found.foreground
    region = _largest(foreground)
    return region is not None, region is not None and not is_cut(region)


def _largest(mask: Mask) -> Mask | None:
    """The largest region of a mask; None where it is no person's for its size."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    if not len(areas) or areas.max() < LEAST_SHARE * mask.size:
        return None
    region: Mask = labels == 1 + int(areas.argmax())
    return region
