"""The extension that native/ is built into: compiled inner loops, without the interpreter's lock.

The files of `tracker.kernels` that call them say what arguments are. Arrays are C-contiguous, of exactly these numbers
and shapes; the others raise TypeError or ValueError with the argument's name.
"""

from tracker.arrays import Array32, Integers, Mask

SOURCES: str
"""Digest of what it was built from, see `tracker.native_sources`."""

# movements/
def direction_gaps(queried: Array32, known: Array32, gaps: Array32) -> None: ...
def warp_sequence(
    gaps: Array32, first: Integers, repeats: Mask, slack: Integers, unknown: float, entry: float, found: Integers
) -> float: ...
