"""The features of a body that is no person: where each of its segments points, seen from what carries it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Array32, frozen
from tracker.foundation.errors import ModelError

_TRIED, _SPREAD, _STIFF = 16, 0.3, 1e-6
"""Poses about that at rest, rad and m, in which a segment that always points the same way shows that it does."""

_VERTICAL = "vertical"

_ALIKE = 0.01
"""Directions of a body with two sides, at rest, are those of its mirror image to so much."""


@dataclass(frozen=True)
class Features:
    """Directions that movements are compared by."""

    names: tuple[str, ...]

    partners: tuple[int, ...] = ()
    """For each the number of that of the other side; empty for a body that has no sides."""

    across: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Normal of the plane between the sides."""

    def mirrored(self, directions: Array32) -> Array32:
        """Directions (T, L, 3) with the sides exchanged, of a body that has sides."""
        normal, found = np.array(self.across, dtype=np.float32), directions[:, list(self.partners)]
        turned: Array32 = found - 2 * (found @ normal)[..., None] * normal / (normal @ normal)
        return frozen(turned, np.float32)


def features_of(body: BodyModel) -> Features:
    """The segments of a body that do not always point the same way, and the vertical if it moves about.

    Raises:
        ModelError: it has no such segment, or one with the name of the vertical.
    """
    named = dict.fromkeys(part.segment for part in body.parts)
    if _VERTICAL in named:
        raise ModelError(f'model "{body.name}": movements have a direction "{_VERTICAL}": call the segment otherwise')
    q = body.clamped(body.rest() + np.random.default_rng(0).normal(0, _SPREAD, (_TRIED, body.dof)))
    turning = np.ptp(segment_directions(body, Features(tuple(named)), q), axis=0).max(axis=1) > _STIFF
    names = tuple(name for name, turns in zip(named, turning, strict=True) if turns)
    if not names:
        raise ModelError(f'model "{body.name}" has no segment that turns: there is no movement to tell')
    names = names if body.stays else (*names, _VERTICAL)
    others = [body.mirror.of(name) for name in names]
    features = Features(names, (), body.mirror.across)
    if set(others) != set(names) or others == list(names):
        return features
    paired = replace(features, partners=tuple(names.index(name) for name in others))
    rest = segment_directions(body, features, body.rest()[None]).astype(np.float32)
    return paired if np.abs(paired.mirrored(rest) - rest).max() < _ALIKE else features


def segment_directions(body: BodyModel, features: Features, poses: Array) -> Array:
    """(T, L, 3) unit vectors of features at poses (T, dof), in the axes of what carries the body.

    A segment points as its first part does: others may be things that it carries.
    """
    if body.stays:
        axes = np.tile(np.eye(3), (len(poses), 1, 1))
    else:
        axes = body.world_from_parameters(poses)[:, body.root.columns[-1], :3, :3]
    first = {part.segment: p for p, part in reversed(list(enumerate(body.parts)))}
    pointing = body.world_from_part(poses)[:, :, :3, 2]
    upwards = np.tile([0.0, 0.0, 1.0], (len(poses), 1))
    found = [upwards if name == _VERTICAL else pointing[:, first[name]] for name in features.names]
    directions: Array = np.einsum("tji,tlj->tli", axes, np.stack(found, axis=1))
    return directions
