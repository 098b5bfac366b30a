"""The world of the rig: metres, z up, the floor at 0."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.cameras.rig import world_doubts
from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey


@component
class UprightInspection:
    """Cameras are held upright, stand above the floor and some metres apart, nearly always."""

    most_m: float = pydantic.Field(default=200.0, gt=0)
    """Cameras farther apart than these metres are taken for a calibration in millimetres or centimetres."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
        yield from world_doubts(seen.rig)
        centres = np.array([camera.centre for camera in seen.rig.cameras])
        apart = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
        if apart > self.most_m:
            yield f"the cameras stand {apart:,.0f} m from their middle: a calibration in millimetres? expected metres"
