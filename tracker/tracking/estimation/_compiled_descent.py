"""The refinement of a pose in one compiled call; kinds of evidence that are not compiled are asked in each step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array
from tracker.kernels.descent import Model, Reached, Rule, Tracing, descend
from tracker.tracking.objective import Objective


def compiled_descent(objective: Objective) -> Callable[[Rule, Array, Array], Reached] | None:
    """Refines a pose (dof,) with gates (G,), see `tracker.kernels.descent.descend`.

    Made once for all starts. None where no kind of evidence that counts is compiled, or where contours are not traced:
    those of persons' own skins, and of a synthesis that renders pictures.
    """
    return objective.kept("compiled descent", lambda: _made(objective))


def _made(objective: Objective) -> Callable[[Rule, Array, Array], Reached] | None:
    asked, body = objective.asked, objective.body
    trace: Callable[[Scene], Tracing | None] | None = getattr(asked.synthesis, "tracing", None)
    tracing = None if trace is None else trace(asked.scene)
    kinds = None if tracing is None else objective.evidence.kinds(asked)
    if tracing is None or kinds is None:
        return None
    hidden = np.zeros((len(asked.scene.rig), len(asked.scene.shapes)), dtype=np.bool_)
    if objective.history is not None and objective.history.hidden is not None:
        hidden[:, asked.own] = objective.history.hidden
    model = Model(body.packed, body.model_from_parts, body.part_parameters, body.moves, body.limits)
    placements = asked.placements(asked.scene.persons[asked.person].q[None])[0]

    def refine(rule: Rule, q: Array, gates: Array) -> Reached:
        stage = placements, asked.own.start, tracing, hidden
        return descend(model, stage, kinds, rule, q, gates, objective.uncovered)

    return refine
