"""Movements as functions of time, from the body's model file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tracker.bodies.body import BodyModel
from tracker.bodies.body.sections import Movement, Term
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError, nearest


def _ease(times: Array, term: Term) -> Array:
    """Minimum-jerk blend from 0 to 1 between two times."""
    return _blend(times, term.from_s, term.to_s)


def _blend(times: Array, from_s: float, to_s: float) -> Array:
    s = np.clip((times - from_s) / (to_s - from_s), 0, 1)
    blend: Array = s**3 * (10 - 15 * s + 6 * s**2)
    return blend


def _swing(times: Array, term: Term) -> Array:
    """Sine that fades in over the first half second."""
    wave: Array = np.sin(2 * np.pi * (times / term.period_s + term.phase)) * _blend(times, 0.0, 0.5)
    return wave


def _lift(times: Array, term: Term) -> Array:
    """The positive half of a swing, to a power."""
    lift: Array = np.maximum(_swing(times, term), 0) ** term.power
    return lift


def _dip(times: Array, term: Term) -> Array:
    """There and back once a period."""
    depth: Array = 0.5 - 0.5 * np.cos(2 * np.pi * times / term.period_s)
    return depth


def _pace(times: Array, term: Term) -> Array:
    """Seconds at full pace, which is reached exponentially."""
    since = np.maximum(times - term.from_s, 0)
    run: Array = since - term.run_up_s * (1 - np.exp(-since / term.run_up_s))
    return run


_COURSES: dict[str, Callable[[Array, Term], Array]] = {
    "at": lambda times, term: np.ones_like(times),
    "ease": _ease,
    "swing": _swing,
    "lift": _lift,
    "dip": _dip,
    "pace": _pace,
}


def course(curve: tuple[Term, ...], times: Array) -> Array:
    """(T,) values of a curve, degrees or metres, at times (T,) in seconds."""
    values: Array = np.sum([term.amount * _COURSES[term.kind](times, term) for term in curve], axis=0)
    return values


def movement_of(name: str, body: BodyModel) -> tuple[str, Movement]:
    """A movement of a body by its name, empty for the first one.

    Raises:
        ConfigError: no such movement.
    """
    name = name or next(iter(body.movements))
    if name not in body.movements:
        raise ConfigError(f'no movement "{name}" of model "{body.name}"; {nearest(name, body.movements)}')
    return name, body.movements[name]


def poses_of(
    movement: str, body: BodyModel, times: Array, heading_deg: float = 0.0, place: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """Poses of a movement, the lowest part standing on the floor z = 0; what is fixed to the world stays where it is.

    Args:
        movement: its name in the body's file; empty for the first one.
        body: with a root that moves along x, y and z and turns about z, or one that stays in its
            place, as an arm of a robot: heading and place do not matter then.
        times: (T,) seconds.
        heading_deg: direction faced at the start, degrees from the world's x axis.
        place: x and y of the root, metres.

    Returns:
        (T, dof) rad and m, within the joint limits.

    Raises:
        ConfigError: no such movement.
        ModelError: the body has another root.
    """
    _, described = movement_of(movement, body)
    poses = np.zeros((len(times), body.dof))
    for name, curve in described.curves.items():
        values = course(curve, times)
        poses[:, body.index(name)] = np.radians(values) if body.parameters[body.index(name)].rotates else values
    if body.stays:
        return body.clamped(poses)
    _face(body, poses, np.radians(heading_deg))
    poses = body.clamped(poses)
    across, upwards = body.root.shifts[:2], body.root.shifts[2]
    poses[:, across] = place
    if described.planted:
        marks = [body.landmark_names.index(name) for name in described.planted]
        feet = body.landmarks_in_world(poses)[:, marks, :2].mean(axis=1)
        poses[:, across] += feet[0] - feet
    if described.stepping:
        poses[:, across] += _walked(body, poses, times, described.stepping)
    poses[:, upwards] -= _lowest(body, poses)
    return poses


def _walked(body: BodyModel, poses: Array, times: Array, names: tuple[str, ...]) -> Array:
    """(T, 2) way of the root, as far as its steps reach, metres."""
    if len(times) < 2:
        return np.zeros((len(times), 2))
    feet = body.landmarks_in_world(poses)[:, [body.landmark_names.index(name) for name in names]]
    heights = (feet[:-1, :, 2:] + feet[1:, :, 2:]) / 2
    weights = np.exp(-(heights - heights.min(axis=1, keepdims=True)) / _BOTH_FEET_M)
    steps = (weights * (feet[:-1, :, :2] - feet[1:, :, :2])).sum(axis=1) / weights.sum(axis=1)
    even = gaussian_filter1d(steps, _INERTIA_S / float(np.diff(times).mean()), axis=0, mode="reflect")
    way: Array = np.concatenate([np.zeros((1, 2)), np.cumsum(even, axis=0)])
    return way


# Difference of height within which the weight is on both feet, and time over which a body keeps its pace: it then goes
# on about as fast as its steps reach, without a jerk, while a foot on the floor slips by some centimetres.
_BOTH_FEET_M, _INERTIA_S = 0.02, 0.25


def _face(body: BodyModel, poses: Array, heading: float) -> None:
    """Turns the body by a heading, rad, and with it the lean that the curves mean relative to where it faces.

    Tilts that are outside the turn in the body's chain name axes of the world: they have to change for the body to lean
    as much to its front and side. Gauss-Newton on the direction of its upward axis.
    """
    turn = body.root.turn
    outer = [int(k) for k in body.root.columns if body.rotates[k] and body.moves[k, turn] and k != turn]
    poses[:, turn] += heading
    if not outer:
        return
    angle = np.sign(body.parameters[turn].axis[2]) * poses[:, turn]
    leaning = body.world_from_parameters(poses)[:, outer[-1], :3, 2]
    wanted = np.stack(
        [
            np.cos(angle) * leaning[:, 0] - np.sin(angle) * leaning[:, 1],
            np.sin(angle) * leaning[:, 0] + np.cos(angle) * leaning[:, 1],
            leaning[:, 2],
        ],
        axis=1,
    )
    for _ in range(_ITERATIONS):
        up = body.world_from_parameters(poses)[:, outer[-1], :3, 2]
        slopes = np.cross(body.twists(poses)[:, outer, 3:], up[:, None]).transpose(0, 2, 1)
        poses[:, outer] += (np.linalg.pinv(slopes) @ (wanted - up)[..., None])[..., 0]


# Quadratic convergence from leans of 30 degrees that turn round: 1e-15 rad after 8.
_ITERATIONS = 12


def _lowest(body: BodyModel, poses: Array) -> Array:
    """(T,) height of the lowest surface point, metres."""
    eta = np.linspace(-np.pi / 2, np.pi / 2, 25)[:, None]
    omega = np.linspace(-np.pi, np.pi, 36, endpoint=False)[None, :]
    placements = body.world_from_part(poses)
    heights = [
        (placements[:, p, 2, :3] @ part.shape.surface(eta, omega)[0].reshape(-1, 3).T).min(axis=1)
        + placements[:, p, 2, 3]
        for p, part in enumerate(body.parts)
    ]
    lowest: Array = np.min(heights, axis=0)
    return lowest
