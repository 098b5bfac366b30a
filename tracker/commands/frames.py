"""Ranges of frames as the command line writes them."""

from __future__ import annotations

import re

from tracker.errors import ConfigError


def frame_range(text: str) -> tuple[int | None, int | None]:
    """The two ends of a range A:B; None for one that is left out.

    Raises:
        ConfigError: the text is no such range.
    """
    match = re.fullmatch(r"(\d*):(\d*)", text)
    if match is None:
        raise ConfigError(f"--frames {text}: expected A:B, for instance 0:100, 50: or :100")
    start, stop = (int(end) if end else None for end in match.groups())
    return start, stop
