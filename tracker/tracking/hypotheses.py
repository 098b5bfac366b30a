"""Possible start poses: candidates and their ranking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.tracking.estimate import Estimate
from tracker.tracking.initialization import Stages
from tracker.tracking.limb_probabilities import limbs_left_over
from tracker.tracking.start import Hypothesis, Start

# Largest left-over share of another body that may be the person, times that of the best pose. The wrong one of two
# persons left over 0.8 to 1.9 times as much as the right one in 16 starts.
_MOST_BESIDE = 2.0
# Poses whose landmarks lie this close together on average are one and the same.
_SAME_M = 0.06

# Turns further apart than this are two ways to face.
_OTHER_WAY_DEG = 90.0

CoarseValues = dict[str, tuple[float, ...]]
"""Parameter -> values tried, degrees."""


def with_held(scene: Scene, k: int, held: tuple[int, ...]) -> Scene:
    """The persons with known poses, and person k as the last one."""
    return Scene((*(scene.persons[other] for other in held), scene.persons[k]), scene.rig)


def coarse_poses(body: BodyModel, starts: list[Array], turns_deg: Array, values: CoarseValues) -> Array:
    """(N, dof) all combinations of the start poses (dof,), turned, and further values.

    Args:
        body: gives the joint limits.
        starts: poses (dof,) from the body's axis.
        turns_deg: (M,) turns relative to them, degrees.
        values: parameter -> values, degrees; a name without the word of the side means each side for itself.
    """
    tried = {column: np.radians(degrees) for name, degrees in values.items() for column in body.columns(name)}
    combinations = np.array(list(product(np.radians(turns_deg), *tried.values())))
    poses = np.repeat(np.array(starts), len(combinations), axis=0)
    tiled = np.tile(combinations, (len(starts), 1))
    poses[:, list(tried)] = tiled[:, 1:]
    poses[:, turn_of(body)] += tiled[:, 0]
    return body.clamped(poses)


def turn_of(body: BodyModel) -> int:
    """Column of the turn that the body's axis does not show."""
    return body.index(body.start.turn)


def apart(body: BodyModel, poses: Array, distances: Array, rule: tuple[int, float]) -> list[Array]:
    """The best of poses (N, dof) with different turns; `rule` has their number, and the least difference in degrees."""
    column = turn_of(body)
    chosen: list[Array] = []
    for i in np.argsort(distances, kind="stable"):
        gaps = [abs(_wrapped(poses[i, column] - q[column])) for q in chosen]
        if not gaps or min(gaps) >= np.radians(rule[1]):
            chosen.append(poses[i])
        if len(chosen) == rule[0]:
            break
    return chosen


def different(body: BodyModel, poses: Array, n: int, apart_m: float) -> list[Array]:
    """The first n of poses (N, dof), best first, with a mean distance of their landmarks, metres."""
    marks = body.landmarks_in_world(poses)
    left = np.arange(len(poses))
    chosen: list[Array] = []
    while len(left) and len(chosen) < n:
        chosen.append(poses[left[0]])
        gaps = np.linalg.norm(marks[left] - marks[left[0]], axis=2).mean(axis=1)
        left = left[gaps >= apart_m]
    return chosen


def beside_turned(frame: Frame, scene: Scene, k: int, turned: Array, stages: Stages) -> tuple[Hypothesis, ...]:
    """The pose of a scene's person, unchanged, and another one, weighed after a refinement.

    Args:
        frame: the images.
        scene: the persons, with the poses to start from.
        k: the person.
        turned: (dof,) the pose turned round.
        stages: tools of the comparison.
    """
    body, q = scene.persons[k].body, scene.persons[k].q
    tried = np.array([q, turned])
    objective = stages.objective(frame, scene, k, stages.synthesis.contours(scene, k, tried))
    refined = [hypothesis(body, stages.estimation.estimate(objective, one[None])) for one in tried]
    nats = objective.nats(np.array([one.q for one in refined]))
    mine_is_right = float(np.exp(-np.logaddexp(0.0, nats[0] - nats[1])))
    mine = replace(refined[0], q=q, given=True, probability=mine_is_right)
    both = ranked(body, [mine, replace(refined[1], probability=1 - mine_is_right)], nats)
    return both if any(one.given for one in both) else (mine,)  # turned round it was led back to where it is


def hypothesis(body: BodyModel, estimate: Estimate) -> Hypothesis:
    """The hypothesis of an estimate; contour that no image shows counts for nothing."""
    account = estimate.account
    left_over = account.left_over if account.explained > 0 else max(account.left_over, 1.0)
    turn_deg = float(np.degrees(_wrapped(estimate.q[turn_of(body)]))) if body.start.turn else 0.0
    return Hypothesis(
        estimate.q,
        estimate.distance_px,
        account.explained,
        left_over,
        turn_deg,
        limbs_left_over(body, account),
    )


def ranked(body: BodyModel, hypotheses: list[Hypothesis], costs: Array | None = None) -> tuple[Hypothesis, ...]:
    """The hypothesis of least cost (N,) first, else the one that leaves over least; of equal poses the best."""
    order = np.argsort([one.left_over for one in hypotheses] if costs is None else costs, kind="stable")
    kept: list[Hypothesis] = []
    for one in (hypotheses[n] for n in order):
        if all(_gap_m(body, one.q, other.q) > _SAME_M for other in kept):
            kept.append(one)
    return tuple(kept)


def finalists(ranking: Sequence[Hypothesis], n: int) -> tuple[Hypothesis, ...]:
    """The first n, and the first of the others that faces the other way if all of them face one way.

    A woman whose legs hardly a view shows was turned round, and the first three differed only in these legs, so that
    none of those followed into the next frames faced as she does: 320 mm in all 100 frames.
    """
    first, rest = ranking[:n], ranking[n:]
    other = next((one for one in rest if all(_faces_away(one, kept) for kept in first)), None)
    return tuple(first) if other is None else (*first, other)


def _faces_away(one: Hypothesis, other: Hypothesis) -> bool:
    return abs((one.turn_deg - other.turn_deg + 180.0) % 360.0 - 180.0) > _OTHER_WAY_DEG


def least_left(starts: list[Start], scene: Scene, n: int) -> Start:
    """Of starts from several foregrounds the one that leaves over least; for one person with all best hypotheses.

    On 18 frames of nine recordings it was the nearer one whenever they differed by over 25 mm: in five frames of three,
    28 to 88 mm off instead of 70 to 561.
    """
    best = min(starts, key=lambda one: sum(ranking[0].left_over for ranking in one.hypotheses if ranking))
    sought = [k for k, ranking in enumerate(best.hypotheses) if ranking]
    return best if len(sought) > 1 else likeliest(starts, scene, n)


def likeliest(starts: list[Start], scene: Scene, n: int, bodies: bool = False) -> Start:
    """Of several starts of one person, the one that leaves over least, with the best n of all hypotheses.

    Args:
        starts: from several ways.
        scene: the persons.
        n: number of hypotheses that stay.
        bodies: whether each start is of another body: the best of each stays, too, unless it is much worse.
    """
    best = min(starts, key=lambda one: sum(ranking[0].left_over for ranking in one.hypotheses if ranking))
    (sought,) = (k for k, ranking in enumerate(best.hypotheses) if ranking)
    firsts = [start.hypotheses[sought][0] for start in starts if bodies]
    every = ranked(scene.persons[sought].body, [one for start in starts for one in start.hypotheses[sought]])
    most = _MOST_BESIDE * every[0].left_over
    kept = finalists(every, n)
    left = (one for one in every if not any(one is other for other in kept))
    others = (one for one in left if one.left_over < most and any(one is first for first in firsts))
    ranking = (*kept, *others)
    own = [k == sought for k in range(len(best.poses))]
    return replace(
        best,
        hypotheses=tuple(ranking if mine else () for mine in own),
    )


def _gap_m(body: BodyModel, q: Array, other: Array) -> float:
    """Mean distance of the landmarks of two poses (dof,), metres."""
    marks, others = body.landmarks_in_world(np.array([q, other]))
    return float(np.linalg.norm(marks - others, axis=1).mean())


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
