"""A refinement in one go: all Gauss-Newton steps of a pose on contours, colours and followed places."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.kernels.body import Carried
from tracker.kernels.regions import Lines


class Model(NamedTuple):
    """The body whose pose is sought, as `BodyModel` has it."""

    chain: tuple[Mask, Array, Array, Integers]
    """Its `packed` parameters."""

    model_from_parts: Array
    """(P', 4, 4) metres."""

    part_parameters: Integers
    """(P',) last parameter that moves each part."""

    moves: Mask
    """(dof, dof + 1)."""

    limits: Array
    """(dof, 2) rad and m."""


class Tracing(NamedTuple):
    """What the parts of a scene are traced by, as `tracker.kernels.contours.trace_contours` takes it."""

    shapes: Array
    """(P, 7) packed superquadrics."""

    grids: Array32
    """(P, F, 7) points of the surfaces, their normals, and the products of both."""

    planes: Array32
    """(P, 4, R C) normals at the corners of the grids, and their products with the points."""

    layout: tuple[int, int]
    """R rows and C columns of the grids; F = (2 R - 1) (2 C)."""

    bounds: Array
    """(3, P) radii of bounding spheres, metres; reaches of bounding ellipsoids, squared, in half extents; largest
    distances of the surface from the z axis, metres."""

    cameras: Array
    """(V, 29) from `Rig.packed`."""

    sizes: Array
    """(V, 2) image sizes, px."""

    spacing: tuple[float, float]
    """Contour that a sample stands for, px; distance at which parts touch, metres."""


class Edges(NamedTuple):
    """Scene edges, for `match_oriented` and `normal_equations`."""

    weight: float
    """What the kind counts in the sum of all."""

    exact_px: float
    """What it leaves over, RMS, under which it counts more, px; 0 for never."""

    scene: Array32
    """(S, 5)."""

    first: Integers
    """(V + 1,)."""

    cosine: float
    """Least cosine of the angle between a pair's directions."""

    px_per_observation: float
    """Contour that counts as one observation, px."""


class Colours(NamedTuple):
    """Colours beside the contours, for `parts_beside`, `find_shifts` and `shift_equations`."""

    weight: float
    exact_px: float
    """Both as of `Edges`."""

    lines: Lines
    """The gate of their rule is that of each step."""

    bounds: Array
    """(3, P) of the parts, as `parts_beside` takes them."""

    px_per_observation: float
    """As of `Edges`."""


class Places(NamedTuple):
    """Followed places, for `residuals_of` and `anchor_equations`."""

    weight: float
    exact_px: float
    """Both as of `Edges`."""

    carried: Carried
    shares: Array
    """(N,) what each counts."""

    slide_m: float
    reach_px: float
    """What is off by half the gate, by this or by three standard deviations has a quarter of its weight."""

    least_facing: float
    """Cosine to the camera under which a place is not seen."""


class Asked(NamedTuple):
    """A kind that is not compiled: it is asked for its equations in every step."""

    weight: float
    exact_px: float
    """Both as of `Edges`."""

    ask: Callable[[Any, Array, float], tuple[Array, Array, float, float]]
    """What it says of a question at a pose (dof,) with a gate, px: J^T W J (dof, dof), J^T W r (dof,), sums of w r^2,
    px^2, and of w."""

    apart: bool = False
    """Whether its equations are added as they are: what others leave over does not count."""


class Kinds(NamedTuple):
    """The kinds of evidence that a pose is refined on; None for those that do not count."""

    edges: Edges | None = None
    colours: Colours | None = None
    places: Places | None = None
    most_silent: float = 0.0
    """Largest weight of a kind that says nothing in this frame."""

    asked: tuple[Asked, ...] = ()
    """Those that are not compiled."""


class Rule(NamedTuple):
    """How a pose is held, and when it is at rest."""

    start: Array
    """(dof,) where it is held, rad and m."""

    prior: Array
    """(dof,) how firmly, px^2 per rad^2 and m^2."""

    usual: Array
    """(dof,) where it usually is."""

    inverse_spreads2: Array
    """(dof,) inverse squares of how far from there."""

    rare_px: float
    """What a parameter costs that is one spread from where it usually is, px."""

    resting: Array
    """(dof,) steps smaller than this end the iterations at a gate."""


class Reached(NamedTuple):
    """Where a refinement ends."""

    q: Array
    """(dof,) the pose, rad and m."""

    matrix: Array
    """(dof, dof) J^T W J of the last step, with the pull to where the pose usually is."""

    vector: Array
    """(dof,) J^T W r of it."""

    squares: float
    """Sum of w r^2 of it, px^2."""

    total: float
    """Sum of w of it."""

    n_steps: int
    """Gauss-Newton steps taken."""


def descend(
    model: Model,
    stage: tuple[Array, int, Tracing, Mask],
    kinds: Kinds,
    rule: Rule,
    q: Array,
    gates: Array,
    question: Callable[[Array], Any] | None = None,
) -> Reached:
    """Gauss-Newton steps from a pose, with a gate each; at rest with a wide one, only the narrowest is left.

    Args:
        model: the body.
        stage: (P, 4, 4) world_from_part of all parts of the scene, of which the body's own are replaced; the first of
            these; what they are traced by; (V, P) parts whose contours count for nothing in a view.
        kinds: what the pose is refined on.
        rule: how it is held.
        q: (dof,) where the steps begin, inside the limits.
        gates: (G,) largest distance of a pair in each step, px.
        question: about a pose (dof,), as it is put to the kinds that are asked; None where there are none.

    Raises:
        LinAlgError: the equations are not positive definite.
    """
    placements, first_part, tracing, hidden = stage
    found, dof = np.array(q, dtype=np.float64), len(q)
    matrix, vector = np.empty((dof, dof)), np.empty(dof)
    put = placements, first_part, *tracing, hidden

    def answers(gate_px: float) -> tuple[tuple[Array, Array, float, float], ...]:
        """What they say at the pose that the steps have come to."""
        at = found.copy()
        asked = None if question is None else question(at)
        return tuple(one.ask(asked, at, gate_px) for one in kinds.asked)

    weights = tuple((one.weight, one.exact_px, one.apart) for one in kinds.asked)
    compiled = *kinds[:4], weights, answers
    squares, total, n_steps = native.descend(model, put, compiled, rule, gates, found, matrix, vector)
    if n_steps < 0:
        raise np.linalg.LinAlgError("the equations of a pose are not positive definite")
    return Reached(found, matrix, vector, squares, total, n_steps)
