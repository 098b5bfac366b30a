"""The estimate of one person's pose in one frame, with its evidence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array
from tracker.tracking.doubt import Because, Doubt


class Status(StrEnum):
    """Origin of a pose."""

    TRACKED = "tracked"
    """Found near the prediction."""

    BOOTSTRAPPED = "bootstrapped"
    """Found without a prediction, in the first frame."""

    RECOVERED = "recovered"
    """Found without a prediction, after a loss."""

    DOUBTFUL = "doubtful"
    """Found, but the images do not sufficiently support it: check it before use."""

    FILLED = "filled"
    """Not found, but between frames in which it was: a smoothing fills the short gap."""

    LOST = "lost"
    """Not found: the pose is the last prediction and not to be used."""


@dataclass(frozen=True)
class Estimate:
    """One person's pose with its distance and its uncertainty."""

    q: Array
    """(dof,) pose, rad and m."""

    covariance: Array
    """(dof, dof) covariance of q; NaN where the method gives none."""

    account: Account
    """Explanation of the images by the pose."""

    penalty_px: float
    """Penalty of the pose for collisions and unusual angles, px."""

    evaluations: int
    """Number of poses synthesized and compared."""

    search_s: float = 0.0
    """Time of the search, seconds; the rest of the estimation is refinement."""

    vain: Mapping[str, float] = field(default_factory=dict)
    """Groups of parameters that were searched in this frame in vain -> share still left over."""

    status: Status = Status.TRACKED
    """Origin of the pose."""

    doubts: tuple[Doubt, ...] = ()
    """Why the pose, or limbs of it, may be wrong: they decide what is doubtful, ambiguous and vague."""

    @property
    def doubtful(self) -> bool:
        """Whether the images do not sufficiently support the pose."""
        return any(not (doubt.limb or doubt.loses) for doubt in self.doubts)

    @property
    def ambiguous(self) -> tuple[str, ...]:
        """Parameter groups of limbs that may be elsewhere, for instance `left_arm`."""
        return tuple(dict.fromkeys(doubt.limb for doubt in self.doubts if doubt.limb))

    @property
    def vague(self) -> tuple[str, ...]:
        """Those of them that nothing contradicts, but whose place the images hardly show.

        Users see them, and they cause no search: with two cameras, where they are many, searches raised the frames with
        a joint off from 25 to 36.
        """
        sure = {doubt.limb for doubt in self.doubts if not doubt.vague}
        return tuple(limb for limb in self.ambiguous if limb not in sure)

    joint_sigmas_m: Array | None = None
    """(L,) standard deviations of the landmarks, root of the summed variances of x, y, z, including the uncertainty of
    the body; None if the covariance of the pose gives them alone."""

    @property
    def verdict(self) -> Status:
        """Status for users: the origin of the pose, unless it is doubtful."""
        return Status.DOUBTFUL if self.doubtful and not self.lost else self.status

    @property
    def reasons(self) -> tuple[Doubt, ...]:
        """The doubts for a line of text: of a lost person the reason of the loss, else all."""
        return self.doubts[:1] if self.lost else self.doubts

    def because(self, limb: str) -> set[Because]:
        """The reasons for which a limb is doubted."""
        return {doubt.because for doubt in self.doubts if doubt.limb == limb}

    @property
    def limbs_in_doubt(self) -> tuple[str, ...]:
        """The ambiguous limbs that something contradicts."""
        return tuple(limb for limb in self.ambiguous if limb not in self.vague)

    def doubting(self, doubts: Iterable[Doubt]) -> Estimate:
        """The estimate with further doubts, one a limb and reason; a lost person gets none."""
        if self.lost:
            return self
        told = {(doubt.limb, doubt.because) for doubt in self.doubts}
        return replace(self, doubts=(*self.doubts, *(one for one in doubts if (one.limb, one.because) not in told)))

    def losing(self, doubt: Doubt) -> Estimate:
        """The estimate as lost for a reason, which comes first; the doubts about its limbs go."""
        return replace(self, status=Status.LOST, doubts=(doubt, *(one for one in self.doubts if not one.limb)))

    @property
    def distance_px(self) -> float:
        """The number by which searches rank poses: distance and penalty, px."""
        return self.account.distance_px + self.penalty_px

    @property
    def lost(self) -> bool:
        """Whether the pose is not to be used."""
        return self.status is Status.LOST
