"""Size of the images: persons larger than their model deserves, or too small for tracking."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.cameras.rig import KEPT_PX, Rig, fitting_downscale
from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey

# Frames in which a view has to show a person from head to foot.
_LEAST_FRAMES = 10
# Largest `downscale` of a reading.
_MOST = 16


@component
class SizesInspection:
    """Models are some millimetres from the persons: finer pixels take time, and mislead.

    Images averaged too far by the configuration show no limbs.

    See `tracker.cameras.rig`, which uses the cameras; this check uses the images.
    """

    person_px: float = pydantic.Field(default=KEPT_PX, gt=0)
    """Height of persons in the images after averaging, px."""

    least_px: float = pydantic.Field(default=150.0, gt=0)
    """Height of persons in averaged images below which their limbs are guesses, px. Averaged to 92 px, arms of a
    rendered man were 150 to 420 mm off, and nothing was in doubt."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
        heights = seen.ends[..., 1] - seen.tops[..., 1]
        shown = np.isfinite(heights)
        if (shown.sum(axis=1) < _LEAST_FRAMES).any():
            return
        smallest = min(float(np.median(own[there])) for own, there in zip(heights, shown, strict=True))
        averaged = seen.rig.cameras[0].downscale
        factor = min(int(smallest / self.person_px), _MOST)
        if factor > 1:
            width, height = seen.rig.cameras[0].size
            better = min(max(int(factor * averaged), 1), _MOST)
            yield (
                f"images are {width} x {height} px, persons at least {smallest:.0f} px high in them: "
                f"reading.downscale = {better} tracks them at least as exactly, and sooner"
            )
        elif smallest < self.least_px and averaged > (fitting := max(_fitting_downscale(seen.rig), 1)):
            yield (
                f"reading.downscale = {averaged:g} leaves persons {smallest:.0f} px high in some view: arms and legs "
                f"may be decimetres off, with nothing in doubt; leave it out, or set it to {fitting:g}"
            )


def _fitting_downscale(rig: Rig) -> float:
    """Default averaging of the images."""
    return fitting_downscale(rig.downscaled(1 / rig.cameras[0].downscale))
