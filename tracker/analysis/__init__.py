"""Analysis: what the images show, given what is expected."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.arrays import Image
from tracker.contours import Contours
from tracker.frame import Frame
from tracker.observation import Observation


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
