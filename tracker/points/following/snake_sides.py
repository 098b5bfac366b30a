"""Whether the sides of a contour look as they did where it began: what tells its edge from others beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.foundation.arrays import Array, Array32, Mask
from tracker.points.following.snakes import Sides

# A side is what lies so far from an edge, px: beyond its blur, within a finger.
_NEAR_PX, FAR_PX = 2, 5
# Of the way from how one side looked to how the other one did: from here on it is rather something else.
HALF_WAY = 0.5
# Nodes on either side that a node may have slid along the contour: it is held across it alone.
_SLID = 4
# Contrasts below this are noise, grey levels.
_LEAST_GREY = 8.0


def sides_of(across: Array32) -> Array:
    """(N, K, 2, C) means to the left and the right of each of K columns, of grey values (N, K + 2 FAR_PX, C)."""
    width = across.shape[1] - 2 * FAR_PX

    def mean(first: int, last: int) -> Array:
        return np.asarray(np.mean([across[:, k : k + width] for k in range(first, last + 1)], axis=0))

    return np.stack([mean(FAR_PX + _NEAR_PX, 2 * FAR_PX), mean(0, FAR_PX - _NEAR_PX)], axis=2)


def gaps_to_first(sides: Sides | None, looks: Array) -> Array:
    """(N, K, 2) how far the sides (N, K, 2, C) are from how they looked: 0 alike, 1 as the other side did."""
    if sides is None:
        return np.zeros(looks.shape[:3])
    first, n = sides.first, len(looks)
    contrasts = _distance(first[:, 0], first[:, 1])
    contrasts = np.fmax(contrasts, np.fmax(np.nanmedian(contrasts), _LEAST_GREY))
    gaps = np.full(looks.shape[:3], np.inf)
    for slid in range(-_SLID, _SLID + 1):
        known = first[np.clip(np.arange(n) + slid, 0, n - 1)]
        gaps = np.fmin(gaps, _distance(looks - sides.light, known[:, None]))
    return np.asarray(gaps / contrasts[:, None, None])


def own_share(sides: Sides | None, gaps: Array) -> Array:
    """(N, K) how far an edge counts whose sides are (N, K, 2) from how they looked: by its limb."""
    own = gaps if sides is None else gaps[..., list(sides.limb)]
    share: Array = np.clip((1 - own.min(axis=-1)) / (1 - HALF_WAY), 0.0, 1.0)
    return share


def lit(sides: Sides | None, looks: Array, alike: Mask) -> Sides | None:
    """Sides in the light of a frame in which they look so (N, 2, C), some of them (N, 2) as in the first frame."""
    if sides is None:
        return None
    own = alike & np.isin((0, 1), sides.limb) & np.isfinite(sides.first).all(axis=-1)
    return replace(sides, light=np.nanmedian((looks - sides.first)[own], axis=0)) if own.any() else sides


def _distance(one: Array, other: Array) -> Array:
    """Root mean square difference of grey values or colours (..., C)."""
    return np.asarray(np.sqrt(np.mean((one - other) ** 2, axis=-1)))
