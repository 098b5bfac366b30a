"""Gauss-Newton refinement of a pose by the evidence's equations, with joint limits."""

from __future__ import annotations

import numpy as np
import pydantic
from scipy.linalg.lapack import dpotrf, dpotrs

from tracker.bodies.body import BodyModel
from tracker.evidence.measures.correspondences import Equations
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.kernels.descent import Rule
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation._compiled_descent import compiled_descent
from tracker.tracking.objective import Objective


@component
class TwistIcpEstimation:
    """Iterated linearization on the twists of the joints; for contours: iterated closest points.

    Moves the pose so that the residuals of the evidence shrink (for contours: the distances along their normals to
    scene edges of agreeing direction), and repeats with a smaller gate.

    In the terms of Rosenhahn et al. 2006, section 2.3: motions are products of exponentials of twists (eqs. 5, 8, 9,
    12: `tracker.kernels.body`), linearized with twists in the world (eq. 11: `BodyModel.point_jacobian`); the equations
    of all views are one system for the six parameters of the body and its joint angles (`Equations`), solved by
    Cholesky with limits and a prior where the paper takes Householder's. The paired contour decides to which part a
    point belongs, or votes do as in section 2.2 (`votes` of `chamfer` and `level_set`). The paper's point on a Pluecker
    line (eq. 10) is `similarity = { use = "pluecker" }`; `neighbours` adds neighbouring starts.
    """

    # See docs/lab/fewer_refinement_steps.md.
    iterations: int = pydantic.Field(default=6, ge=1)
    """Gauss-Newton steps."""

    trial_iterations: int = pydantic.Field(default=2, ge=0)
    """Steps from each of several starts, after which only the best one goes on."""

    gate_px: float = pydantic.Field(default=30.0, gt=0)
    """Largest distance of a pair in the first iteration, px."""

    final_gate_px: float = pydantic.Field(default=8.0, gt=0)
    """The same in the last iteration, px."""

    noise_px: float = pydantic.Field(default=1.0, gt=0)
    """Standard deviation of an edge position, for the weight of the prior, px."""

    prior_deg: float = pydantic.Field(default=15.0, gt=0)
    """Standard deviation of an angle around the start, degrees: holds angles that the images do not show."""

    prior_m: float = pydantic.Field(default=0.15, gt=0)
    """Standard deviation of a translation around the start, metres."""

    same_deg: float = pydantic.Field(default=0.5, ge=0)
    """Starts whose angles differ by less than this, and whose translations by less than `same_m`, count as one,
    degrees."""

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
        n_trial = min(self.trial_iterations, self.iterations - 1) if len(distinct) > 1 else 0
        tried = [self._descend(objective, start, objective.body.clamped(start), gates[:n_trial]) for start in distinct]
        best = int(np.argmin(objective(np.array([q for q, _ in tried])))) if len(tried) > 1 else 0
        q, found = self._descend(objective, distinct[best], tried[best][0], gates[n_trial:])
        covariance = self._covariance(objective.body, found)
        return objective.estimate(q, covariance, (len(distinct) - 1) * (n_trial + 1) + self.iterations + 1)

    def _descend(self, objective: Objective, start: Array, q: Array, gates: list[float]) -> tuple[Array, Equations]:
        """Steps from a pose with a gate each, held near the start; the pose reached and the last equations."""
        body = objective.body
        prior, found = self._prior(body), Equations.nothing(body.dof)
        resting = self._steps(body, self.rest_deg, self.rest_m)
        compiled = compiled_descent(objective)
        if compiled is not None:
            pulls = body.rest(), 1 / body.spreads**2, objective.rare_px
            reached = compiled(Rule(start, np.diag(prior).copy(), *pulls, resting), q, np.array(gates))
            return reached.q, Equations(reached.matrix, reached.vector, reached.squares, reached.total)
        gates = list(gates)
        while gates:
            found = objective.equations(q, gates.pop(0))
            before = q
            q = _limited_step(q, found.matrix + prior, found.vector + prior @ (q - start), body.limits)
            if (np.abs(q - before) < resting).all():
                # At rest with a wide gate: only the narrow one can still move it.
                gates = gates[-1:]
        return q, found

    def _covariance(self, body: BodyModel, found: Equations) -> Array:
        """(dof, dof) information of equations and prior on a pose; its variance is that of the residuals."""
        variance = found.squares / found.total if found.total > 0 else self.noise_px**2
        information = found.matrix / max(variance, 1e-6) + self._prior(body) / self.noise_px**2
        return np.asarray(np.linalg.inv(information), dtype=np.float64)

    def _prior(self, body: BodyModel) -> Array:
        """(dof, dof) strength of the prior near the start."""
        spread = self._steps(body, self.prior_deg, self.prior_m)
        return np.diag((self.noise_px / spread) ** 2)

    def _steps(self, body: BodyModel, angle_deg: float, length_m: float) -> Array:
        """(dof,) an angle for rotations and a length for translations, rad and m."""
        steps: Array = np.where(body.rotates, np.radians(angle_deg), length_m)
        return steps


def _limited_step(q: Array, matrix: Array, vector: Array, limits: Array) -> Array:
    """Near the minimum of the quadratic model inside the limits: parameters at their limits stay, others are solved.

    Three times at most; a parameter that was fixed too early is free again in the next step.
    """
    low, high = limits.T
    target = q + _solved(matrix, -vector)
    result: Array = np.minimum(np.maximum(target, low), high)
    free = np.abs(result - target) <= 1e-12
    for _ in range(3):
        if free.all() or not free.any():
            break
        held = matrix[np.ix_(free, ~free)] @ (result - q)[~free]
        step = _solved(matrix[np.ix_(free, free)], -vector[free] - held)
        target = q[free] + step
        inside = np.minimum(np.maximum(target, low[free]), high[free])
        result[free] = inside
        hit = np.flatnonzero(free)[np.abs(inside - target) > 1e-12]
        if not len(hit):
            break
        free[hit] = False
    return result


def _solved(matrix: Array, right: Array) -> Array:
    """Solution of a positive definite system by Cholesky, without the checks of `scipy.linalg.cho_solve`.

    Raises:
        LinAlgError: the matrix is not positive definite, or not finite.
    """
    factor, fault = dpotrf(matrix, lower=0, clean=0)
    if fault == 0:
        found: Array = dpotrs(factor, right, lower=0)[0]
        if np.isfinite(found).all():
            return found
    raise np.linalg.LinAlgError("the equations of a pose are not positive definite")
