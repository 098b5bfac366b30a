"""Foregrounds that do not meet in space: exchanged videos, a mirrored image, or the rig of another recording."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey
from tracker.images.inspection._survey import FACTOR, misses, usual_share
from tracker.images.inspection.bodies import n_bodies

# Frames in which something has to be seen before anything is told.
_LEAST_FRAMES = 10


@component
class AgreementInspection:
    """Rays to the middles of the foregrounds should meet, if the videos are right.

    In nine recordings before plates they miss by 0.004 to 0.011 of the width, by 0.017 with two persons; exchanged or
    mirrored, most miss by 0.03 to 0.11. A person in the very middle of the rig may be seen by exchanged
    cameras too: the check is silent then. It is also silent about several persons if a view has no plate, because
    different persons may move in different views. If there are more bodies than persons, middles are of all of them.
    """

    most_share: float = pydantic.Field(default=0.03, gt=0, lt=1)
    """Usual distance by which rays may miss, as a share of the image width, before a view with plates is doubted."""

    beside_share: float = pydantic.Field(default=0.01, gt=0, lt=1)
    """Largest distance between a view's foreground and the point where rays meet, as a share of the image width: 0 in
    ten recordings before plates, 0.02 to 0.07 with cameras turned by 4 degrees."""

    better: float = pydantic.Field(default=2.5, gt=0)
    """Factor by which another order or a mirrored view must be better to be proposed."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
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
        elif len(seen.scene.persons) == 1 and n_bodies(seen) <= 1 and self._meet_nowhere(seen):
            yield (
                f"the foregrounds of the views do not meet in space: rays to them miss by {share:.1%} of the image "
                f"width, expected {self.most_share:.1%} at most; is it the rig of this recording, with its units "
                "and its views in the right order?"
            )

    def _meet_nowhere(self, seen: Survey) -> bool:
        """Whether views with plates are empty where their rays meet; of several persons the middle is not a place."""
        return sum(map(seen.stands_out, range(len(seen.rig)))) >= 2 and _beside(seen) > self.beside_share


def _beside(seen: Survey) -> float:
    """Distance of the points where rays meet from the foregrounds, as a share of the width, in the worst view.

    Shadows and cables move the middle of a foreground, but not the common point away from it. Views without a plate
    only show movement, often an arm alone, and do not count.
    """
    places = seen.rig.project(seen.rig.triangulate(seen.middles)[0])
    gaps = np.full(places.shape[:2], np.nan)
    for t, masks in enumerate(seen.foregrounds):
        for v, mask in enumerate(masks):
            if mask is not None and seen.stands_out(v) and np.isfinite(seen.middles[v, t]).all():
                gaps[v, t] = _gap_px(mask, places[v, t])
    usual = [usual_share(seen.rig.select((name,)), own[None]) for name, own in zip(seen.rig.names, gaps, strict=True)]
    return float(np.nanmax([*usual, 0.0]))


def _gap_px(mask: Mask, place: Array) -> float:
    """From a place (2,), px of the whole image, to the nearest pixel of a small foreground; infinite for no place."""
    if not np.isfinite(place).all():
        return float("inf")
    rows, columns = np.nonzero(mask)
    near = np.hypot(FACTOR * columns + (FACTOR - 1) / 2 - place[0], FACTOR * rows + (FACTOR - 1) / 2 - place[1])
    return float(max(near.min() - FACTOR, 0.0))


def _others(seen: Survey) -> Iterator[tuple[str, Array]]:
    """Possible intentions, with the middles (V, T, 2) in each."""
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
