"""Warping of recorded movements in time onto a queried one, for `recognition`."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array32, Integers, Mask

# Dynamic time warping of a recording onto the movements of a library, in one pass.


def direction_gaps(queried: Array32, known: Array32, weights: Array32, gaps: Array32) -> None:
    """How far limbs point in different directions: root of the weighted mean square angle between every two frames.

    Args:
        queried: (T, L, 3) unit directions of L limbs.
        known: (N, L, 3) the same of the frames of a library.
        weights: (L,) what each limb counts, 1 in all.
        gaps: (T, N) receives degrees.
    """
    native.direction_gaps(queried, known, weights, gaps)


def warp_sequence(
    gaps: Array32, first: Integers, repeats: Mask, slack: Integers, unknown: float, entry: float, found: Integers
) -> float:
    """The cheapest way to explain a recording as performances of known movements, one after the other.

    One-pass dynamic programming for connected patterns (Ney, IEEE Trans. ASSP 32, 1984). A performance may go twice as
    fast as the known one or half as fast: a frame of it is met at most twice, and at most one left out. A movement that
    repeats may begin and end anywhere and goes round; another one is passed from its beginning to its end.

    Args:
        gaps: (T, N) cost of every frame of the recording at every frame of the library.
        first: (K + 1,) where each performance of the library begins; the last entry is N.
        repeats: (K,) whether it goes round.
        slack: (K,) of one that repeats, the frames that it must last; else those that may be left out at either end.
        unknown: cost of a frame that no movement explains; infinite where every frame must be.
        entry: cost of a new performance.
        found: (T + 1, 3) receives for every end of a performance its number, -1 for an unknown frame, -2 for none,
            the frame at which it began, and how many known frames it passed; to be followed back from T.

    Returns:
        The cost of all frames; infinite if there is no way.
    """
    return native.warp_sequence(gaps, first, repeats, slack, unknown, entry, found)
