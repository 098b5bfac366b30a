"""Contour samples from pictures of part numbers and depths.

A pixel lies on its part's contour if one of its four neighbours shows the background or something farther away. In a
round window about it, what shows the part is inside and what lies farther away is outside; whatever is nearer hides
both and counts for neither. The centres of both sides give the normal, the share of the inside gives the distance of
the contour from the pixel's centre. `tracker/synthesis/_shaders/edges.glsl` is this file for a graphics card.
"""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask


def id_contours(
    ids: Integers,
    depths: Array32,
    frame: tuple[int, int, int, int],
    camera: Array,
    solids: Array,
    contact_m: float,
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
) -> int:
    """Contour samples, one for each pixel on a part's contour.

    Args:
        ids: (h, w) scene-wide part number, -1 for the background.
        depths: (h, w) metres, where there is a part.
        frame: x, y of the picture's first pixel in the image, width and height of the image, px. The image shows
            nothing but background around the picture.
        camera: (29,) row of `Rig.packed`.
        solids: (P, 17) motion (3x4) from the world into the part's frame in units of its half extents, tapers,
            exponents 2/e2, e2/e1 and 2/e1.
        contact_m: distance at which parts touch, metres.
        positions, points, parts, between: outputs for M samples, laid out as in `Contours`.

    Returns:
        Samples found; those beyond M are not written.
    """
    samples = positions, points, parts, between
    return native.id_contours(ids, depths, frame, camera, solids, contact_m, *samples)
