"""Forward kinematics by product of exponentials, batched over poses."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers, Mask
from tracker.kernels.compilation import compiled


@compiled
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
    n_poses, dof = poses.shape
    motions = np.zeros((n_poses, dof + 1, 4, 4))
    for b in range(n_poses):
        for k in range(4):
            motions[b, dof, k, k] = 1.0
        for i in range(dof):
            before = motions[b, parents[i]]
            own = motions[b, i]
            value = poses[b, i]
            ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
            own[3, 3] = 1.0
            if not rotates[i]:
                for r in range(3):
                    for c in range(3):
                        own[r, c] = before[r, c]
                    shift = before[r, 0] * ax + before[r, 1] * ay + before[r, 2] * az
                    own[r, 3] = before[r, 3] + value * shift
                continue
            cosine, sine = np.cos(value), np.sin(value)
            rest = 1.0 - cosine
            r00, r01, r02 = cosine + ax * ax * rest, ax * ay * rest - az * sine, ax * az * rest + ay * sine
            r10, r11, r12 = ay * ax * rest + az * sine, cosine + ay * ay * rest, ay * az * rest - ax * sine
            r20, r21, r22 = az * ax * rest - ay * sine, az * ay * rest + ax * sine, cosine + az * az * rest
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            tx = px - (r00 * px + r01 * py + r02 * pz)
            ty = py - (r10 * px + r11 * py + r12 * pz)
            tz = pz - (r20 * px + r21 * py + r22 * pz)
            for r in range(3):
                b0, b1, b2 = before[r, 0], before[r, 1], before[r, 2]
                own[r, 0] = b0 * r00 + b1 * r10 + b2 * r20
                own[r, 1] = b0 * r01 + b1 * r11 + b2 * r21
                own[r, 2] = b0 * r02 + b1 * r12 + b2 * r22
                own[r, 3] = b0 * tx + b1 * ty + b2 * tz + before[r, 3]
    return motions


@compiled
def twists_in_world(motions: Array, rotates: Mask, axes: Array, points: Array, parents: Integers) -> Array:
    """Spatial twists of all parameters at given poses.

    Args:
        motions: (B, dof + 1, 4, 4) from `chain_transforms`.
        rotates, axes, points, parents: as there.

    Returns:
        (B, dof, 6) linear velocity v and angular velocity w of unit speed: a point X moves by v + w x X.
    """
    n_poses, dof = motions.shape[0], axes.shape[0]
    twists = np.zeros((n_poses, dof, 6))
    for b in range(n_poses):
        for i in range(dof):
            before = motions[b, parents[i]]
            own = twists[b, i]
            if not rotates[i]:
                for r in range(3):
                    own[r] = before[r, 0] * axes[i, 0] + before[r, 1] * axes[i, 1] + before[r, 2] * axes[i, 2]
                continue
            place = np.empty(3)
            for r in range(3):
                own[3 + r] = before[r, 0] * axes[i, 0] + before[r, 1] * axes[i, 1] + before[r, 2] * axes[i, 2]
                place[r] = (
                    before[r, 0] * points[i, 0]
                    + before[r, 1] * points[i, 1]
                    + before[r, 2] * points[i, 2]
                    + before[r, 3]
                )
            own[0] = place[1] * own[5] - place[2] * own[4]
            own[1] = place[2] * own[3] - place[0] * own[5]
            own[2] = place[0] * own[4] - place[1] * own[3]
    return twists
