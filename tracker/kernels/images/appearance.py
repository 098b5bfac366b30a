"""What pixels look like, from their colours and the slopes around them; see `tracker.images.operations.appearance`."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Image


def mark_appearance(
    colours: Image,
    across: Image,
    along: Image,
    corner: tuple[int, int],
    weights: tuple[int, int, int],
    tables: tuple[Image, Image, Image],
    looks: Image,
) -> None:
    """Lightness, chroma and the class of texture of every pixel of a region.

    Args:
        colours: (H, W, 3) lightness, Cr and Cb of a part of an image.
        across, along: (H, W) slopes.
        corner: pixel (x, y) of the region's upper left corner in these.
        weights: of Cr and of Cb in the place looked up for chroma, and what is added to it, so that none is below 0.
        tables: chroma (K,); steps of a slope (256,), 0 to 3; classes (16,) of four times a step across plus one along.
        looks: (h, w, 3) output.
    """
    native.mark_appearance(colours, across, along, corner, weights, *tables, looks)
