"""Pictures of what it is worth to cover, made smaller, one a view, and what poses cover of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from tracker.evidence.measures.comparison import Comparison
from tracker.foundation.arrays import Array, Array32, Integers, Mask, frozen
from tracker.foundation.geometry.superquadrics import spread, surface
from tracker.kernels.contours import moving_parts
from tracker.kernels.pictures import cover_still, covered_sums
from tracker.kernels.rows import CameraRow, SuperquadricRow

# Grid of a part when it is filled: chords of 5 x 8 points lie inside, 3 % more covers the same area.
_GRID, _GROWN = (5, 8), 1.03


@dataclass(frozen=True, eq=False)
class SmallPictures:
    """Two pictures of each of V views, all views end to end."""

    factor: int
    """How many pixels of an image one of the small pictures stands for, along each side."""

    regions: Integers
    """(V, 3) start in `pictures`, width and height; width 0 where there is none."""

    pictures: Array32
    """(N, 2) what is summed of a pixel that is covered, 0 to 1."""

    _still: dict[bytes, tuple[Mask, Array]] = field(init=False, default_factory=dict, repr=False)
    """What parts that stand still cover, for the last batch of poses: the next one of a search has the same ones."""

    def covered_by(self, asked: Comparison, poses: Array) -> Array:
        """(B, V, 2) sums of the two pictures over what poses (B, dof) cover."""
        placements, shapes, cameras = asked.placements(poses), asked.scene.shapes, asked.scene.rig.packed
        grids, rows, moving = _grids(shapes.tobytes()), _small(cameras, self.factor), moving_parts(placements)
        key = b"".join((shapes.tobytes(), moving.tobytes(), placements[:1, ~moving].tobytes()))
        if key not in self._still:
            self._still.clear()
            self._still[key] = cover_still(placements, ~moving, grids, _GRID, rows, self.regions, self.pictures)
        sums: Array = covered_sums(
            placements, moving, grids, _GRID, rows, self.regions, self.pictures, self._still[key]
        )
        return sums


def _small(cameras: Array, factor: int) -> Array:
    """Rows of `Rig.packed` (V, 29) as `Rig.downscaled` makes them."""
    rows = cameras.copy()
    rows[:, [CameraRow.FX, CameraRow.FY, CameraRow.SHEAR]] /= factor
    rows[:, [CameraRow.CX, CameraRow.CY]] = (rows[:, [CameraRow.CX, CameraRow.CY]] + 0.5) / factor - 0.5
    return rows


@lru_cache(maxsize=8)
def _grids(shapes: bytes) -> Array32:
    """(P, R * C, 3) surface points of all parts, from their packed shapes."""
    grids = []
    for shape in np.frombuffer(shapes).reshape(-1, SuperquadricRow.N_COLUMNS):
        eta, omega = spread(shape, *_GRID)
        points, _ = surface(shape, eta[:, None], omega[None, :])
        grids.append(_GROWN * points.reshape(-1, 3))
    return frozen(grids, np.float32)
