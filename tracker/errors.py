"""The errors a user can cause: what was found, what was expected, what to do next."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class TrackerError(Exception):
    """Base of every error that the command line reports as one line and exit code 2."""


class ConfigError(TrackerError):
    """A configuration file, an override or a component's parameters are wrong."""


class CalibrationError(TrackerError):
    """A camera or a rig cannot be right."""


class SequenceError(TrackerError):
    """Images or videos are missing, truncated, corrupt or of unequal length."""


class ModelError(TrackerError):
    """A body model or a pose does not fit together."""


class RenderError(TrackerError):
    """A renderer cannot work on this machine."""


class MatchingError(TrackerError):
    """Images do not show a common surface that can be measured."""


class InitializationError(TrackerError):
    """No start pose could be found in the first frames."""


def nearest(name: str, options: Iterable[str]) -> str:
    """A hint for a misspelt name: the nearest valid one first, then all of them.

    Args:
        name: what was found.
        options: the valid names.

    Returns:
        For instance ``did you mean "chamfer"? valid: chamfer, overlap``.
    """
    valid = sorted(options)
    close = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    hint = f'did you mean "{close[0]}"? ' if close else ""
    return f"{hint}valid: {', '.join(valid) if valid else 'none'}"
