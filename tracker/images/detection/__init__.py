"""Detection: keypoints of persons in single images, found by networks of others.

No run needs a detector. `bodytrack detect` writes what one finds into files, which `keypoints` of a run then names.
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


# Packages of detectors, which no installation has unasked: loaded late, and what is missing said in one sentence.


def library(name: str, wanted: str) -> Any:
    """The package of a detector.

    Args:
        name: of the package, which the component is called after.
        wanted: what to install, as pip is told.

    Raises:
        ConfigError: it is not installed, or it does not find what it needs.
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
    """Of an installed package; a word where it tells none."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "of unknown version"


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)
