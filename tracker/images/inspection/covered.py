"""Masks that cover nearly all of an image, or show no person, and plates of another scene."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.foundation.arrays import Mask
from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey
from tracker.images.plate import MOST_LEVEL, lit_by

# Frames in which something has to be known of a view before anything is told.
_LEAST_FRAMES = 10


@component
class CoveredInspection:
    """Share of each view that masks cover in most of the frames, and difference of plates from the view.

    Persons cover 2 to 12 % of the images of `BODYTRACK_DATA`; masks in which they are black cover the rest.
    """

    most: float = pydantic.Field(default=0.7, gt=0, le=1)
    """Largest share of an image that persons cover."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
        masked = [v for v in range(len(seen.rig)) if seen.plates[v] is None and seen.stands_out(v)]
        shares = {v: float(np.median(found)) for v in masked if len(found := _shares(seen, v)) >= _LEAST_FRAMES}
        for v, share in shares.items():
            if share > self.most:
                yield (
                    f'masks of view "{seen.rig.names[v]}" cover {share:.0%} of its images: expected persons that are '
                    "white, and all else black"
                )
        if shares and not any(shares.values()):
            yield (
                f"masks of {', '.join(seen.rig.names[v] for v in shares)} show no person in most of the first frames: "
                "expected pictures in which persons are white; if no person is there yet, a later reading.start"
            )
        for name, plate, picture in zip(seen.rig.names, seen.plates, seen.pictures, strict=True):
            if plate is not None and picture is not None and (level := lit_by(picture, plate).level) > MOST_LEVEL:
                yield (
                    f'the plate of view "{name}" differs from its images by {level:.0f} grey levels all over: is it of '
                    "this camera, in colour as the images are, and not black?"
                )


def _shares(seen: Survey, v: int) -> list[float]:
    """Share of an image that the masks of a view cover, in each frame that has one."""
    masks: list[Mask | None] = [row[v] for row in seen.foregrounds]
    return [float(mask.mean()) for mask in masks if mask is not None]
