"""What pixels look like, from their colours and the slopes around them; see `tracker.imaging.appearance`."""

from __future__ import annotations

from tracker.arrays import Image
from tracker.kernels.compilation import compiled


@compiled
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
    chroma, steps, classes = tables
    red, blue, added = weights
    for row in range(looks.shape[0]):
        y = corner[1] + row
        for column in range(looks.shape[1]):
            x = corner[0] + column
            looks[row, column, 0] = colours[y, x, 0]
            looks[row, column, 1] = chroma[red * colours[y, x, 1] + blue * colours[y, x, 2] + added]
            looks[row, column, 2] = classes[4 * steps[across[y, x]] + steps[along[y, x]]]
