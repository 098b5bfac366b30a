"""The region of an image that a mesh covers."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Integers, Mask


def fill_mesh(points: Array, faces: Integers, camera: Array, mask: Mask) -> None:
    """Sets the pixels whose centres triangles cover, from whichever side they are seen.

    Args:
        points: (N, 3) vertices, world, metres.
        faces: (T, 3) vertex numbers.
        camera: (29,) row of `Rig.packed`.
        mask: (h, w) in and out; triangles that are not wholly before the camera are left out.
    """
    native.fill_mesh(points, faces, camera, mask)
