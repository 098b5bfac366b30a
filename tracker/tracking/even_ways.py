"""Even ways of limbs from one frame to a later one, where what was found between them is rough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tracker.arrays import Array, Mask
from tracker.body import BodyModel
from tracker.estimate import Status
from tracker.limbs import apart_m
from tracker.trajectory import Step

_SPANS = 2, 3, 4, 5, 6, 8, 10, 12, 16
"""Frames from the last pose that stays to the next one: limbs are wrong for that long between two searches."""

_PX_PER_M2 = 250.0
"""What roughness costs, px of distance in one frame for a square metre of squared second differences of places, the
limb's joints averaged: what jumps by 15 cm from one frame to the next, which is 0.045, must be worth 11 px."""

LEAST_PX = 3.0
"""What a bridge must gain at least, px."""

_SMOOTHER = 4.0
"""How much less rough it must be, a factor: a fist that strikes is rough, and so is each even piece of its way (1.6 in
T-Punch-light, whose arms were right and were moved by 8 cm); an arm that jumps behind the trunk and back is not (9)."""


@dataclass(frozen=True)
class Bridge:
    """A limb on its way from one frame to another, as if it moved evenly."""

    person: int
    group: str
    first: int
    """Number of the first step that is bridged."""

    poses: Array
    """(n, dof) one a step."""

    away_m: Array
    """(n,) how far a joint of the limb is from where it was found, at most."""

    smoother_px: float
    """What its smoothness may cost, px."""

    @property
    def steps(self) -> range:
        """Numbers of the steps."""
        return range(self.first, self.first + len(self.poses))


def candidates(steps: Sequence[Step], k: int) -> list[Bridge]:
    """Ways of the limbs of person k that are smoother than those found."""
    body = steps[0].scene.persons[k].body
    way = _Way(
        k,
        body,
        np.array([step.frame.time_s for step in steps]),
        np.array([step.estimates[k].q for step in steps]),
        np.array([step.estimates[k].status is Status.TRACKED for step in steps]),
        apart_m(body),
    )
    ends = [(a, a + span) for span in _SPANS for a in range(1, len(steps) - span - 1)]
    tried = (way.bridged(group, a, b) for group in body.marked_limbs for a, b in ends)
    return [bridge for bridge in tried if bridge is not None]


@dataclass(frozen=True)
class _Way:
    """How a person has moved, as found."""

    person: int
    body: BodyModel
    times_s: Array
    """(T,)"""

    poses: Array
    """(T, dof)"""

    tracked: Mask
    """(T,) whether a pose came from the one before."""

    least_m: float
    """What a joint must have been elsewhere by, metres."""

    @cached_property
    def places(self) -> Array:
        """(T, L, 3) landmarks."""
        found: Array = self.body.landmarks_in_world(self.poses)
        return found

    def bridged(self, group: str, a: int, b: int) -> Bridge | None:
        """A limb led evenly from step a to step b; None where it was not elsewhere meanwhile, or moved as limbs do."""
        marks, columns = self.body.landmarks_of(group), self.body.group(group)
        # a step more at each end: what is even in between may begin or end with a jerk
        found = self.places[a - 1 : b + 2, marks]
        rough = _rough(found)
        if not self.tracked[a : b + 1].all() or _PX_PER_M2 * rough < LEAST_PX:
            return None
        even = self.poses[a + 1 : b].copy()
        shares = ((self.times_s[a + 1 : b] - self.times_s[a]) / (self.times_s[b] - self.times_s[a]))[:, None]
        even[:, columns] = (1 - shares) * self.poses[a, columns] + shares * self.poses[b, columns]
        moved = found.copy()
        moved[2:-2] = self.body.landmarks_in_world(even)[:, marks]
        away_m = np.linalg.norm(moved - found, axis=2).max(axis=1)[2:-2]
        smooth = _rough(moved)
        smoother_px = _PX_PER_M2 * (rough - smooth)
        if away_m.max() <= self.least_m or smoother_px <= LEAST_PX or rough <= _SMOOTHER * smooth:
            return None
        return Bridge(self.person, group, a + 1, even, away_m, smoother_px)


def _rough(places: Array) -> float:
    """Squared second differences of places (T, L, 3), summed over time, averaged over landmarks, m^2."""
    return float((np.diff(places, 2, axis=0) ** 2).sum(axis=(0, 2)).mean())
