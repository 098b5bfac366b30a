"""More bodies than persons: a person in the foreground who is not in the configuration."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pydantic

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey
from tracker.images.inspection._survey import FACTOR


@component
class BodiesInspection:
    """Counts regions as high as a person in the foreground of each view.

    Persons before one another are one region, so a view shows at most as many as there are: at least two views must
    show too many, in most frames.
    """

    share: float = pydantic.Field(default=0.55, gt=0, lt=1)
    """Share of the height of a person standing there, from which on a region counts as a body."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
        found, expected = n_bodies(seen, self.share), len(seen.scene.persons)
        if found > expected:
            yield (
                f"{found} bodies are in the foreground of most of the first frames, {expected} "
                f"{'person is' if expected == 1 else 'persons are'} configured, who get the bodies that fit best; "
                "the others count as things that hide them. Add them to [[persons]] to separate them by statures"
            )


def n_bodies(seen: Survey, share: float = 0.55) -> int:
    """Number of bodies that two views show in the usual frame; 0 if unknown.

    Args:
        seen: the first frames.
        share: as in `BodiesInspection`.
    """
    stature = min((person.body.stature_m for person in seen.scene.persons), default=0.0)
    views = [v for v in range(len(seen.rig)) if seen.stands_out(v)]
    if stature <= 0 or len(views) < 2:
        return 0
    centres, _ = seen.rig.triangulate(seen.middles)
    counts = [
        sorted(_high_enough(masks[v], seen.rig.cameras[v], centre, share * stature) for v in views)[-2]
        for masks, centre in zip(seen.foregrounds, centres, strict=True)
        if np.isfinite(centre).all()
    ]
    return int(np.median(counts)) if counts else 0


def _high_enough(mask: Mask | None, camera: Camera, centre: Array, least_m: float) -> int:
    """Regions of a small foreground that are so high at a place."""
    if mask is None:
        return 0
    depth = float(camera.camera_from_world[2] @ np.append(centre, 1.0))
    least = camera.matrix[1, 1] * least_m / max(depth, 0.1) / FACTOR
    heights = cv2.connectedComponentsWithStats(mask.astype(np.uint8))[2][1:, cv2.CC_STAT_HEIGHT]
    return int((heights > least).sum())
