"""The first frame in which every person is there: many recordings begin before the persons walk in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Mask
from tracker.foundation.progress import Progress, silent
from tracker.images.inspection._survey import LEAST_SHARE, is_cut, small, small_plates
from tracker.images.plate import MOST_LEVEL, Plate, changed

_LEAST_VIEWS = 2
"""Time in which every person must be seen, whole, by a start that need not wait for more."""

_LEAST_AS_LARGE = 0.4
"""Share of the largest region from which on another one is another person: of a dancer in four views shadows and
cut-off limbs were 0.2 to 0.33, a woman who walked in before him 0.46 and more once three views had most of her."""

_ENTERING_S = 2.0
"""Time that a walking person takes from the edge of two images into the full view of most cameras."""


@dataclass(frozen=True, order=True)
class _Seen:
    """Number of views in which every person is seen: whole, that is not cut by the border of the image, and at all."""

    whole: int
    views: int


def first_in_view(
    frames: Iterable[Frame], plates: tuple[Plate | None, ...], n_persons: int = 1, progress: Progress = silent
) -> int | None:
    """The number of the first frame that shows every person well enough for a start.

    It is the first one in which two views show every person whole. Otherwise it is one of the two seconds from the
    first frame on in which two views show every person at all: the first one in which all of those views except one
    show as many persons whole as any frame does. A view shows as many persons as it has regions: a person before
    another one is one region with the other, so that the frame may be later than necessary, never earlier.

    Args:
        frames: from the first one on.
        plates: the clean plates of the views.
        n_persons: number of persons.
        progress: told if it is not the first frame.

    Returns:
        None if no frame shows that many, or fewer than two views have a plate, or masks.
    """
    backgrounds = small_plates(plates)
    coming: dict[int, _Seen] = {}
    end_s, looked = np.inf, False
    for frame in frames:
        if frame.time_s > end_s or not (frame.masks or _n_telling(frame, plates) >= _LEAST_VIEWS):
            break
        if _n_telling(frame, plates) < _LEAST_VIEWS:
            continue  # a view lacks its mask here
        seen = _seen(frame, backgrounds, n_persons)
        if not coming and seen.whole >= _LEAST_VIEWS:
            return frame.index
        if not looked:
            looked = True
            progress(f"looking for the first frame that shows {_told(n_persons)}")
        if coming or seen.views >= _LEAST_VIEWS:
            end_s = min(end_s, frame.time_s + _ENTERING_S)
            coming[frame.index] = seen
    if not coming:
        return None
    best = max(coming.values())
    enough = _Seen(max(best.whole - 1, 0), best.views if best.whole == 0 else _LEAST_VIEWS)
    return next(index for index, seen in coming.items() if seen >= enough)


def _told(n_persons: int) -> str:
    return "somebody" if n_persons == 1 else f"all {n_persons} persons"


def _n_telling(frame: Frame, plates: tuple[Plate | None, ...]) -> int:
    return sum(plate is not None or frame.mask(v) is not None for v, plate in enumerate(plates))


def _seen(frame: Frame, plates: tuple[Plate | None, ...], n_persons: int) -> _Seen:
    views = [_shown(frame, v, plate, n_persons) for v, plate in enumerate(plates)]
    return _Seen(sum(whole for _, whole in views), sum(everybody for everybody, _ in views))


def _shown(frame: Frame, v: int, plate: Plate | None, n_persons: int) -> tuple[bool, bool]:
    """Whether a view shows every person, and whole; a view in another light may do so."""
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
    regions = _regions(foreground)[:n_persons]
    everybody = len(regions) == n_persons
    return everybody, everybody and not any(is_cut(region) for region in regions)


def _regions(mask: Mask) -> list[Mask]:
    """The regions of a mask that can be persons by their size, also beside the largest one, which comes first."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    least = max(LEAST_SHARE * mask.size, _LEAST_AS_LARGE * areas.max(initial=0))
    return [labels == 1 + n for n in np.argsort(-areas, kind="stable") if areas[n] >= least]
