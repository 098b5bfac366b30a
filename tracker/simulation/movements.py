"""Movements as functions of time, by parameter names of gavrila22-like bodies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.errors import ConfigError, nearest

Curves = dict[str, Array]
"""Parameter name -> (T,) values, degrees."""


def _ease(times: Array, start_s: float, end_s: float) -> Array:
    """Minimum-jerk blend from 0 to 1 between two times."""
    s = np.clip((times - start_s) / (end_s - start_s), 0, 1)
    blend: Array = s**3 * (10 - 15 * s + 6 * s**2)
    return blend


def _swing(times: Array, period_s: float, phase: float = 0.0) -> Array:
    """Sine that fades in over the first half second."""
    wave: Array = np.sin(2 * np.pi * (times / period_s + phase)) * _ease(times, 0, 0.5)
    return wave


def two_elbow_rotation(times: Array) -> Curves:
    """Arms raised sideways to 90 degrees, then both elbows rotated forward, the torso balancing (paper, section 5)."""
    raised = _ease(times, 0.2, 1.2)
    bend = _ease(times, 1.3, 2.0) - _ease(times, 2.2, 3.0) + _ease(times, 3.2, 3.9)
    curves = {"torso_elevation": -4 * bend + 2 * raised, "torso_abduction": 1.5 * _swing(times, 2.6)}
    for side in ("left", "right"):
        # With the arm level, a twist of 90 degrees lets the elbow bend forward in the horizontal plane.
        curves[f"{side}_arm_abduction"] = 8 + 80 * raised
        curves[f"{side}_arm_elevation"] = 4 + 0 * times
        curves[f"{side}_arm_twist"] = 15 * raised
        curves[f"{side}_arm_extension"] = 12 + 78 * bend
    return curves


def walking_on_the_spot(times: Array) -> Curves:
    """Knees lifted in turn, arms swinging against the legs."""
    curves = {"torso_twist": 5 * _swing(times, 1.1), "torso_elevation": 3 * _ease(times, 0, 0.6)}
    for side, phase in (("left", 0.0), ("right", 0.5)):
        lift = np.maximum(_swing(times, 1.1, phase), 0) ** 1.5
        arm = _swing(times, 1.1, phase + 0.5)
        curves[f"{side}_leg_elevation"] = 50 * lift + 2
        curves[f"{side}_leg_extension"] = 75 * lift + 5
        curves[f"{side}_arm_elevation"] = 25 * arm
        curves[f"{side}_arm_extension"] = 20 + 15 * np.maximum(arm, 0)
        curves[f"{side}_arm_abduction"] = 10 + 0 * times
    return curves


def arm_swing(times: Array) -> Curves:
    """Both arms swung forward and back, then in turn sideways."""
    curves = {"torso_elevation": 4 * _swing(times, 1.6)}
    for side, phase in (("left", 0.0), ("right", 0.5)):
        curves[f"{side}_arm_elevation"] = 40 * _swing(times, 1.6) + 5
        curves[f"{side}_arm_abduction"] = 20 + 30 * np.maximum(_swing(times, 3.2, phase), 0)
        curves[f"{side}_arm_extension"] = 15 + 10 * _swing(times, 1.6, phase)
    return curves


def squat(times: Array) -> Curves:
    """Knees bent and stretched again, arms raised forward for balance."""
    depth = 0.5 - 0.5 * np.cos(2 * np.pi * times / 2.6)
    curves = {"torso_elevation": 28 * depth}
    for side in ("left", "right"):
        curves[f"{side}_leg_elevation"] = 75 * depth + 28 * depth
        curves[f"{side}_leg_extension"] = 105 * depth + 3
        curves[f"{side}_leg_abduction"] = 10 + 6 * depth
        curves[f"{side}_arm_elevation"] = 65 * depth
        curves[f"{side}_arm_abduction"] = 12 + 0 * times
        curves[f"{side}_arm_extension"] = 15 + 0 * times
    return curves


def turn(times: Array) -> Curves:
    """A turn on the spot with small steps, 70 degrees a second."""
    curves = walking_on_the_spot(times)
    curves = {name: 0.5 * values for name, values in curves.items()}
    curves["torso_twist"] = 70 * (np.maximum(times - 0.3, 0) - 0.25 * (1 - np.exp(-np.maximum(times - 0.3, 0) / 0.25)))
    for side in ("left", "right"):
        curves[f"{side}_arm_abduction"] = 25 + 0 * times
    return curves


MOVEMENTS: dict[str, Callable[[Array], Curves]] = {
    function.__name__: function for function in (two_elbow_rotation, walking_on_the_spot, arm_swing, squat, turn)
}
"""All movements by name."""

_FEET_STAY = ("squat",)


def poses_of(
    movement: str, body: BodyModel, times: Array, heading_deg: float = 0.0, place: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """Poses of a movement, the lowest part standing on the floor z = 0.

    Args:
        movement: its name.
        body: with the parameter names of gavrila22.
        times: (T,) seconds.
        heading_deg: direction faced at the start, degrees from the world's x axis.
        place: x and y of the torso, metres.

    Returns:
        (T, dof) rad and m, within the joint limits.

    Raises:
        ConfigError: no such movement.
    """
    if movement not in MOVEMENTS:
        raise ConfigError(f'no movement "{movement}"; {nearest(movement, MOVEMENTS)}')
    poses = np.zeros((len(times), body.dof))
    for name, degrees in MOVEMENTS[movement](times).items():
        poses[:, body.index(name)] = np.radians(degrees)
    poses[:, body.index("torso_twist")] += np.radians(heading_deg)
    _lean_towards_heading(body, poses)
    poses = body.clamped(poses)
    across = [body.index("torso_x"), body.index("torso_y")]
    poses[:, across] = place
    if movement in _FEET_STAY:
        marks = [body.landmark_names.index(f"{side}_ankle") for side in ("left", "right")]
        feet = body.landmarks_in_world(poses)[:, marks, :2].mean(axis=1)
        poses[:, across] += feet[0] - feet
    poses[:, body.index("torso_z")] -= _lowest(body, poses)
    return poses


def _lean_towards_heading(body: BodyModel, poses: Array) -> None:
    """Turns the lean of the curves, given relative to the heading, into the model's lean in world axes.

    The twist is innermost in the model, so that its abduction and elevation name the axis in the world.
    """
    abduction, elevation = body.index("torso_abduction"), body.index("torso_elevation")
    heading = poses[:, body.index("torso_twist")]
    forward = np.sin(poses[:, elevation])
    left = np.sin(poses[:, abduction]) * np.cos(poses[:, elevation])
    up = np.cos(poses[:, abduction]) * np.cos(poses[:, elevation])
    poses[:, elevation] = np.arcsin(forward * np.cos(heading) - left * np.sin(heading))
    poses[:, abduction] = np.arctan2(forward * np.sin(heading) + left * np.cos(heading), up)


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
