"""How well the rays of one thing, seen in several views, meet."""

from __future__ import annotations

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array


def misses(rig: Rig, pixels: Array) -> Array:
    """Distances (V, T) of images from where the point that all views agree on most is seen, px.

    Args:
        rig: V cameras.
        pixels: (V, T, 2), NaN where a view does not show the point.

    Returns:
        NaN for such views; infinite where rays meet behind a camera.
    """
    points, _ = rig.triangulate(pixels)
    gaps = np.linalg.norm(rig.project(points) - pixels, axis=-1)
    lonely = np.isfinite(pixels[..., 0]).sum(axis=0) < 2
    told: Array = np.where(np.isfinite(pixels[..., 0]) & ~lonely, np.where(np.isfinite(gaps), gaps, np.inf), np.nan)
    return told


def usual_share(rig: Rig, gaps: Array) -> float:
    """The median of distances (V, T) as a share of the width of their images; NaN where nothing is known."""
    shares = gaps / np.array([camera.size[0] for camera in rig.cameras])[:, None]
    known = shares[~np.isnan(shares)]
    return float(np.median(known)) if len(known) else float("nan")
