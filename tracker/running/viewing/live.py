"""A run, looked at while it tracks."""

from __future__ import annotations

import threading
from typing import Any

from tracker.foundation.errors import TrackerError
from tracker.foundation.progress import Progress
from tracker.running.run import Run
from tracker.running.viewing.viewer import Viewer

_TOLD_EVERY = 25
"""Frames between two lists of the worst ones."""


class LiveRun:
    """A run in a thread of its own; nothing is written."""

    def __init__(self, run: Run, server: Any, progress: Progress) -> None:
        """Begins to track.

        Args:
            run: its inputs are opened here.
            server: where it is shown.
            progress: told how far it is.

        Raises:
            TrackerError: an input cannot be used.
        """
        n_frames = len(run)
        self.viewer = Viewer(server, run.scene, run.opened.sequence.interval_s, n_frames)
        self.viewer.follow()
        self._run, self._progress = run, progress
        self._stopped = threading.Event()
        self.fault: TrackerError | None = None
        self.done = threading.Event()
        self._thread = threading.Thread(target=self._track, daemon=True)
        self._thread.start()

    def _track(self) -> None:
        try:
            for n_done, step in enumerate(self._run, start=1):
                if self._stopped.is_set():
                    return
                self.viewer.add(step)
                self._progress("tracking", n_done, len(self._run))
                if n_done % _TOLD_EVERY == 0:
                    self.viewer.tell_doubts()
            self.viewer.tell_doubts()
        except TrackerError as error:
            self.fault = error
        finally:
            self.done.set()

    def close(self) -> None:
        """Ends with the frame at work."""
        self._stopped.set()
        self._thread.join()
