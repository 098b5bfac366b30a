"""Views out of step: what one view shows, the others show earlier or later."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.arrays import Array
from tracker.components import component
from tracker.inspection import Survey

# A view in which the border of the image cuts somebody off as often as this always shows the same of him; else it is
# one that he enters or leaves: walking out of four views a man seemed 7 frames late in one of them.
_ALWAYS_CUT = 0.9
# Frames that have to show somebody whatever a view is tried to be late by.
_LEAST_FRAMES = 15
# Frames that a view is tried to be early or late by; at the ends of the range a minimum may be none.
_SEARCHED, _MOST_FRAMES = 15, 12


@component
class TimingInspection:
    """The middles of the foregrounds move alike in all views, at the same time.

    One view of ten recordings was shifted by 2, 4 and 8 frames: with plates, 4 and more are found in eight of nine
    (median distances 1.3 to 2.1 times those in step, in step at most 1.1 times those of any other time), without plates
    most of 8. Who stands still tells nothing.
    """

    better: float = pydantic.Field(default=1.3, gt=0)
    """Factor by which the distances have to be smaller at another time."""

    least_share: float = pydantic.Field(default=0.0015, gt=0, lt=1)
    """And by how much, as a share of the image width."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.inspection.Inspection.findings`."""
        if seen.middles.shape[1] < 3 * _SEARCHED:
            return
        better, least = self.better, self.least_share
        if not all(map(seen.stands_out, range(len(seen.rig)))):
            better, least = 0.5 * (better + 1.5), 3 * least
        found = max((self._late(seen, v) for v in range(len(seen.rig))), key=lambda one: one[2] / max(one[3], 1e-9))
        v, late, now, then = found
        width = seen.rig.cameras[v].size[0]
        if late and abs(late) <= _MOST_FRAMES and now > better * then and now - then > least * width:
            name, images = seen.rig.names[v], late * seen.stride
            yield (
                f'view "{name}" looks {abs(images)} image{"s" * (abs(images) > 1)} {"late" if late > 0 else "early"} '
                f"against the others: try offsets = {{ {name} = {images} }} in [reading], added to what stands there"
            )

    def _late(self, seen: Survey, v: int) -> tuple[int, int, float, float]:
        """A view, by how many frames it is late, and usual distances now and with that made good, px."""
        usual = [_usual(seen, v, late) for late in range(-_SEARCHED, _SEARCHED + 1)]
        if not np.isfinite(usual).all():
            return v, 0, 0.0, 0.0
        best = int(np.argmin(usual))
        return v, best - _SEARCHED, usual[_SEARCHED], usual[best]


def _usual(seen: Survey, v: int, late: int) -> float:
    """Usual distance by which rays miss, less what they always do, with one view taken later, px."""
    middles: Array = np.array(seen.middles)
    middles[seen.cut & (seen.cut.mean(axis=1, keepdims=True) < _ALWAYS_CUT)] = np.nan
    middles[v] = np.roll(middles[v], -late, axis=0)
    middles = middles[:, _SEARCHED:-_SEARCHED]
    points, _ = seen.rig.triangulate(middles)
    gaps = seen.rig.project(points) - middles
    if np.isfinite(gaps[v, :, 0]).sum() < _LEAST_FRAMES:
        return float("nan")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="All-NaN slice encountered")  # a view that shows nothing
        gaps = gaps - np.nanmedian(gaps, axis=1, keepdims=True)
    return float(np.nanmedian(np.linalg.norm(gaps, axis=-1)))
