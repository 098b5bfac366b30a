"""The first frames of a recording, decoded once: several look at them before the recording is tracked."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from itertools import chain, islice

from tracker.cameras.frame import Frame

_LEFT_BEHIND = 1.25
"""The frames are forgotten once somebody has read more than so many times as many: the tracking is past its first
window then, and what is tracked on from it (`tracker.tracking.windows`)."""


class FirstFrames:
    """Opens a recording again and again, and keeps its first frames as long as they are looked at.

    Input is inspected, persons are looked for, bodies are fitted and then all is tracked: 100 frames of four views of
    720 x 576 took 1.2 s of CPU to decode, three or four times.
    """

    def __init__(self, opened: Callable[[], Iterator[Frame]], n_kept: int) -> None:
        """Nothing is decoded yet.

        Args:
            opened: opens the recording anew, from its first frame on.
            n_kept: frames that are kept.
        """
        self._opened, self._n_kept = opened, n_kept
        self._kept: list[Frame] = []
        self._decoding: Iterator[Frame] | None = None
        self._all_kept = False
        self._lock = threading.Lock()

    def __call__(self) -> Iterator[Frame]:
        """All frames in order; several may be on their way at a time, in threads of their own."""
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
        """A frame that is kept, perhaps from now on; None at the end, and for those that are not."""
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
        """Whether there is a frame after those that are kept: a recording of just as many is not decoded for none."""
        beyond = list(islice(decoding, 1))
        self._decoding, self._all_kept = chain(beyond, decoding), not beyond

    def _after(self, k: int) -> Iterator[Frame]:
        """The frames from number k on: whoever is first goes on decoding, others begin anew."""
        with self._lock:
            if self._all_kept:
                return iter(())
            decoding, self._decoding = self._decoding, None
            if decoding is not None and k == len(self._kept):
                return decoding
        return islice(self._opened(), k, None)

    def _forget(self) -> None:
        """Keeps nothing any more; who comes later decodes for himself."""
        with self._lock:
            self._kept, self._n_kept, self._decoding = [], 0, None
