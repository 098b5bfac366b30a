"""Detection: keypoints of persons in single images, found by networks of others.

No run needs a detector. `bodytrack detect` writes what one finds into files, which `keypoints` of a run then names.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Protocol, runtime_checkable

from tracker.foundation.arrays import Array, Image

Finder = Callable[[Image], Array]
"""Takes an image (h, w, 3), BGR, and gives (N, K, 3) pixel x, y and confidence 0 to 1 for each of N persons; NaN for a
keypoint that was not found. It knows nothing of other images: what is detected later is what would have been before."""


@runtime_checkable
class Detection(Protocol):
    """A component that finds keypoints in images."""

    layout: ClassVar[str]
    """Which of `tracker.bodies.keypoint_layouts.orders.LAYOUTS` its keypoints have."""

    def open(self) -> Finder:
        """Loads the network.

        Raises:
            ConfigError: a package that it needs is not installed, or cannot be used here.
        """
        ...

    def about(self) -> str:
        """Which network of which version it is; two that find other keypoints are called otherwise."""
        ...
