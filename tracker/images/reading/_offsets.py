"""Which image of a view belongs to which frame: so many later, the same all along or from some frame on."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import pydantic
from pydantic_core import PydanticCustomError

from tracker.foundation.errors import SequenceError, nearest

_Change = tuple[int, int]

MISSING = -1
"""Number of no image."""


def _checked(told: Any) -> Any:
    if _whole(told):
        return told
    pairs = [tuple(one) for one in told if isinstance(one, list | tuple)] if isinstance(told, list | tuple) else []
    whole = bool(pairs) and len(pairs) == len(told) and all(len(one) == 2 and all(map(_whole, one)) for one in pairs)
    if not whole or pairs[0][0] != 0 or any(after[0] <= before[0] for before, after in itertools.pairwise(pairs)):
        raise PydanticCustomError(
            "offset",
            "expected a number of frames, or pairs [frame, offset] in the order of frames, the first one of frame 0",
        )
    return tuple(pairs)


def _whole(told: Any) -> bool:
    return isinstance(told, int) and not isinstance(told, bool)


Offset = Annotated[int | tuple[_Change, ...], pydantic.BeforeValidator(_checked)]
"""Frames, or pairs of a frame and the offset from it on."""

Offsets = dict[str, Offset]
"""View -> offset."""


@dataclass(frozen=True)
class ViewOffset:
    """The offset of a view."""

    changes: tuple[_Change, ...] = ((0, 0),)
    """From which frame on it is which."""

    def number(self, frame: int) -> int:
        """The image of a frame in the view's own count, negative for none.

        Where an offset gets less, the camera has dropped images: the last one before is the nearest to one frame more,
        and others have none.
        """
        last, number = MISSING, MISSING
        for (begin, offset), (end, _) in itertools.pairwise((*self.changes, (frame + 1, 0))):
            if begin <= frame:
                number = frame + offset
                if frame >= end:
                    last = max(last, end - 1 + offset)
        return number if number >= last else MISSING

    def frame(self, number: int) -> int:
        """The frame that an image is nearly of, where offsets change; see `number`."""
        return number - self.changes[0][1]

    def length(self, n_images: int) -> int:
        """The frames that so many images are enough for."""
        return n_images - self.changes[-1][1]

    @property
    def first(self) -> int:
        """The first frame that has an image."""
        return max(0, -self.changes[0][1])


def chosen_offsets(names: tuple[str, ...], offsets: Mapping[str, Offset]) -> tuple[ViewOffset, ...]:
    """Offsets in the order of the views.

    Raises:
        SequenceError: an offset for a view that is not there.
    """
    for name in offsets:
        if name not in names:
            raise SequenceError(f'offsets: no view "{name}"; {nearest(name, names)}')
    told = (offsets.get(name, 0) for name in names)
    return tuple(ViewOffset(((0, one),) if isinstance(one, int) else one) for one in told)


def later(offset: Offset, images: Mapping[int, int]) -> Offset:
    """An offset made larger, from some frames on, by so many images each.

    Args:
        offset: as it is.
        images: frame -> how many more from it on, in order; the first one holds from the beginning on.
    """
    before: tuple[_Change, ...] = ((0, offset),) if isinstance(offset, int) else offset
    begins, more = sorted(images), [images[begin] for begin in sorted(images)]
    begins[0] = 0
    changes: list[_Change] = []
    for frame in sorted({*begins, *(frame for frame, _ in before)}):
        own = [value for begin, value in before if begin <= frame][-1]
        added = own + [value for begin, value in zip(begins, more, strict=True) if begin <= frame][-1]
        if not changes or changes[-1][1] != added:
            changes.append((frame, added))
    return changes[0][1] if len(changes) == 1 else tuple(changes)
