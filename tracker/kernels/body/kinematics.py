"""Forward kinematics by product of exponentials, batched over poses."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Integers, Mask


def chain_transforms(poses: Array, rotates: Mask, axes: Array, points: Array, parents: Integers) -> Array:
    """Motion of the reference pose at the end of every parameter's chain.

    Args:
        poses: (B, dof) rad or m.
        rotates: (dof,) rotation or translation.
        axes: (dof, 3) unit axes in the reference pose.
        points: (dof, 3) points on the axes, metres.
        parents: (dof,) index of the preceding parameter, -1 for none; parents come first.

    Returns:
        (B, dof + 1, 4, 4); entry `dof` is the unit motion, so that index -1 means the world.
    """
    motions = np.empty((len(poses), poses.shape[1] + 1, 4, 4))
    native.chain_transforms(poses, rotates, axes, points, parents, motions)
    return motions


def twists_in_world(motions: Array, rotates: Mask, axes: Array, points: Array, parents: Integers) -> Array:
    """Spatial twists of all parameters at given poses.

    Args:
        motions: (B, dof + 1, 4, 4) from `chain_transforms`.
        rotates, axes, points, parents: as there.

    Returns:
        (B, dof, 6) linear velocity v and angular velocity w of unit speed: a point X moves by v + w x X.
    """
    twists = np.empty((len(motions), len(axes), 6))
    native.twists_in_world(motions, rotates, axes, points, parents, twists)
    return twists
