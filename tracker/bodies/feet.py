"""The soles of bodies, and their places of rest on the floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoints import meant, plain_name
from tracker.foundation.arrays import Array, Integers, Mask

_FEET = {"ankle", "heel", "toe", "foot", "paw", "hoof"}
"""Words in the names of points on feet."""

_N_ETA, _N_OMEGA = 13, 24
"""Points on a foot's surface: its lowest point is known to a millimetre or two."""

_RESTS_M_PER_S = 0.35
"""Speed below which a foot rests: in walking, feet swing at 2 to 4 m/s."""

_WHILE_S = 0.12
"""Time over which the speed is measured: detectors' keypoints jump by centimetres from one frame to the next."""

_RESTS_S = 0.2
"""Least time of rest: a jumping person seems to rest for 0.19 s at the top."""

_LOWEST_M = 0.06
"""Height above the lowest of a frame's points, up to which others may be on the floor: one foot may be held up."""


def sole_parts(body: BodyModel) -> Integers:
    """(F,) parts of the body that are feet; empty for a body whose legs do not move, such as an upper one."""
    marks = (mark for mark in (*body.landmarks, *body.keypoints) if mark.parameter not in body.root.columns)
    ends = {mark.parameter for mark in marks if _FEET & set(plain_name(mark.name).split("_"))}
    return np.array([p for p, end in enumerate(body.part_parameters) if int(end) in ends], dtype=np.int64)


def soles(body: BodyModel, poses: Array, up: Array) -> tuple[Array, Array]:
    """The lowest point of each foot, unless another part of the body is lower, and the foot's middle.

    The middle does not jump from heel to toe.

    Args:
        body: with feet.
        poses: (T, dof).
        up: (3,) unit vector.

    Returns:
        (T, F, 3) points, NaN of feet that are higher than the body, and (T, F, 3) middles, metres.
    """
    placed = body.world_from_part(poses)
    lowest = np.stack([_lowest(_surface(body, p), placed[:, p], up) for p in range(len(body.parts))], axis=1)
    heights, feet = lowest @ up, sole_parts(body)
    lowest[heights > heights.min(axis=1, keepdims=True) + _LOWEST_M] = np.nan
    return lowest[:, feet], placed[:, feet][..., :3, 3]


def _lowest(surface: Array, placed: Array, up: Array) -> Array:
    """(T, 3) the lowest of a part's points (N, 3), placed (T, 4, 4)."""
    points = surface @ placed[:, :3, :3].transpose(0, 2, 1) + placed[:, None, :3, 3]
    found: Array = points[np.arange(len(points)), np.argmin(points @ up, axis=1)]
    return found


def heights_over_sole(names: Sequence[str], body: BodyModel) -> Array:
    """(K,) heights of the keypoints of feet above the sole of a standing body, metres; NaN for others."""
    heights = np.full(len(names), np.nan)
    parts = sole_parts(body)
    if not len(parts):
        return heights
    placed = body.world_from_part(body.rest()[None])[0]
    sole = min(float((_surface(body, int(p)) @ placed[p, 2, :3] + placed[p, 2, 3]).min()) for p in parts)
    known = meant(tuple(names), body)
    there = body.points_in_world(body.rest()[None], known.points, known.ends)[0]
    for row, place in zip(known.rows, there, strict=True):
        if _FEET & set(plain_name(names[row]).split("_")):
            heights[row] = place[2] - sole
    return heights


def footfalls(points: Array, middles: Array, times_s: Array, up: Array) -> Array:
    """Places where feet rest on the floor: one point for each rest.

    Args:
        points: (T, F, 3) of the soles, NaN where unknown, metres.
        middles: (T, F, 3) of the feet, whose movement decides.
        times_s: (T,) seconds.
        up: (3,) unit vector.

    Returns:
        (N, 3) metres.
    """
    resting = _rests(middles, times_s) & _is_low(points @ up)
    found = []
    for foot in range(points.shape[1]):
        edges = np.flatnonzero(np.diff(np.r_[0, resting[:, foot].astype(int), 0]))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            if times_s[end - 1] - times_s[begin] >= _RESTS_S:
                found.append(np.median(points[begin:end, foot], axis=0))
    return np.array(found).reshape(-1, 3)


def _rests(middles: Array, times_s: Array) -> Mask:
    """(T, F) whether feet move little in a while; there is a frame at its begin and one at its end."""
    still = np.zeros(middles.shape[:2], dtype=bool)
    if len(times_s) < 2:
        return still
    lag = max(1, round(_WHILE_S / float(np.median(np.diff(times_s)))))
    for t in range(len(times_s) - lag):
        with np.errstate(invalid="ignore"):
            moved_m = np.linalg.norm(middles[t + lag] - middles[t], axis=1)
        still[t : t + lag + 1] |= moved_m < _RESTS_M_PER_S * (times_s[t + lag] - times_s[t])
    return still


def _is_low(heights: Array) -> Mask:
    """(T, F) whether points are about as low as the lowest of the frame."""
    lowest = np.where(np.isfinite(heights), heights, np.inf).min(axis=1, keepdims=True)
    low: Mask = heights < lowest + _LOWEST_M
    return low


def _surface(body: BodyModel, part: int) -> Array:
    """(N, 3) points of a part's surface in its own frame, metres."""
    eta = np.linspace(-np.pi / 2, np.pi / 2, _N_ETA)[:, None]
    omega = np.linspace(-np.pi, np.pi, _N_OMEGA, endpoint=False)[None]
    return body.parts[part].shape.surface(eta, omega)[0].reshape(-1, 3)
