"""Errors that a user can cause: what was found, what was expected, what to do next."""

from __future__ import annotations

import difflib
import errno
import itertools
from collections.abc import Iterable


class TrackerError(Exception):
    """Base of every error that the command line reports as one line and exit code 2."""

    def __str__(self) -> str:
        """One line of bounded length, whatever names and values a file holds."""
        text = " ".join(super().__str__().split("\n"))
        return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


_LONGEST = 2000
"""Characters of a message; the longest of ours has 700."""


class InstallationError(TrackerError):
    """The compiled part of the package is missing, cannot be loaded, or was built from other sources."""


class ConfigError(TrackerError):
    """A configuration file, an override or a component's parameters are wrong."""


class CalibrationError(TrackerError):
    """A camera or a rig is impossible."""


class SequenceError(TrackerError):
    """Images or videos are missing, truncated, corrupt or of unequal length."""


class ModelError(TrackerError):
    """A body model or a pose does not fit together."""


class RenderError(TrackerError):
    """A renderer cannot work on this machine."""


class MatchingError(TrackerError):
    """Images do not show a common surface that can be measured."""


class InitializationError(TrackerError):
    """The first frames show no start pose."""


class GivenUpError(TrackerError):
    """The search of a frame ran out of time; unlike after an `InitializationError`, no other frame is tried."""


class BackdropError(InitializationError):
    """The plates of the recording show the person, who stays in place most of the time and does not stand out."""


def nearest(name: str, options: Iterable[str]) -> str:
    """A hint for a misspelt name: the nearest valid one first, then all of them.

    Args:
        name: what was found.
        options: the valid names.

    Returns:
        For instance ``did you mean "chamfer"? valid: chamfer, overlap``; ``none is there`` without valid names.
    """
    valid = sorted({shortened(str(option)) for option in itertools.islice(options, _MOST_LOOKED_AT)} - {""})
    if not valid:
        return "none is there"
    found, folded = name[:_LONGEST_QUOTE].casefold(), {option.casefold(): option for option in valid}
    candidates = difflib.get_close_matches(found, folded, n=_MOST_COMPARED, cutoff=0.5)
    close = next((folded[option] for option in candidates if _alike(found, option)), None)
    hint = f'did you mean "{close}"? ' if close else ""
    more = f" and {len(valid) - _MOST_SHOWN} more" if len(valid) > _MOST_SHOWN else ""
    return f"{hint}valid: {', '.join(valid[:_MOST_SHOWN])}{more}"


def _alike(one: str, other: str) -> bool:
    """Whether one name may stand for another: one begins with the other, or few letters are wrong, or their order."""
    if min(len(one), len(other)) >= _BEGINNING and (one.startswith(other) or other.startswith(one)):
        return True
    longest = max(len(one), len(other))
    if longest >= _BEGINNING and sorted(one) == sorted(other):
        return True
    return longest > 1 and _n_typos(one, other) <= max(1, longest // _LETTERS_A_TYPO)


def _n_typos(one: str, other: str) -> int:
    """Number of letters that are missing, extra, wrong, or exchanged with their neighbours (optimal alignment)."""
    before, row = [0] * (len(other) + 1), list(range(len(other) + 1))
    for i, a in enumerate(one, start=1):
        last, row = row, [i]
        for j, b in enumerate(other, start=1):
            n = min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (a != b))
            if i > 1 and j > 1 and a == other[j - 2] and one[i - 2] == b:
                n = min(n, before[j - 2] + 1)
            row.append(n)
        before = last
    return row[-1]


_MOST_COMPARED = 5
"""Number of names that are compared letter by letter: those with most letters in common."""

_BEGINNING = 3
"""Letters of a beginning that identifies a name."""

_LETTERS_A_TYPO = 3
"""Number of letters of which one may be wrong; "persons" and "interiors" share half of theirs, and neither is the
other."""


def shortened(text: str) -> str:
    """Text of a file, shortened for a message."""
    return text if len(text) <= _LONGEST_QUOTE else f"{text[:_LONGEST_QUOTE]}..."


_LONGEST_QUOTE = 60
"""Characters of a file in a message."""

_MOST_SHOWN = 60
"""Names listed in a message; a pose has 36 parameters."""

_MOST_LOOKED_AT = 2000
"""Names compared: a file can have any number."""


def os_fault(error: OSError) -> str:
    """One sentence about a refusal of the system: the file, the reason, and what to do."""
    where = f"{error.filename}: " if error.filename is not None else ""
    mended = {
        errno.ENOSPC: "; free some space: what was written before is whole, and a run goes on with --resume",
        errno.EDQUOT: "; free some space: what was written before is whole, and a run goes on with --resume",
        errno.EACCES: "; choose another folder, or change its permissions",
        errno.EROFS: "; choose another --output",
        errno.ENAMETOOLONG: "; choose a shorter name",
        errno.EMFILE: "; raise the limit: ulimit -n 4096",
    }
    told = (error.strerror or str(error)).replace("\n", " ")
    return f"{where}{told[:1].lower()}{told[1:]}{mended.get(error.errno or 0, '')}"


def name_fault(name: str) -> str:
    """Why a name cannot become part of a file's name: of a run, a person, a camera, a model, a movement.

    Args:
        name: what was found.

    Returns:
        The reason, empty if it can.
    """
    if not name.strip() or name in (".", ".."):
        return f"{name!r}: expected a name"
    if len(name.encode(errors="replace")) > _LONGEST_NAME:
        return f"{name[:20]!r}...: a name of {len(name)} characters, expected at most {_LONGEST_NAME} bytes"
    wrong = next((sign for sign in name if sign in "/\\" or not sign.isprintable()), "")
    return f"{name!r}: {wrong!r} in the name, expected a name that files can have" if wrong else ""


_LONGEST_NAME = 120
"""Bytes: file systems take 255, and names have endings and numbers."""
