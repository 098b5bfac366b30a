"""Differences between persons' bodies: named shape parameters, linear in the content of a model file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pydantic

from tracker.acquisition._anatomy import (
    MOST_TAPER,
    SQUARENESS,
    Anatomy,
    correlated,
    end_moved,
    fattened,
    grown,
    lengthened,
    shifted,
    widened,
)
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.foundation.arrays import Array, Integers, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ModelError
from tracker.foundation.geometry.superquadrics import surface
from tracker.kernels.body import chain_transforms


@dataclass(frozen=True)
class Variants:
    """S bodies of one kind; the twin is a `BodyModel` for each."""

    body: BodyModel
    """One of the kind: its parameters' axes, its tree."""

    points: Array
    """(S, dof, 3) points on the parameters' axes, reference pose, metres."""

    model_from_parts: Array
    """(S, P, 4, 4)"""

    shapes: Array
    """(S, P, 7) packed superquadrics."""

    landmarks: Array
    """(S, L, 3) in the reference pose, metres."""

    @classmethod
    def of(cls, body: BodyModel, description: BodyDescription, changes: Array) -> Variants:
        """The bodies of a description with changes (S, n) of its packed anatomy."""
        general = Anatomy.of(description)
        one = [general.plus(change) for change in changes]
        starts, ends = np.array([a.starts for a in one]), np.array([a.ends for a in one])
        along = ends - starts
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        along = along / length
        side = np.cross(along, general.fronts)
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        placed = np.zeros((*length.shape[:2], 4, 4))
        placed[..., :3, :3] = np.stack([np.cross(side, along), side, along], axis=-1)
        placed[..., :3, 3] = (starts + ends) / 2
        placed[..., 3, 3] = 1.0
        radii, squareness, taper = (np.array([getattr(a, name) for a in one]) for name in _SHAPE)
        shapes = np.concatenate([np.exp(radii), length / 2, squareness, taper], axis=-1)
        joints = np.array([a.joints for a in one])[:, _segments(description)]
        return cls(body, joints, placed, shapes, np.array([a.landmarks for a in one]))

    def _motions(self, q: Array) -> Array:
        rotates, axes, _, parents = self.body.packed
        pose = np.array(q[None], dtype=np.float64)
        # Read-only points, as a body's own: the kernel is compiled for them.
        motions = [chain_transforms(pose, rotates, axes, frozen(points), parents)[0] for points in self.points]
        return np.array(motions)

    def placements(self, q: Array) -> tuple[Array, Array]:
        """Parts (S, P, 4, 4) and landmarks (S, L, 3) in the world at a pose (dof,), metres."""
        motions = self._motions(q)
        parts: Array = motions[:, self.body.part_parameters] @ self.model_from_parts
        ends = [mark.parameter for mark in self.body.landmarks]
        carried = motions[:, ends]
        marks: Array = (carried[..., :3, :3] @ self.landmarks[..., None])[..., 0] + carried[..., :3, 3]
        return parts, marks


def heights(shapes: Array, model_from_parts: Array) -> Array:
    """Highest point less lowest point of bodies (S,), or of a single one, in the reference pose, metres.

    Args:
        shapes: (..., P, 7) packed superquadrics.
        model_from_parts: (..., P, 4, 4)
    """
    low, high = levels(shapes, model_from_parts)
    tall: Array = high.max(axis=-1) - low.min(axis=-1)
    return tall


def levels(shapes: Array, model_from_parts: Array) -> tuple[Array, Array]:
    """Lowest and highest points (..., P) of parts in the reference pose, metres; arguments as of `heights`."""
    eta, omega = np.linspace(-np.pi / 2, np.pi / 2, 25)[:, None], np.linspace(-np.pi, np.pi, 25)[:-1]
    points, _ = surface(np.moveaxis(shapes, -1, 0)[..., None, None], eta, omega)
    up = model_from_parts[..., 2, :]
    found = np.einsum("...pehi,...pi->...peh", points, up[..., :3]) + up[..., 3, None, None]
    return found.min(axis=(-2, -1)), found.max(axis=(-2, -1))


_SHAPE = ("radii", "squareness", "taper")


def _segments(description: BodyDescription) -> Integers:
    """(dof,) segment of each parameter."""
    owners = [k for k, segment in enumerate(description.segments) for _ in segment.parameters]
    return np.array(owners, dtype=np.int64)


# Of the differences: half the digits of double precision for parameters of about 1.
_STEP = 1e-5


@component
class ShapePrior:
    """Differences of persons from the model scaled by their stature: standard deviations."""

    symmetric: bool = True
    """Left and right have the same lengths and shapes."""

    stature: float = pydantic.Field(default=0.01, gt=0)
    """Overall size, relative."""

    girth: float = pydantic.Field(default=0.1, gt=0)
    """All radii together, relative."""

    length: float = pydantic.Field(default=0.04, gt=0)
    """Length of a segment, relative: those of adults of one stature differ by 3.3 % (upper arms) to 4.9 % (thighs), and
    go together as `tracker.acquisition._anatomy` has it: docs/lab/sure_bodies.md."""

    joint_m: float = pydantic.Field(default=0.015, gt=0)
    """Place of a joint on a segment with several ones (shoulders and hips on the torso), metres."""

    end_m: float = pydantic.Field(default=0.015, gt=0)
    """Ends of a part along its axis, metres."""

    offset_m: float = pydantic.Field(default=0.01, gt=0)
    """Ends of a part across its axis, metres."""

    radius: float = pydantic.Field(default=0.15, gt=0)
    """Radii of a part, relative."""

    squareness: float = pydantic.Field(default=0.15, gt=0)
    """Both exponents of a part."""

    taper: float = pydantic.Field(default=0.15, gt=0)
    """Relative growth of a part from its middle to its end."""


@dataclass(frozen=True)
class ShapeParameter:
    """One way in which a body may differ."""

    name: str
    """Its effect: `left_thigh.length`; of a symmetric pair the first side's name."""

    sigma: float
    """Standard deviation among persons."""

    direction: Array
    """(n,) change of the packed anatomy per unit."""

    limits: tuple[float, float] = (-np.inf, np.inf)
    part: str | None = None
    """The part that alone it changes, if so."""


@dataclass(frozen=True)
class ShapeSpace:
    """Bodies ``anatomy = general + directions s``; s (S,) is 0 for the general model."""

    description: BodyDescription
    prior: ShapePrior = field(default_factory=ShapePrior)

    @cached_property
    def parameters(self) -> tuple[ShapeParameter, ...]:
        """All shape parameters, in the order of s."""
        return tuple(_parameters(Anatomy.of(self.description), self.description, self.prior))

    @cached_property
    def general(self) -> BodyModel:
        """The body that others differ from."""
        return self.description.build()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def sigmas(self) -> Array:
        """(S,) standard deviations of the prior."""
        return frozen([parameter.sigma for parameter in self.parameters])

    @cached_property
    def covariance(self) -> Array:
        """(S, S) covariance of the prior."""
        correlations = correlated(self.names, self.description.sides)
        return frozen(self.sigmas[:, None] * correlations * self.sigmas)

    @cached_property
    def limits(self) -> Array:
        """(S, 2) smallest and largest values: shapes stay convex."""
        return frozen([parameter.limits for parameter in self.parameters]).reshape(-1, 2)

    @cached_property
    def directions(self) -> Array:
        """(n, S) change of the packed anatomy per unit of each parameter."""
        return frozen(np.stack([parameter.direction for parameter in self.parameters], axis=1))

    def described(self, s: Array) -> BodyDescription:
        """The model file's content for a shape (S,)."""
        general = Anatomy.of(self.description)
        return general.plus(self.directions @ s).described(self.description)

    def body(self, s: Array) -> BodyModel:
        """The body of a shape (S,)."""
        return self.described(s).build()

    def neighbours(self, s: Array) -> Variants:
        """S bodies, each with one parameter moved by `steps`."""
        moved = s + np.diag(self.steps(s))
        return Variants.of(self.body(s), self.description, moved @ self.directions.T)

    def steps(self, s: Array) -> Array:
        """(S,) steps of `neighbours`, inwards at a limit."""
        return np.where(s + _STEP > self.limits[:, 1], -_STEP, _STEP)


def _parameters(anatomy: Anatomy, body: BodyDescription, prior: ShapePrior) -> Iterable[ShapeParameter]:
    yield ShapeParameter("stature", prior.stature, grown(anatomy))
    yield ShapeParameter("girth", prior.girth, fattened(anatomy))
    for k, segment in enumerate(body.segments):
        sides = _sides(anatomy.segment_mates[k], k, prior)
        if sides is None:
            continue
        if len(anatomy.children(k)) > 1:
            for axis, name in enumerate(("depth", "width", "height")):
                yield ShapeParameter(
                    f"{segment.name}.{name}", prior.length, _both(anatomy, widened(anatomy, k, axis), sides)
                )
            for child in anatomy.children(k):
                yield from _joint_parameters(anatomy, body, child, prior)
        elif anatomy.length_axis(k) is not None:
            yield ShapeParameter(f"{segment.name}.length", prior.length, _both(anatomy, lengthened(anatomy, k), sides))
    for p, part in enumerate(body.parts):
        sides = _sides(anatomy.part_mates[p], p, prior)
        if sides is not None:
            for name, sigma, direction, limits in _part_changes(anatomy, p, prior):
                midline = prior.symmetric and anatomy.part_mates[p] == p and not anatomy.lone_parts[p]
                if midline:
                    direction = anatomy.symmetrized(direction)
                if np.abs(direction).max() > 0.1:
                    yield ShapeParameter(
                        f"{part.name}.{name}", sigma, _both(anatomy, direction, sides), limits, part.name
                    )


def _sides(mate: int, own: int, prior: ShapePrior) -> tuple[bool, bool] | None:
    """Whether to mirror a change and whether it stands for both sides; None for the side that is a mirror image."""
    if not prior.symmetric or mate == own:
        return (False, True)
    return (True, True) if own < mate else None


def _both(anatomy: Anatomy, direction: Array, sides: tuple[bool, bool]) -> Array:
    return direction + anatomy.mirrored(direction) if sides[0] else direction


def _joint_parameters(anatomy: Anatomy, body: BodyDescription, k: int, prior: ShapePrior) -> Iterable[ShapeParameter]:
    mate = anatomy.segment_mates[k]
    sides = _sides(mate, k, prior)
    if sides is None:
        return
    for axis, name in enumerate("xyz"):
        direction = shifted(anatomy, k, np.eye(3)[axis])
        if prior.symmetric and mate == k and not anatomy.lone_segments[k]:
            direction = anatomy.symmetrized(direction)
        if np.abs(direction).max() > 0.1:
            yield ShapeParameter(
                f"{body.segments[k].name}.joint_{name}", prior.joint_m, _both(anatomy, direction, sides)
            )


def _part_changes(
    anatomy: Anatomy, p: int, prior: ShapePrior
) -> Iterable[tuple[str, float, Array, tuple[float, float]]]:
    """Name, sigma, direction and limits of the ways in which one part may differ."""
    free = (-np.inf, np.inf)
    for end in ("start", "end"):
        for axis, name in zip(anatomy.part_axes(p), ("along", "front", "side"), strict=True):
            sigma = prior.end_m if name == "along" else prior.offset_m
            yield f"{end}_{name}", sigma, end_moved(anatomy, p, end, axis), free
    low, high = SQUARENESS
    for k, name in enumerate(("front", "side")):
        yield f"radius_{name}", prior.radius, anatomy.one("radii", p, k), free
    for k, name in enumerate(("along", "around")):
        value = float(anatomy.squareness[p, k])
        yield f"squareness_{name}", prior.squareness, anatomy.one("squareness", p, k), (low - value, high - value)
    for k, name in enumerate(("front", "side")):
        value = float(anatomy.taper[p, k])
        yield f"taper_{name}", prior.taper, anatomy.one("taper", p, k), (-MOST_TAPER - value, MOST_TAPER - value)


def space_of(description: BodyDescription, prior: ShapePrior) -> ShapeSpace:
    """The shape space of a model; a skin does not follow where lengths change, so it is left out.

    Raises:
        ModelError: the model has no part or no segment.
    """
    if not description.parts or not description.segments:
        raise ModelError(f'model "{description.name}" has no parts: there is no shape to acquire')
    return ShapeSpace(description.model_copy(update={"skin": None}), prior)
