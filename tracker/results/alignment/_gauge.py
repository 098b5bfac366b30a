"""What of the turns of cameras a motion of everything they see would do as well."""

from __future__ import annotations

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array


def without_common_motion(rig: Rig, turns: Array, middle: Array) -> Array:
    """Turns less those that moving the world would explain: only the rest contradicts the calibration.

    Args:
        rig: V cameras.
        turns: (V, 3) rotation vectors in camera coordinates, rad.
        middle: (3,) of what is seen, metres.

    Returns:
        (V, 3) rad.
    """
    columns = np.concatenate([_as_turns(camera.camera_from_world, middle) for camera in rig.cameras])
    moved, *_ = np.linalg.lstsq(columns, turns.ravel(), rcond=None)
    left: Array = (turns.ravel() - columns @ moved).reshape(turns.shape)
    return left


def _as_turns(camera_from_world: Array, middle: Array) -> Array:
    """(3, 6) turns of a camera that show what a small translation (m) and rotation (rad) about the middle would."""
    rotation = camera_from_world[:3, :3]
    distance = float(rotation[2] @ middle + camera_from_world[2, 3])
    # a point moved by (dx, dy) at its distance is seen as by a camera turned by (-dy, dx) / distance
    across = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / max(distance, 1e-6)
    about = np.zeros((3, 3))
    about[2, 2] = 1.0
    return np.hstack([across @ rotation, about @ rotation])
