"""Analysis: what the images show, given what is expected."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from tracker.arrays import Image
from tracker.contours import Contours
from tracker.frame import Frame
from tracker.observation import Observation

Looked = tuple[Any, ...]
"""What an analysis has seen in each view; None for a missing view."""


@runtime_checkable
class Analysis(Protocol):
    """A component that finds scene features near the expected contours."""

    def observe(self, frame: Frame, expected: Contours | None, backgrounds: tuple[Image | None, ...]) -> Observation:
        """Scene features of all views.

        Args:
            frame: the images.
            expected: contours of the prediction (several poses where there are several candidates); None to
                look everywhere and accept everything.
            backgrounds: a clean plate for each view that has one.

        Returns:
            One finding a view, None for missing views.
        """
        ...


@runtime_checkable
class LooksAhead(Protocol):
    """An analysis whose work on the images alone can be done while the frame before is still being estimated."""

    def look(self, frame: Frame, around: Contours, backgrounds: tuple[Image | None, ...]) -> Looked:
        """What the images show near contours of an earlier frame.

        Args:
            frame: the images.
            around: contours of all persons some frames before.
            backgrounds: a clean plate for each view that has one.
        """
        ...

    def judge(
        self, looked: Looked, frame: Frame, expected: Contours, backgrounds: tuple[Image | None, ...]
    ) -> Observation:
        """What `Analysis.observe` returns, from what was seen already where that reaches far enough."""
        ...
