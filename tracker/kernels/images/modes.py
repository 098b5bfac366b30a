"""What most pictures of a pile show, pixel by pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import tracker._native as native
from tracker.foundation.arrays import Image


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
    native.dominant_modes(pile, reach, plate, counts, rivals)
