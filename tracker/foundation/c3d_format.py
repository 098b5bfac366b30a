"""Limits of C3D files, and the package that writes them."""

from __future__ import annotations

import importlib
from typing import Any

from tracker.foundation.errors import ConfigError

_MOST_FRAMES = 2**16 - 1
"""The header counts frames in two bytes."""


def check_frames(n_frames: int, asked: str) -> None:
    """Refuses files beyond the format: ezc3d writes them without the last frames.

    Args:
        n_frames: of the file.
        asked: setting or option of the user, for the message.

    Raises:
        ConfigError: there are more than 65535.
    """
    if n_frames > _MOST_FRAMES:
        raise ConfigError(f"{asked}: {n_frames} frames, a C3D file holds at most {_MOST_FRAMES}: write parts, or TRC")


def c3d_library(asked: str = 'recording "c3d"') -> Any:
    """The package ezc3d.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        return importlib.import_module("ezc3d")
    except ImportError as error:
        raise ConfigError(f"{asked} needs the Python package ezc3d: pip install ezc3d") from error
