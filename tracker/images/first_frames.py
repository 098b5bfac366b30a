"""The first frames of a recording, decoded once for all inspections before the tracking."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from itertools import chain, islice

from tracker.cameras.frame import Frame

_LEFT_BEHIND = 1.25
"""The frames are forgotten once a reader has passed twice their number: the tracking is past its first window then, and
the frames after it (`tracker.tracking.windows`)."""


class FirstFrames:
    """Opens a recording again and again, and keeps its first frames while they are needed.

    The inspection, the search for persons, the fit of bodies and then the tracking read them: 100 frames of four views
    of 720 x 576 took 1.2 s of CPU to decode, three or four times.
    """

    def __init__(self, opened: Callable[[], Iterator[Frame]], n_kept: int) -> None:
        """Nothing is decoded yet.

        Args:
            opened: opens the recording anew, from its first frame on.
            n_kept: number of kept frames.
        """
        self._opened, self._n_kept = opened, n_kept
        self._kept: list[Frame] = []
        self._decoding: Iterator[Frame] | None = None
        self._all_kept = False
        self._lock = threading.Lock()

    def __call__(self) -> Iterator[Frame]:
        """All frames in order; several readers may run at a time, in their own threads."""
        k = 0
        while (frame := self._kept_at(k)) is not None:
            yield frame
            k += 1
        for frame in self._after(k):
            yield frame
            k += 1
            if k == int(_LEFT_BEHIND * self._n_kept) + 1:
                self._forget()

    def _kept_at(self, k: int) -> Frame | None:
        """A kept frame, perhaps decoded now; None at the end, and beyond the kept frames."""
        with self._lock:
            if k == len(self._kept) < self._n_kept and not self._all_kept:
                self._decoding = self._decoding or self._opened()
                if (frame := next(self._decoding, None)) is None:
                    self._all_kept = True
                    return None
                self._kept.append(frame)
                if len(self._kept) == self._n_kept:
                    self._look_beyond(self._decoding)
            return self._kept[k] if k < len(self._kept) else None

    def _look_beyond(self, decoding: Iterator[Frame]) -> None:
        """Whether there is a frame after the kept ones: a recording of exactly as many is not decoded in vain."""
        beyond = list(islice(decoding, 1))
        self._decoding, self._all_kept = chain(beyond, decoding), not beyond

    def _after(self, k: int) -> Iterator[Frame]:
        """The frames from number k on: the first reader goes on decoding, others begin anew."""
        with self._lock:
            if self._all_kept:
                return iter(())
            decoding, self._decoding = self._decoding, None
            if decoding is not None and k == len(self._kept):
                return decoding
        return islice(self._opened(), k, None)

    def _forget(self) -> None:
        """Keeps nothing any more; later readers decode for themselves."""
        with self._lock:
            self._kept, self._n_kept, self._decoding = [], 0, None
