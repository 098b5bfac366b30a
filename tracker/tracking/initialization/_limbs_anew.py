"""Searches for limbs of a start pose that the images do not confirm, wherever their joints allow."""

from __future__ import annotations

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Integers
from tracker.tracking.hypotheses import different
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._edge_ranking import Clues, all_refined_on_edges
from tracker.tracking.start import Hypothesis

# A limb that leaves less over is left alone: 0 to 0.08 in their place, 0.12 to 0.48 elsewhere.
_LEFT_OVER = 0.12
# How far from where it is a limb without limits is looked for, rad and m: all round, and as far as an arm reaches.
_ROUND_RAD, _REACH_M = np.pi, 1.0
# Poses of a limb that are tried, and how many of them are refined, whose landmarks differ by so much on average.
_TRIED, _REFINED, _APART_M = 1000, 3, 0.03


def limbs_anew(frame: Frame, scene: Scene, stages: Stages, clues: Clues, best: Hypothesis) -> list[Hypothesis]:
    """Estimates of a pose of the scene's last person after a search for its limbs, the worst one first.

    The search of whole poses finds the trunk; an arm that trunk and furniture hide in half of the views it leaves at
    any edges: that of a woman with her arms hanging was 0.56 m off, behind her over a table.

    Args:
        frame: the images.
        scene: the persons, the sought one last.
        stages: do the refinement.
        clues: rank the poses.
        best: the first hypothesis.

    Returns:
        All refined estimates; empty if no limb is left over.
    """
    body, found = scene.persons[-1].body, []
    # A left-over head shows that a person is turned round: a search for it compensated for a man 320 mm off, who then
    # left over less than when he faced the right way with an arm in the wrong place.
    limbs = {group: share for group, share in best.limbs_left_over.items() if group in body.limbs}
    left = sorted((group for group, share in limbs.items() if share >= _LEFT_OVER), key=lambda group: -limbs[group])
    for n, group in enumerate(left, start=1):
        stages = stages.counting(f"start: {group.replace('_', ' ')}, limb {n} of {len(left)}, pose", _REFINED)
        tried = _elsewhere(body, group, best.q)
        tried = tried[np.argsort(-clues.scores(scene, tried), kind="stable")]
        again = all_refined_on_edges(frame, scene, stages, different(body, tried, _REFINED, _APART_M))
        found += again
        best = clues.ranked(scene, [best, *again])[0]
    return found


def _elsewhere(body: BodyModel, group: str, q: Array) -> Array:
    """(N, dof) a pose (dof,) with a limb mirrored from the other one, and anywhere within its limits."""
    columns = body.group(group)
    low, high = _finite_limits(body, columns, q)
    poses = np.tile(q, (_TRIED, 1))
    poses[1:, columns] = np.random.default_rng(0).uniform(low, high, (_TRIED - 1, len(columns)))
    if other := body.partner_of(group):
        poses[0, columns] = q[body.group(other)]
    return body.clamped(poses)


def _finite_limits(body: BodyModel, columns: Integers, q: Array) -> tuple[Array, Array]:
    """Lowest and highest values (n,) of parameters: their limits, or a range around a pose (dof,) without any."""
    low, high = body.limits[columns].T
    reach = np.where(body.rotates[columns], _ROUND_RAD, _REACH_M)
    return np.where(np.isinf(low), q[columns] - reach, low), np.where(np.isinf(high), q[columns] + reach, high)
