"""Packages of detectors, which no installation has unasked: loaded late, and what is missing said in one sentence."""

from __future__ import annotations

import importlib
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from tracker.foundation.errors import ConfigError


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
