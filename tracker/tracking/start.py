"""Start poses of all persons, with the evidence for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tracker.foundation.arrays import Array, Mask
from tracker.tracking.estimate import Estimate

RATHER_RIGHT = 0.5
"""Confidence below which a start is more likely wrong than right, see `confidence`."""

# See docs/lab/facing.md.
FACES_RIGHTLY = 0.8
"""How often persons face as they do who were found by two cameras that face each other: in 11 of 14 starts."""


@dataclass(frozen=True)
class AxisFit:
    """Bootstrapping in one view, for the picture like the paper's figure 5."""

    foreground: Mask
    """(H, W) thresholded difference to the background."""

    axes: tuple[Array, ...]
    """Successive major axes, each (2, 2): its two end points, px."""


@dataclass(frozen=True)
class Hypothesis:
    """A start pose that was refined and ranked."""

    q: Array
    """(dof,) rad and m."""

    distance_px: float
    """Its similarity distance, px."""

    explained: float
    """Share of the person's visible contour that lies on scene edges, 0 to 1."""

    left_over: float
    """Contour of the model without a scene edge, and of the scene without the model, over the model's contour.

    Hypotheses are ranked by it. Edges that no person makes dominate the distance itself: in 6 of 28 starts on
    recordings it preferred a person turned round, whose limbs reach for shadows and furniture, this in one.
    """

    turn_deg: float
    """Direction faced: the turn about the body's axis, degrees."""

    limbs_left_over: Mapping[str, float] = field(default_factory=dict)
    """Limb -> its left-over share, see `tracker.tracking.limb_probabilities.left_over_of`."""

    given: bool = False
    """Whether it was given, not found: it stays, whatever the others are."""

    probability: float = 1.0
    """Probability that it is the right one of all, and right at all, once it was weighed, see `tracking.rehearsal`."""


@dataclass(frozen=True)
class Start:
    """Start poses of all persons."""

    poses: tuple[Array, ...]
    """(dof,) for each person, rad and m."""

    evidence: tuple[tuple[AxisFit | None, ...], ...] = ()
    """For each person and view; empty if the poses were given."""

    hypotheses: tuple[tuple[Hypothesis, ...], ...] = ()
    """For each person the refined hypotheses, the best one first; of a given pose, itself and turned round."""

    sureness: tuple[float, ...] = ()
    """For each person the probability that the pose is right, see `tracking.rehearsal`; empty before poses are weighed,
    and where nothing can make them less sure: keypoints show sides that outlines do not."""

    by_keypoints: bool = False
    """Whether 2-D keypoints gave the poses."""

    def of(self, order: Sequence[int]) -> Start:
        """The start of the same persons in another order: for each the place that it has here."""
        return Start(
            tuple(self.poses[k] for k in order),
            tuple(self.evidence[k] for k in order if self.evidence),
            tuple(self.hypotheses[k] for k in order if self.hypotheses),
            tuple(self.sureness[k] for k in order if self.sureness),
            self.by_keypoints,
        )

    @property
    def given(self) -> bool:
        """Whether the poses were given."""
        return any(one.given for ranking in self.hypotheses for one in ranking)

    @property
    def turned_round(self) -> dict[int, float]:
        """Persons whose given pose is less probable than the same turned round -> its probability."""
        return {
            k: one.probability
            for k, ranking in enumerate(self.hypotheses)
            for one in ranking
            if one.given and one is not ranking[0]
        }

    @property
    def told_sureness(self) -> tuple[float, ...]:
        """For each person 0 to 1; `confidence` derives from it the share of such starts that are right.

        It is `sureness`; if that is empty, for given poses their explained share, and 0 if they fit clearly better
        turned round. Empty without images.
        """
        given = [one for ranking in self.hypotheses for one in ranking if one.given]
        if self.sureness or len(given) < len(self.hypotheses):
            return self.sureness
        return tuple(0.0 if k in self.turned_round else one.explained for k, one in enumerate(given))

    @property
    def least_sureness(self) -> float:
        """The least sureness of all persons; 1 if nothing else was tried."""
        return min(self.sureness, default=1.0)


def confidence(sure: float, estimate: Estimate) -> float:
    """Share of such starts that are right, 0 to 1: by their sureness, and by the tracking of the frame.

    Sureness only knows the other hypotheses: without plates starts of 0.03 and 0.3 were right once they had been
    tracked on and back. Of 276 starts, with plates and without, a joint was more than 150 mm off in 11 of the 14 below
    0.5, in 8 of 35 up to 0.9 and in 6 of 227 above; there none was 100 mm off on average (6, 3 of the others).

    Args:
        sure: see `Start.sureness`.
        estimate: of the start's frame, after all around it was tracked.
    """
    if estimate.lost or estimate.doubtful or len(estimate.ambiguous) > 1:
        return RATHER_RIGHT * sure
    return RATHER_RIGHT + (0.3 if estimate.ambiguous else 0.5) * sure
