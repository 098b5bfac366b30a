"""The estimate of one person's pose in one frame, with its evidence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array
from tracker.tracking.doubt import Because, Doubt


class Status(StrEnum):
    """How a pose came about."""

    TRACKED = "tracked"
    """Found near the prediction."""

    BOOTSTRAPPED = "bootstrapped"
    """Found without a prediction, in the first frame."""

    RECOVERED = "recovered"
    """Found without a prediction, after a loss."""

    DOUBTFUL = "doubtful"
    """Found, but the images do not support it as they should: to be looked at before it is used."""

    FILLED = "filled"
    """Not found, but between frames in which it was: what a smoothing puts into a short gap."""

    LOST = "lost"
    """Not found: the pose is the last prediction and not to be used."""


@dataclass(frozen=True)
class Estimate:
    """One person's pose with the distance it leaves and its uncertainty."""

    q: Array
    """(dof,) pose, rad and m."""

    covariance: Array
    """(dof, dof) covariance of q; NaN where the method gives none."""

    account: Account
    """How well the pose explains the images."""

    penalty_px: float
    """What the pose costs because the body runs through itself or is seldom like that, px."""

    evaluations: int
    """Poses synthesized and compared."""

    search_s: float = 0.0
    """Time spent searching, seconds; the rest of the estimation is refinement."""

    vain: Mapping[str, float] = field(default_factory=dict)
    """Groups of parameters that were searched in this frame in vain -> share that is still left over."""

    status: Status = Status.TRACKED
    """How the pose came about."""

    doubts: tuple[Doubt, ...] = ()
    """Why the pose, or limbs of it, may be wrong: what is doubtful, ambiguous and vague follows from that."""

    @property
    def doubtful(self) -> bool:
        """Whether the images do not support the pose as they should."""
        return any(not (doubt.limb or doubt.loses) for doubt in self.doubts)

    @property
    def ambiguous(self) -> tuple[str, ...]:
        """Parameter groups of limbs that may be elsewhere, for instance `left_arm`."""
        return tuple(dict.fromkeys(doubt.limb for doubt in self.doubts if doubt.limb))

    @property
    def vague(self) -> tuple[str, ...]:
        """Those of them that nothing speaks against, but of whose place the images tell little.

        They are told to users and no cause to search: with two cameras, where they are many, searches made of 25 frames
        with a joint off 36.
        """
        sure = {doubt.limb for doubt in self.doubts if not doubt.vague}
        return tuple(limb for limb in self.ambiguous if limb not in sure)

    joint_sigmas_m: Array | None = None
    """(L,) standard deviations of the landmarks, root of the summed variances of x, y, z, with what is not known of the
    body; None where they follow from the covariance of the pose alone."""

    @property
    def verdict(self) -> Status:
        """What users are told: how the pose came about, unless it is doubtful."""
        return Status.DOUBTFUL if self.doubtful and not self.lost else self.status

    @property
    def reasons(self) -> tuple[Doubt, ...]:
        """The doubts that users are told in a line: of who is lost what has lost him, else all."""
        return self.doubts[:1] if self.lost else self.doubts

    def because(self, limb: str) -> set[Because]:
        """The reasons for which a limb is doubted."""
        return {doubt.because for doubt in self.doubts if doubt.limb == limb}

    @property
    def limbs_in_doubt(self) -> tuple[str, ...]:
        """The ambiguous limbs that something speaks against."""
        return tuple(limb for limb in self.ambiguous if limb not in self.vague)

    def doubting(self, doubts: Iterable[Doubt]) -> Estimate:
        """The same with further doubts, one a limb and reason; nothing is added of who is lost."""
        if self.lost:
            return self
        told = {(doubt.limb, doubt.because) for doubt in self.doubts}
        return replace(self, doubts=(*self.doubts, *(one for one in doubts if (one.limb, one.because) not in told)))

    def losing(self, doubt: Doubt) -> Estimate:
        """The same, not to be used for a reason, which is the first to be told; of its limbs nothing is told."""
        return replace(self, status=Status.LOST, doubts=(doubt, *(one for one in self.doubts if not one.limb)))

    @property
    def distance_px(self) -> float:
        """The number that searches rank poses by: distance and penalty, px."""
        return self.account.distance_px + self.penalty_px

    @property
    def lost(self) -> bool:
        """Whether the pose is not to be used."""
        return self.status is Status.LOST
