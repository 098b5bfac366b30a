"""The unit of length of a marker file: what the file says, or else what the marker set says."""

from __future__ import annotations

from pathlib import Path

from tracker.errors import SequenceError, nearest, shortened
from tracker.markers import METRES_PER_UNIT, metres_in


def metres_per_unit(path: Path, entry: str, found: str, told: str | None) -> float:
    """Metres in the unit of a file.

    Args:
        path: of the file, for messages.
        entry: of the file that names the unit, for messages.
        found: what stands there; empty where nothing does.
        told: what the marker set says, for files that say nothing.

    Raises:
        SequenceError: nobody says it, it is no unit of length, or file and set disagree.
    """
    if not found and told is None:
        raise SequenceError(f'{path}: {entry} is missing: say it in the marker set, for instance unit = "mm"')
    metres = metres_in(found or told or "")
    if metres is None:
        raise SequenceError(f'{path}: {entry} is "{shortened(found)}"; {nearest(found, METRES_PER_UNIT)}')
    if told is not None and metres != metres_in(told):
        raise SequenceError(
            f'{path}: {entry} is "{shortened(found)}", and the marker set says unit = "{told}": leave it out of the set'
        )
    return metres
