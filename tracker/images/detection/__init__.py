"""Detection: keypoints of persons in single images, by other programs' networks.

No run needs a detector. `bodytrack detect` writes a detector's keypoints into files, which `keypoints` of a run then
names.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Any, ClassVar, Protocol, runtime_checkable

from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import ConfigError

Finder = Callable[[Image], Array]
"""Takes an image (h, w, 3), BGR, and gives (N, K, 3) pixel x, y and confidence 0 to 1 for each of N persons; NaN for a
keypoint that was not found. It knows nothing of other images, so the order of images does not matter."""


@runtime_checkable
class Detection(Protocol):
    """A component that finds keypoints in images."""

    layout: ClassVar[str]
    """Order of its keypoints in `tracker.bodies.keypoint_layouts.orders.LAYOUTS`."""

    def open(self) -> Finder:
        """Loads the network.

        Raises:
            ConfigError: a package that it needs is not installed, or cannot be used here.
        """
        ...

    def about(self) -> str:
        """Name and version of the network; networks with other keypoints have other names."""
        ...


# Packages of detectors, which are optional: loaded late, and a missing one is named in one sentence.


def library(name: str, wanted: str) -> Any:
    """The package of a detector.

    Args:
        name: of the package and the component.
        wanted: argument of `pip install`.

    Raises:
        ConfigError: it is not installed, or lacks something that it needs.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        lacking = str(error.name).partition(".")[0]
        raise ConfigError(
            f'detector "{name}" needs the Python package {lacking}: pip install {wanted}, best into an environment of '
            "its own (docs/formats.md, 2-D keypoints)"
        ) from error
    except ImportError as error:
        raise ConfigError(f'detector "{name}" is installed and cannot be loaded: {_first_line(error)}') from error


def version_of(name: str) -> str:
    """Version of an installed package; a word if it has none."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "of unknown version"


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)
