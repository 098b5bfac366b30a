"""Views out of step: what one view shows, the others show earlier or later."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey

# A view in which the border of the image cuts somebody off as often as this always shows the same of him; else it is
# one that he enters or leaves: walking out of four views a man seemed 7 frames late in one of them.
_ALWAYS_CUT = 0.9
# Frames of each half that have to show somebody in two views, whatever one is tried to be late by.
_LEAST_FRAMES = 8
# Frames that a view is tried to be early or late by; at the ends of the range a minimum may be none.
_SEARCHED, _MOST_FRAMES = 15, 12
# Views below which two of them tell the same of either: two opposite ones tell nothing of a walk along their line.
_LEAST_VIEWS = 3
# Frames by which halves may tell another delay than the whole: of none of 148 threes and fours of views in step, of
# which ten seem late as a whole, both do so.
_ALIKE_FRAMES = 3
# By what factor distances have to be larger at any other time, so many frames off, and with any other view late.
_BETTER_THAN_OTHERS, _OTHER_FRAMES = 1.05, 4


@component
class TimingInspection:
    """The middles of the foregrounds move alike in all views, at the same time.

    It is told where both halves of the frames tell the same, and no other time or view would do as well. Of 148 threes
    and fours of views of eleven recordings in step, with plates and without, none is told to be late; by distances of
    the whole alone nine were, by up to 12 frames. Two views never tell: of who walks along
    their line they show the same at any time.
    """

    better: float = pydantic.Field(default=1.3, gt=0)
    """Factor by which the distances have to be smaller at another time; by 0.1 more where a view has no plate."""

    least_share: float = pydantic.Field(default=0.0007, gt=0, lt=1)
    """And by how much, as a share of the image width."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
        if len(seen.rig) < _LEAST_VIEWS or seen.middles.shape[1] < 3 * _SEARCHED:
            return
        plain = not all(map(seen.stands_out, range(len(seen.rig))))
        width = seen.rig.cameras[0].size[0]
        found = _surely_late(_pair_costs(seen), self.better + 0.1 * plain, self.least_share * width)
        if found is not None:
            v, late = found
            name, images = seen.rig.names[v], late * seen.stride
            yield (
                f'view "{name}" looks {abs(images)} image{"s" * (abs(images) > 1)} {"late" if late > 0 else "early"} '
                f"against the others: try offsets = {{ {name} = {images} }} in [reading], added to what stands there"
            )


def _surely_late(pairs: Array, better: float, least_px: float) -> tuple[int, int] | None:
    """The view that is late beyond doubt, and by how many frames; None for none.

    Args:
        pairs: (V, V, D, 3) see `_pair_costs`.
        better: factor by which distances have to be smaller then.
        least_px: and by how much.
    """
    now, others = pairs[..., _SEARCHED, :], ~np.eye(len(pairs), dtype=np.bool_)
    if not np.isfinite(pairs[others]).all():
        return None
    pairs = np.where(others[..., None, None], pairs, 0.0)
    usual = 0.5 * now[others].sum(axis=0)
    # (V, D, 3): with a view at another time, and the others as they are
    costs = usual + pairs.sum(axis=1) - np.where(others[..., None], now, 0.0).sum(axis=1)[:, None]
    v, best = np.unravel_index(np.argmin(costs[..., 0]), costs.shape[:2])
    late, least, n_pairs = int(best) - _SEARCHED, costs[v, best, 0], others.sum() // 2
    if late == 0 or abs(late) > _MOST_FRAMES:
        return None
    if usual[0] <= better * least or usual[0] - least <= least_px * n_pairs:
        return None
    if (np.abs(np.argmin(costs[v, :, 1:], axis=0) - best) > _ALIKE_FRAMES).any():
        return None
    elsewhen = np.abs(np.arange(costs.shape[1]) - best) >= _OTHER_FRAMES
    rivals = [costs[v, elsewhen, 0].min(), np.delete(costs[..., 0], v, axis=0).min()]
    return None if min(rivals) < _BETTER_THAN_OTHERS * least else (int(v), late)


def _pair_costs(seen: Survey) -> Array:
    """Usual distances by which rays of two views miss, less what they always do, with the first one taken later, px.

    Returns:
        (V, V, D, 3) for each delay that is tried: of all frames, of the first half and of the second one; NaN of too
        few frames, and of a view and itself.
    """
    middles: Array = np.array(seen.middles)
    middles[seen.cut & (seen.cut.mean(axis=1, keepdims=True) < _ALWAYS_CUT)] = np.nan
    n_views, n_frames = middles.shape[:2]
    delays, at = np.arange(-_SEARCHED, _SEARCHED + 1), np.arange(_SEARCHED, n_frames - _SEARCHED)
    costs = np.full((n_views, n_views, len(delays), 3), np.nan)
    for one, other in itertools.combinations(range(n_views), 2):
        shown = np.stack(
            [middles[one][at + delays[:, None]], np.broadcast_to(middles[other][at], (len(delays), len(at), 2))]
        )
        pair = seen.rig.select((seen.rig.names[one], seen.rig.names[other]))
        flat = shown.reshape(2, -1, 2)
        gaps = (pair.project(pair.triangulate(flat)[0]) - flat).reshape(shown.shape)
        costs[one, other] = _usual(gaps)
        costs[other, one] = costs[one, other, ::-1]
    return costs


def _usual(gaps: Array) -> Array:
    """(D, 3) medians of distances (2, D, T, 2), less their own medians: of all frames and of both halves."""
    half = gaps.shape[2] // 2
    usual = []
    for part in (gaps, gaps[:, :, :half], gaps[:, :, half:]):
        n_known = np.isfinite(part[0, ..., 0]).sum(axis=-1)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="All-NaN slice encountered")  # a view that shows nothing
            left = part - np.nanmedian(part, axis=2, keepdims=True)
            distances = np.nanmedian(np.linalg.norm(left, axis=-1), axis=(0, 2))
        usual.append(np.where(n_known < _LEAST_FRAMES, np.nan, distances))
    return np.stack(usual, axis=-1)
