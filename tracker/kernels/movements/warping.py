"""Dynamic time warping of a recording onto the movements of a library, in one pass."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array32, Integers, Mask
from tracker.kernels.compilation import compiled


@compiled
def direction_gaps(queried: Array32, known: Array32, gaps: Array32) -> None:
    """How far limbs point in different directions: root mean square angle between every two frames.

    Args:
        queried: (T, L, 3) unit directions of L limbs.
        known: (N, L, 3) the same of the frames of a library.
        gaps: (T, N) receives degrees.
    """
    n_limbs = queried.shape[1]
    for t in range(len(queried)):
        for n in range(len(known)):
            total = 0.0
            for k in range(n_limbs):
                x = float(queried[t, k, 0]) - float(known[n, k, 0])
                y = float(queried[t, k, 1]) - float(known[n, k, 1])
                z = float(queried[t, k, 2]) - float(known[n, k, 2])
                # by the chord, which is exact near zero where an arc cosine is not
                angle = 2.0 * np.arcsin(min(1.0, 0.5 * np.sqrt(x * x + y * y + z * z)))
                total += angle * angle
            gaps[t, n] = np.degrees(np.sqrt(total / n_limbs))


@compiled
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
    n_frames, n_known = gaps.shape
    best = np.full(n_frames + 1, np.inf)
    best[0] = 0.0
    # met for the first time, and for the second time
    moved, held = np.full(n_known, np.inf), np.full(n_known, np.inf)
    moved_from, held_from = np.zeros(n_known, dtype=np.int64), np.zeros(n_known, dtype=np.int64)
    moved_way, held_way = np.zeros(n_known, dtype=np.int64), np.zeros(n_known, dtype=np.int64)
    before, before_from = np.full(n_known, np.inf), np.zeros(n_known, dtype=np.int64)
    before_way = np.zeros(n_known, dtype=np.int64)
    found[0, 0], found[0, 1], found[0, 2] = -2, 0, 0
    for t in range(n_frames):
        for n in range(n_known):
            # the cheaper way to have come here a frame ago
            if moved[n] <= held[n]:
                before[n], before_from[n], before_way[n] = moved[n], moved_from[n], moved_way[n]
            else:
                before[n], before_from[n], before_way[n] = held[n], held_from[n], held_way[n]
            held[n], held_from[n], held_way[n] = moved[n] + gaps[t, n], moved_from[n], moved_way[n]
        told = found[t + 1]
        best[t + 1] = best[t] + unknown
        told[0], told[1], told[2] = -1 if np.isfinite(best[t + 1]) else -2, t, 0
        for k in range(len(first) - 1):
            low, length = first[k], first[k + 1] - first[k]
            for j in range(length):
                n = low + j
                cost, start, way = np.inf, t, 1
                if repeats[k] or j <= slack[k]:
                    cost = best[t] + entry
                for step in (1, 2):
                    i = j - step
                    if i < 0:
                        if not repeats[k]:
                            continue
                        i %= length
                    if before[low + i] < cost:
                        cost, start, way = before[low + i], before_from[low + i], before_way[low + i] + step
                moved[n], moved_from[n], moved_way[n] = cost + gaps[t, n], start, way
                if not repeats[k] and j < length - 1 - slack[k]:
                    continue
                least = slack[k] if repeats[k] else 0
                if moved[n] < best[t + 1] and t + 1 - start >= least:
                    best[t + 1], told[0], told[1], told[2] = moved[n], k, start, way
                if held[n] < best[t + 1] and t + 1 - held_from[n] >= least:
                    best[t + 1], told[0], told[1], told[2] = held[n], k, held_from[n], held_way[n]
    return float(best[n_frames])
