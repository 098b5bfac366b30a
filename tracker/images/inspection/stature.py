"""Stature: height of the foreground of one person, against the model."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey
from tracker.images.inspection._survey import misses

# Frames in which both ends have to be seen before anything is told.
_LEAST_FRAMES = 10


@component
class StatureInspection:
    """The foreground of a person reaches from the floor to the head, or to raised hands.

    Each view's lowest point is the foot that is nearer to it, so that heights come out 5 to 10 % too large: 1.85 to 2.0
    m for standing and walking persons of 1.75 to 1.8 m, 2.2 m with an arm raised. Only large differences are reported.
    """

    least: float = pydantic.Field(default=0.75, gt=0, lt=1)
    """Share of the stature that some frame should reach."""

    most: float = pydantic.Field(default=1.4, gt=0)
    """Share of the stature that no usual frame exceeds."""

    agree: float = pydantic.Field(default=0.03, gt=0, lt=1)
    """Share of the image width within which the views have to agree on both ends."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
        if len(seen.scene.persons) != 1 or not all(map(seen.stands_out, range(len(seen.rig)))):
            return
        widths = np.array([camera.size[0] for camera in seen.rig.cameras])[:, None]
        heights = []
        for marks in (seen.tops, seen.ends):
            gaps = misses(seen.rig, marks) / widths
            agreed = (np.isfinite(gaps).sum(axis=0) >= 2) & ~(gaps > self.agree).any(axis=0)
            points, _ = seen.rig.triangulate(marks)
            heights.append(np.where(agreed, points[:, 2], np.nan))
        found = heights[0] - heights[1]
        found = found[np.isfinite(found)]
        stature = seen.scene.persons[0].body.stature_m
        if len(found) < _LEAST_FRAMES or stature <= 0:
            return
        highest, usual = float(np.percentile(found, 95)), float(np.median(found))
        told = f"the foreground is {usual:.2f} m high in most of the first frames, the model {stature:.2f} m"
        if highest < self.least * stature:
            yield f"{told}: a smaller person (stature_m), a rig of another scale, or a person who does not stand up"
        elif usual > self.most * stature:
            yield f"{told}: a taller person (stature_m), a rig of another scale, or more than one body"
