"""Analysis: the edges that the images show, given what is expected."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.bodies.contours import Contours
from tracker.images.observation import Observation
from tracker.images.sight import Sight


@runtime_checkable
class Analysis(Protocol):
    """A component that finds scene features near the expected contours."""

    def observe(self, sight: Sight, expected: Contours | None) -> Observation:
        """Scene features of all views.

        Args:
            sight: the images, and a clean plate for each view that has one.
            expected: contours of the prediction (several poses where there are several candidates); None to
                look everywhere and accept everything.

        Returns:
            One finding a view, None for missing views.
        """
        ...

    def look(self, sight: Sight, around: Contours) -> None:
        """Does ahead what the images alone tell near contours of an earlier frame, and leaves it in the sight.

        By default nothing.

        Args:
            sight: the frame to come.
            around: contours of all persons some frames before.
        """
        return
