"""Size of the images: persons who are shown larger than their model is worth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.components import component
from tracker.inspection import Survey
from tracker.shown_size import KEPT_PX

# Frames in which a view has to show a person from head to foot.
_LEAST_FRAMES = 10
# Largest `downscale` of a reading.
_MOST = 16


@component
class SizesInspection:
    """Models are some millimetres from the persons they stand for: pixels finer than that take time, and mislead.

    See `tracker.shown_size`, which goes by the cameras; here it is what the images show.
    """

    person_px: float = pydantic.Field(default=KEPT_PX, gt=0)
    """Height that persons keep in the images when these are averaged, px."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.inspection.Inspection.findings`."""
        heights = seen.ends[..., 1] - seen.tops[..., 1]
        shown = np.isfinite(heights)
        if (shown.sum(axis=1) < _LEAST_FRAMES).any():
            return
        smallest = min(float(np.median(own[there])) for own, there in zip(heights, shown, strict=True))
        factor = min(int(smallest / self.person_px), _MOST)
        if factor > 1:
            (width, height), averaged = seen.rig.cameras[0].size, seen.rig.cameras[0].downscale
            better = min(max(int(factor * averaged), 1), _MOST)
            yield (
                f"images are {width} x {height} px, persons at least {smallest:.0f} px high in them: "
                f"reading.downscale = {better} tracks them at least as exactly, and sooner"
            )
