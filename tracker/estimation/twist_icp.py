"""Gauss-Newton refinement of a pose on oriented contour correspondences, with joint limits."""

from __future__ import annotations

import numpy as np
import pydantic
from scipy.linalg import cho_factor, cho_solve

from tracker.arrays import Array, Integers, Mask
from tracker.body import BodyModel
from tracker.components import component
from tracker.contours import Contours
from tracker.correspondences import Correspondences
from tracker.estimate import Estimate
from tracker.kernels.oriented_matching import match_oriented, normal_equations
from tracker.objective import Objective

# A contour sample and its neighbours share one edge and one interpolation: 8 px of contour count as one
# observation, and each is used about twice, from the model to the scene and back.
_PX_PER_OBSERVATION = 16.0


@component
class TwistIcpEstimation:
    """Iterated closest points with agreeing directions, linearized on the twists of the joints.

    Matches visible model contours and scene edges both ways, moves the pose so that the distances along the
    contour normals shrink, and repeats with a smaller gate.
    """

    iterations: int = pydantic.Field(default=6, ge=1)
    """Gauss-Newton steps."""

    trial_iterations: int = pydantic.Field(default=2, ge=0)
    """Steps from each of several starts, after which only the best one goes on."""

    gate_px: float = pydantic.Field(default=30.0, gt=0)
    """Largest distance of a pair in the first iteration, px."""

    final_gate_px: float = pydantic.Field(default=8.0, gt=0)
    """The same in the last iteration, px."""

    direction_deg: float = pydantic.Field(default=40.0, gt=0, le=90)
    """Largest angle between the normal of the model contour and the scene's gradient, degrees."""

    noise_px: float = pydantic.Field(default=1.0, gt=0)
    """Standard deviation of an edge position the prior is weighed against, px."""

    prior_deg: float = pydantic.Field(default=15.0, gt=0)
    """Standard deviation of an angle around the start, degrees: holds what the images do not show."""

    prior_m: float = pydantic.Field(default=0.15, gt=0)
    """Standard deviation of a translation around the start, metres."""

    same_deg: float = pydantic.Field(default=0.5, ge=0)
    """Starts whose angles differ by less than this, and whose translations by less than `same_m`, are one, degrees."""

    same_m: float = pydantic.Field(default=0.005, ge=0)
    """The same for translations, metres."""

    rest_deg: float = pydantic.Field(default=0.1, ge=0)
    """Steps smaller than this and `rest_m` end the iterations at a gate, degrees."""

    rest_m: float = pydantic.Field(default=0.001, ge=0)
    """The same for translations, metres."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """Refines all starts for some iterations, and then the one of least distance to the end."""
        gates = np.geomspace(self.gate_px, self.final_gate_px, self.iterations).tolist()
        tolerance = self._steps(objective.body, self.same_deg, self.same_m)
        distinct: list[Array] = []
        for start in starts:
            if not any((np.abs(start - other) < tolerance).all() for other in distinct):
                distinct.append(start)
        n_trial = min(self.trial_iterations, self.iterations) if len(distinct) > 1 else 0
        tried = [self._descend(objective, start, objective.body.clamped(start), gates[:n_trial]) for start in distinct]
        best = int(np.argmin(objective(np.array([q for q, _ in tried])))) if len(tried) > 1 else 0
        q, covariance = self._descend(objective, distinct[best], tried[best][0], gates[n_trial:])
        return objective.estimate(q, covariance, (len(distinct) - 1) * (n_trial + 1) + self.iterations + 1)

    def refine(self, objective: Objective, start: Array) -> tuple[Array, Array]:
        """Gauss-Newton from one start (dof,): the pose (dof,) and its covariance (dof, dof)."""
        gates = np.geomspace(self.gate_px, self.final_gate_px, self.iterations).tolist()
        return self._descend(objective, start, objective.body.clamped(start), gates)

    def _descend(self, objective: Objective, start: Array, q: Array, gates: list[float]) -> tuple[Array, Array]:
        """Steps from a pose with a gate each, held near the start; the pose reached and its covariance."""
        body = objective.body
        spread = self._steps(body, self.prior_deg, self.prior_m)
        prior = np.diag((self.noise_px / spread) ** 2)
        matrix, squares, total = prior, 0.0, 0.0
        resting = self._steps(body, self.rest_deg, self.rest_m)
        gates = list(gates)
        while gates:
            matrix, vector, squares, total = self._equations(objective, q, gates.pop(0))
            before = q
            q = _limited_step(q, matrix + prior, vector + prior @ (q - start), body.limits)
            if (np.abs(q - before) < resting).all():
                # At rest with a wide gate: only the narrow one can still move it.
                gates = gates[-1:]
        variance = squares / total if total > 0 else self.noise_px**2
        information = matrix / max(variance, 1e-6) + prior / self.noise_px**2
        return q, np.asarray(np.linalg.inv(information), dtype=np.float64)

    def _equations(self, objective: Objective, q: Array, gate_px: float) -> tuple[Array, Array, float, float]:
        """Normal equations at a pose (dof,); see `normal_equations`."""
        body, contours = objective.body, objective.contours(q[None])
        return normal_equations(
            _pairs(objective, contours, gate_px, self.direction_deg),
            contours.positions[0],
            contours.points[0],
            contours.parts[0],
            objective.ends,
            objective.observation.packed[2],
            objective.scene.rig.packed,
            body.twists(q),
            body.moves,
            _PX_PER_OBSERVATION,
            0.5 * gate_px,
        )

    def _steps(self, body: BodyModel, angle_deg: float, length_m: float) -> Array:
        """(dof,) an angle for rotations and a length for translations, rad and m."""
        steps: Array = np.where(body.rotates, np.radians(angle_deg), length_m)
        return steps


def _pairs(objective: Objective, contours: Contours, gate_px: float, direction_deg: float) -> Integers:
    """(N, 4) oriented nearest neighbours both ways; see `match_oriented`."""
    _, _, scene, first, _ = objective.observation.packed
    pairs = np.empty((int(contours.counts[0].sum()) + len(scene), 4), dtype=np.int64)
    gate = (gate_px, float(np.cos(np.radians(direction_deg))))
    return pairs[: match_oriented(contours.positions[0], contours.counts[0], scene, first, gate, pairs)]


def correspondences(
    objective: Objective, contours: Contours, q: Array, gate_px: float, direction_deg: float
) -> Correspondences:
    """Oriented nearest neighbours between a person's contours and the observation, both ways, one by one.

    Args:
        objective: scene, person and observation.
        contours: of the scene with that person at q; the first pose counts.
        q: (dof,) rad and m.
        gate_px: largest distance of a pair, px.
        direction_deg: largest angle between model normal and scene gradient, modulo sign, degrees.

    Returns:
        Pairs of the person's own parts, weighted in observations of 8 px of contour.
    """
    scene, positions = objective.observation.packed[2], contours.positions[0]
    pairs = _pairs(objective, contours, gate_px, direction_deg)
    parts = contours.parts[0][pairs[:, 0], pairs[:, 1]]
    start = objective.scene.first_part(objective.person)
    own: Mask = (parts >= start) & (parts < start + len(objective.body.parts))
    pairs, parts = pairs[own], parts[own] - start
    views, samples, found = pairs[:, 0], pairs[:, 1], pairs[:, 2]
    sample = positions[views, samples].astype(np.float64)
    length = np.where(pairs[:, 3] == 0, sample[:, 4], scene[found, 4])
    return Correspondences(
        points=contours.points[0][views, samples].astype(np.float64),
        parameters=objective.body.part_parameters[parts],
        views=np.ascontiguousarray(views),
        normals=np.ascontiguousarray(sample[:, 2:4]),
        pixels=scene[found, :2].astype(np.float64),
        weights=length / _PX_PER_OBSERVATION,
    )


def _limited_step(q: Array, matrix: Array, vector: Array, limits: Array) -> Array:
    """The minimum of the quadratic model inside the joint limits, by fixing the parameters that hit one."""
    free = np.ones(len(q), dtype=np.bool_)
    result = q.copy()
    for _ in range(4):
        fixed_step = (result - q)[~free]
        right = -vector[free] - matrix[np.ix_(free, ~free)] @ fixed_step
        step = cho_solve(cho_factor(matrix[np.ix_(free, free)]), right)
        target = q[free] + step
        inside = np.clip(target, limits[free, 0], limits[free, 1])
        result[free] = inside
        hit = np.flatnonzero(free)[np.abs(inside - target) > 1e-12]
        if not len(hit):
            break
        free[hit] = False
        if not free.any():
            break
    return result
