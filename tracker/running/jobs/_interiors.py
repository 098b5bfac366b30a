"""Cameras that saw the board one at a time, and then together: the recordings as one, one after the other."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

from tracker.cameras.frame import Frame, Views
from tracker.foundation.errors import CalibrationError, ConfigError, nearest
from tracker.images.reading import Reading


@dataclass(frozen=True)
class ThenAlone:
    """The common recording, and after it those of single cameras, in which the others have no image."""

    common: Views
    alone: tuple[tuple[int, Views], ...]
    """Number of a camera, and its own recording."""

    @property
    def names(self) -> tuple[str, ...]:
        """The views in order."""
        return self.common.names

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Image widths and heights, px."""
        return self.common.sizes

    @property
    def n_frames(self) -> int:
        """Frames of all the recordings."""
        return self.common.n_frames + sum(views.n_frames for _, views in self.alone)

    def frames(self) -> Iterator[Frame]:
        """Frames of the common recording, then of the others; each has a number of its own."""
        last = -1
        for frame in self.common.frames():
            last = max(last, frame.index)
            yield frame
        numbers = itertools.count(last + 1)
        for view, views in self.alone:
            for frame in views.frames():
                images = tuple(frame.images[0] if v == view else None for v in range(len(self.names)))
                yield replace(frame, index=next(numbers), images=images)


def then_alone(common: Views, reading: Reading) -> ThenAlone:
    """Opens the recordings of single cameras, which need be neither synchronous nor of one length.

    Args:
        common: of all cameras.
        reading: its `views` choose the cameras that have one, all if it is empty.

    Raises:
        ConfigError: it chooses none of the views.
        CalibrationError: an image size is another one than in the common recording.
        SequenceError: a file is missing or damaged.
    """
    if not dataclasses.is_dataclass(reading) or not hasattr(reading, "views"):
        raise ConfigError("[interiors]: a reading that has `views` is needed: video or images")
    chosen = tuple(reading.views) or common.names
    unknown = next((name for name in chosen if name not in common.names), None)
    if unknown is not None:
        raise ConfigError(f'[interiors]: views: "{unknown}"; {nearest(unknown, common.names)}')
    alone = []
    for name in chosen:
        view = common.names.index(name)
        opened = replace(reading, views=(name,)).open_uncalibrated()
        if opened.sizes[0] != common.sizes[view]:
            found, expected = ("x".join(map(str, size)) for size in (opened.sizes[0], common.sizes[view]))
            raise CalibrationError(
                f'camera "{name}": its own recording has {found} px, the common one {expected}: the interior holds for '
                "one image size only"
            )
        alone.append((view, opened))
    return ThenAlone(common, tuple(alone))
