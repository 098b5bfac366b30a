"""Plates in colour and images that are not, or the other way round."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Image
from tracker.images.inspection._survey import Survey

# Of grey images, as their codec has rounded them, 4; of rooms in colour 14 to 151, of most 80 and more.
_GREY, _COLOUR = 8.0, 25.0


def other_colours(seen: Survey) -> str:
    """That images are grey and their plates are not, or the other way round: everything differs then; else nothing."""
    views = zip(seen.rig.names, seen.plates, seen.pictures, strict=True)
    shown = [(name, plate.picture, image) for name, plate, image in views if plate is not None and image is not None]
    grey = [name for name, plate, image in shown if _is_grey(image) and _is_coloured(plate)]
    coloured = [name for name, plate, image in shown if _is_grey(plate) and _is_coloured(image)]
    if not grey and not coloured:
        return ""
    kinds = "in colour, the images of the recording grey" if grey else "grey, the images of the recording in colour"
    return (
        f"the plates of {', '.join(grey or coloured)} are {kinds}: take plates with the cameras set as they recorded, "
        "or leave `background` out"
    )


def _is_grey(picture: Image) -> bool:
    return _most_colour(picture) < _GREY


def _is_coloured(picture: Image) -> bool:
    return _most_colour(picture) > _COLOUR


def _most_colour(picture: Image) -> float:
    """By how much the channels differ in the most colourful hundredth of a picture, grey levels."""
    return float(np.percentile(np.ptp(picture, axis=2), 99))
