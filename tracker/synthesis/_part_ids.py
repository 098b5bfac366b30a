"""Which part each pixel shows in many poses of a person, with what stands still drawn once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Array32, Mask
from tracker.foundation.geometry.superquadric_meshes import meshes_of
from tracker.kernels.contours import moving_parts
from tracker.kernels.pictures import draw_nearest, project_surfaces
from tracker.synthesis._skins import ids_of_skins

PartIds = NDArray[np.int16]
"""(H, W) scene-wide part number seen at each pixel's centre, -1 for none."""


@dataclass(frozen=True)
class _Drawn:
    """What views show of some parts."""

    depths: tuple[Array32, ...]
    """(H, W) of each view: inverse depths, 1 / m, 0 where there is nothing."""

    ids: tuple[PartIds, ...]


def ids_of_poses(
    scene: Scene, person: int | None, poses: Array | None, n_eta: int, n_omega: int
) -> Iterator[tuple[PartIds, ...]]:
    """The nearest part at every pixel of all views, pose after pose.

    The same as `rasterized_ids`, in a third of the time where all parts move and in a fifteenth where a limb does
    (`benchmark.py starts`): sides that face the camera alone are drawn, row by row, and of a batch only what moves.
    Where somebody's own surface is known, it is rasterized pose by pose.

    Args:
        scene: persons and rig.
        person: whose poses are given; None for the scene as it is.
        poses: (B, dof) rad and metres; None for the scene as it is.
        n_eta, n_omega: latitudes and longitudes of the parts' meshes.
    """
    if scene.has_skins:
        posed = [scene] if person is None or poses is None else (scene.with_pose(person, q) for q in poses)
        yield from (tuple(view.astype(np.int16) for view in ids_of_skins(one)) for one in posed)
        return
    placements = scene.world_from_parts(person, poses)
    moving = moving_parts(placements)
    empty = _Drawn(
        tuple(np.zeros(camera.size[::-1], dtype=np.float32) for camera in scene.rig.cameras),
        tuple(np.full(camera.size[::-1], -1, dtype=np.int16) for camera in scene.rig.cameras),
    )
    still = _with_parts(empty, scene, placements[0], ~moving, (n_eta, n_omega)) if len(placements) else empty
    for placed in placements:
        yield _with_parts(still, scene, placed, moving, (n_eta, n_omega)).ids


def _with_parts(drawn: _Drawn, scene: Scene, placements: Array, wanted: Mask, grid: tuple[int, int]) -> _Drawn:
    """The same with some parts (P,), placed at (P, 4, 4), drawn as well."""
    meshes = meshes_of(scene.shapes, *grid)
    seen = np.empty((len(scene.shapes), 3, meshes.points.shape[1]))
    after = _Drawn(tuple(view.copy() for view in drawn.depths), tuple(view.copy() for view in drawn.ids))
    for row, depths, ids in zip(scene.rig.packed, after.depths, after.ids, strict=True):
        project_surfaces(placements, meshes.points, wanted, row, seen)
        draw_nearest(seen, meshes.triangles, (0, 0), depths, ids)
    return after
