"""Two persons cannot be in one place: if two models are, one of the persons is lost."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Integers
from tracker.kernels.body import POINTS_A_PART, sum_collisions
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.estimate import Estimate

MOST_SHARED = 0.3
"""Share of two persons' points that may lie deep inside the other one. Two models that were fitted to one person have
0.47 to 0.71, the same body 5 cm beside itself 0.44 to 0.65, and 10 cm beside itself 0.07 to 0.11."""


def judged_in_space(scene: Scene, estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
    """The estimates; of two persons in one place the one who leaves over more is lost.

    Otherwise a person who walks out of the pictures while another one is there, or who has not come in yet, is found in
    the other one's contours: of two simulated persons the absent one sat inside the other one, `tracked`.

    Args:
        scene: the persons at the poses of the estimates.
        estimates: one a person.
    """
    judged = list(estimates)
    worst_last = sorted(range(len(judged)), key=lambda k: judged[k].account.left_over)
    for k, other in combinations(worst_last, 2):
        both = not judged[k].lost and not judged[other].lost
        if both and (share := shared(scene, k, other)) > MOST_SHARED:
            judged[other] = judged[other].losing(Doubt("", Because.SAME_PLACE, share, MOST_SHARED))
    return tuple(judged)


def shared(scene: Scene, k: int, other: int) -> float:
    """Share of the points on the axes of two persons' parts that lie inside the other one, by their depth.

    Args:
        scene: the persons at their poses.
        k, other: numbers of two of them.
    """
    mine, theirs = _parts(scene, k), _parts(scene, other)
    both = np.concatenate([mine, theirs])
    placements = np.ascontiguousarray(scene.world_from_parts()[:, both])
    pairs = np.array([(p, len(mine) + q) for p in range(len(mine)) for q in range(len(theirs))])
    pairs.setflags(write=False)
    shapes = scene.shapes[both]
    shapes.setflags(write=False)
    return float(sum_collisions(placements, shapes, pairs)[0]) / (POINTS_A_PART * len(both))


def _parts(scene: Scene, k: int) -> Integers:
    first = scene.first_part(k)
    return np.arange(first, first + len(scene.persons[k].body.parts))
