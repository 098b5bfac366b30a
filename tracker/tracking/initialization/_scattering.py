"""A search around many poses at once: they are scattered, the best of them scattered less, and so on.

The annealed particle filter of Deutscher, Blake and Reid (Articulated body motion capture by annealed particle
filtering, CVPR 2000) in one frame. A kept pose has to differ from all better ones, or one of them would soon be alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array
from tracker.tracking.hypotheses import different


class Round(NamedTuple):
    """One round of scattering."""

    kept: int
    """Poses that are scattered, the best ones."""

    each: int
    """Poses that each becomes."""

    share: float
    """Of the first round's scatter."""

    apart_m: float
    """Mean distance of the landmarks of two kept poses, at least, metres."""


ROUNDS = (
    Round(120, 24, 1.0, 0.2),
    Round(80, 24, 0.7, 0.15),
    Round(40, 30, 0.5, 0.1),
    Round(30, 40, 0.35, 0.1),
    Round(20, 40, 0.25, 0.1),
)
"""Some 8000 poses, a quarter of those on the floor. Of a simulated person face down the best score on edges rose from
0.13 to 0.22, before a refinement; that of the true pose is 0.31."""

# Standard deviations of the first round: of joints as far apart as stances are, of the root half a step of the floor
# and of the turns.
_JOINT_RAD, _TURN_RAD, _SHIFT_M = np.radians(35.0), np.radians(14.0), 0.12
# Every parameter is left alone in so many poses: all of them wrong at once is what scattering seldom cures.
_MOVED = 0.5


def scattered(body: BodyModel, poses: Array, score: Callable[[Array], Array], rounds: tuple[Round, ...]) -> Array:
    """What a search around poses finds; the same whenever it is called.

    Args:
        body: whose joint limits hold.
        poses: (N, dof) to begin with, the best first.
        score: of poses (B, dof) the more the better (B,).
        rounds: of the search; none leaves the poses as they are.

    Returns:
        (M, dof) poses, the best first.
    """
    rng = np.random.default_rng(0)
    spread = np.where(body.rotates, _JOINT_RAD, _SHIFT_M)
    root = body.root.columns
    spread[root[body.rotates[root]]] = _TURN_RAD
    for one in rounds:
        kept = np.array(different(body, poses, one.kept, one.apart_m))
        tried = np.repeat(kept, one.each, axis=0)
        moved = rng.random(tried.shape) < _MOVED
        tried += one.share * spread * rng.standard_normal(tried.shape) * moved
        poses = np.concatenate([kept, body.clamped(tried)])
        poses = poses[np.argsort(-score(poses), kind="stable")]
    return poses
