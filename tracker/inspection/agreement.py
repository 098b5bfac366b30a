"""Foregrounds that do not meet in space: videos exchanged, an image mirrored, or the rig of another recording."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.arrays import Array
from tracker.components import component
from tracker.inspection import Survey
from tracker.inspection._rays import misses, usual_share

# Frames in which something has to be seen before anything is told.
_LEAST_FRAMES = 10


@component
class AgreementInspection:
    """Rays to the middles of the foregrounds should meet, and do with the videos as they are given.

    In nine recordings before plates they miss by 0.004 to 0.011 of the width, by 0.017 with two persons; exchanged or
    mirrored, most miss by 0.03 to 0.11. Somebody in the very middle of the rig may be seen by exchanged
    cameras too: nothing is said then, nor of several persons where a view has no plate: who moves there and who does
    elsewhere need not be the same.
    """

    most_share: float = pydantic.Field(default=0.03, gt=0, lt=1)
    """Usual distance by which rays may miss, as a share of the image width, before a view with plates is doubted."""

    better: float = pydantic.Field(default=2.5, gt=0)
    """Factor by which another order or a mirrored view has to be better to be proposed."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.inspection.Inspection.findings`."""
        if len(seen.scene.persons) > 1 and not all(map(seen.stands_out, range(len(seen.rig)))):
            return
        together = np.isfinite(seen.middles[..., 0]).sum(axis=0) >= 2
        if together.sum() < _LEAST_FRAMES:
            return
        share = usual_share(seen.rig, misses(seen.rig, seen.middles))
        if not share > self.most_share:
            return
        tried = {told: usual_share(seen.rig, misses(seen.rig, middles)) for told, middles in _others(seen)}
        told = min(tried, key=lambda one: tried[one], default="")
        if told and tried[told] * self.better < share and tried[told] < self.most_share:
            yield f"{told}: rays to the foregrounds miss by {share:.1%} of the width as given, {tried[told]:.1%} so"
        elif sum(map(seen.stands_out, range(len(seen.rig)))) >= 2:
            yield (
                f"the foregrounds of the views do not meet in space: rays to them miss by {share:.1%} of the image "
                f"width, expected {self.most_share:.1%} at most; is it the rig of this recording, with its units "
                "and its views in the right order?"
            )


def _others(seen: Survey) -> Iterator[tuple[str, Array]]:
    """What may have been meant, and the middles (V, T, 2) then."""
    names, middles = seen.rig.names, seen.middles
    for a, b in itertools.combinations(range(len(names)), 2):
        if seen.rig.cameras[a].size == seen.rig.cameras[b].size:
            exchanged = np.array(middles)
            exchanged[[a, b]] = exchanged[[b, a]]
            yield f'the videos of "{names[a]}" and "{names[b]}" look exchanged', exchanged
    for v, name in enumerate(names):
        yield f'the images of "{name}" look mirrored, left for right', _mirrored(seen, [v])
    yield "all images look mirrored, left for right", _mirrored(seen, list(range(len(names))))
    if len(names) > 2:
        for v, name in enumerate(names):
            without = np.array(middles)
            without[v] = np.nan
            yield f'view "{name}" does not fit the others: a wrong calibration, or another video', without


def _mirrored(seen: Survey, views: list[int]) -> Array:
    middles = np.array(seen.middles)
    for v in views:
        middles[v, :, 0] = seen.rig.cameras[v].size[0] - 1 - middles[v, :, 0]
    return middles
