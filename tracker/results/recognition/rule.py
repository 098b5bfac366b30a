"""When something counts as recognized."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rule:
    """When something counts as recognized."""

    limit: float = 0.7
    """Share of a known movement's extent that the angles to it must stay below. The extent is what the best of its own
    poses would leave if it stood still: below 0.7, the movement explains more than half of the variance."""

    least_limit_deg: float = 12.0
    """The limit of a movement of small extent: how differently two persons stand. The walks of one person are 4 degrees
    apart, of two persons 9 to 13."""

    evidence_s: float = 0.1
    """What a movement must be better than nothing, in seconds at no angle at all."""

    margin: float = 0.15
    """Share of a movement that may be missing at each end, where it does not repeat."""

    least_round: float = 0.5
    """Share of a round that a movement that repeats must last."""

    sizes: tuple[float, ...] = (0.75, 1.0, 1.35)
    """How far the limbs of a movement that repeats may swing about their mean direction, times that of the known
    performance."""

    depths: tuple[float, ...] = (0.5, 0.75, 1.0, 1.35)
    """How far the limbs may leave the posture in which a movement begins and ends, times that of the known performance:
    a shallow squat and a deep one."""

    tempos: tuple[float, ...] = (0.65, 1.0, 1.5)
    """How many times as fast as the known performance a movement that does not repeat may be, before warping halves or
    doubles that once more: it may take a third to three times as long."""
