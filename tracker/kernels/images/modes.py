"""What most pictures of a pile show, pixel by pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Image
from tracker.kernels.compilation import compiled


@compiled
def dominant_modes(pile: NDArray[np.uint8], reach: int, plate: Image, counts: Image, rivals: Image) -> None:
    """The colour that most pictures agree with, and how many do.

    A mean would mix persons into it, and a median takes one where he stands for half of the time in many colours.

    Args:
        pile: (n, h, w, 3) pictures, less than 256.
        reach: largest departure in any channel of colours that agree, grey levels.
        plate: (h, w, 3) output: mean of those that agree.
        counts: (h, w) output: their number.
        rivals: (h, w) output: number of those that agree on a colour of the others, at most.
    """
    n, height, width = pile.shape[:3]
    for y in range(height):
        for x in range(width):
            best, chosen = 0, 0
            for i in range(n):
                agree = 0
                for j in range(n):
                    agree += _near(pile, i, j, y, x, reach)
                if agree > best:
                    best, chosen = agree, i
                if 2 * best > n:
                    break
            counts[y, x] = best
            rival = 0
            for i in range(n):
                if best + rival >= n or _near(pile, chosen, i, y, x, 2 * reach):
                    continue
                agree = 0
                for j in range(n):
                    agree += _near(pile, i, j, y, x, reach)
                rival = max(rival, agree)
            rivals[y, x] = rival
            for c in range(3):
                total = 0
                for j in range(n):
                    if _near(pile, chosen, j, y, x, reach):
                        total += pile[j, y, x, c]
                plate[y, x, c] = (2 * total + best) // (2 * best)


@compiled
def _near(pile: NDArray[np.uint8], i: int, j: int, y: int, x: int, reach: int) -> bool:
    """Whether two pictures show the same colour at a pixel."""
    most = np.int64(0)
    for c in range(3):
        most = max(most, abs(np.int64(pile[i, y, x, c]) - np.int64(pile[j, y, x, c])))
    return bool(most <= reach)
