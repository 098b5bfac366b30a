"""Coarse depth pictures of meshes: what is in front, so that contours behind it are dropped."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array32


def see_vertices(points: Array32, normals: Array32, camera: Array32, seen: Array32, facing: Array32) -> None:
    """Where vertices are seen, and whether the surface faces the camera there.

    In single precision; the twin is `project_point`.

    Args:
        points, normals: (N, 3) from `pose_mesh`.
        camera: (29,) row of `Rig.packed`, single precision.
        seen: (N, 3) output: pixel and inverse depth, 1 / m, 0 behind the camera and beyond its reach.
        facing: (N,) output: product of the normal and the way to the camera, positive where it faces it.
    """
    native.see_vertices(points, normals, camera, seen, facing)
