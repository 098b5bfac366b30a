"""How high persons are shown, as the cameras alone tell, and how much smaller or larger images should be for that."""

from __future__ import annotations

import numpy as np

from tracker.cameras.rig import Rig

# See docs/lab/filmed_otherwise.md.
KEPT_PX = 300.0
"""Height that persons keep in images that are averaged, px. How far is looked for edges, and what counts as off, is set
in pixels, chosen on images that show them some 270 px high. A rendered jump of a woman shown at least 620 px high was
tracked 26 mm off (16 with offsets removed), and 14 (6) at half the size, in a seventh of the time."""

SMALL_PX = 200.0
"""Images are enlarged twice where persons are less high. 140 px high a dance and getting up were tracked 25 mm (19) and
26 mm (21) off, with a joint off in 16 of 140 frames; the same images enlarged: 18 (11), 19 (12), and none."""

_MOST_ENLARGED = 4e6
"""Pixels that enlarged images may have: time and memory grow with them."""

_LEAST_SIDE_PX = 480
"""Shorter side that images keep: cameras close by show parts of persons."""

_STATURE_M = 1.7
"""Of somebody: who will be filmed is not known yet, and a child's images are averaged no further."""


def shown_px(rig: Rig) -> float:
    """Height of a person who stands upright where the axes of the cameras meet, in the view that shows it smallest.

    Args:
        rig: the cameras; views that have the place behind them have no say.

    Returns:
        px; 0 where no view has it before it.
    """
    depths = np.array([camera.in_camera(rig.middle)[2] for camera in rig.cameras])
    focal_px = np.array([camera.matrix[1, 1] for camera in rig.cameras])
    before = depths > 0
    return float((_STATURE_M * focal_px[before] / depths[before]).min()) if before.any() else 0.0


def fitting_downscale(rig: Rig) -> float:
    """Pixels in both directions that one may average for tracking persons; 1 for as recorded, 0.5 for twice as large.

    Args:
        rig: the cameras of the images as recorded.
    """
    largest = max(camera.size[0] * camera.size[1] for camera in rig.cameras)
    if 0 < shown_px(rig) < SMALL_PX and 4 * largest <= _MOST_ENLARGED:
        return 0.5
    shorter_px = min(min(camera.size) for camera in rig.cameras)
    return max(1, int(min(shown_px(rig) / KEPT_PX, shorter_px / _LEAST_SIDE_PX)))
