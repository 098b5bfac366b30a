"""The world of the rig: metres, with z up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.components import component
from tracker.inspection import Survey

_AXES = "xyz"


@component
class UprightInspection:
    """Cameras are held upright and stand some metres apart, nearly always."""

    least: float = pydantic.Field(default=0.75, gt=0, lt=1)
    """Share of a whole vector that the mean of the cameras' up directions has, to be taken for the world's up."""

    most_m: float = pydantic.Field(default=200.0, gt=0)
    """Cameras farther apart than these metres are taken for a calibration in millimetres or centimetres."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.inspection.Inspection.findings`."""
        up = np.mean([-camera.camera_from_world[1, :3] for camera in seen.rig.cameras], axis=0)
        axis = int(np.argmax(np.abs(up)))
        if abs(up[axis]) > self.least and (axis != 2 or up[2] < 0):
            sign = "-" if up[axis] < 0 else ""
            yield (
                f"the cameras are upright with the rig's {sign}{_AXES[axis]} axis up, expected z: persons would be "
                "looked for lying; turn the calibration"
            )
        centres = np.array([camera.centre for camera in seen.rig.cameras])
        apart = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
        if apart > self.most_m:
            yield f"the cameras stand {apart:,.0f} m from their middle: a calibration in millimetres? expected metres"
