"""Judges an estimate: lost, doubtful, with ambiguous limbs; and decides for whom the search begins anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Mask
from tracker.foundation.configuration.components import component
from tracker.tracking.budget import Tries
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.limb_probabilities import limb_probabilities, limbs_left_over

# In so many times of `restart_every` somebody who is lost is looked for once at least: he may come back.
_SELDOM = 8
# Growth of the wait for a doubtful person after each search in vain: the person is still in sight, and looks the same
# again. See docs/lab/limits_and_vain_searches.md.
_DEARER = 5


@component
class LossRule:
    """Limits for lost, doubtful and ambiguous, and the rules of the searches."""

    lost_below: float = pydantic.Field(default=0.4, ge=0, le=1)
    """Share of the visible contour on scene edges below which a person is lost."""

    least_views: int = pydantic.Field(default=2, ge=0)
    """Views that must show a person, or may show one: with fewer a person is lost, and a limb inside fewer images
    ambiguous; all views of a smaller rig."""

    doubtful_above: float = pydantic.Field(default=0.25, ge=0)
    """Left-over length of model and images, as a share of the model's contour, above which a frame is doubtful. In
    twelve frames of four recordings the right pose leaves over 0.04 to 0.22, and the same person turned round and
    refined 0.26 to 1.16. With an acquired model 0.12 may do: docs/lab/probability_of_limbs.md."""

    ambiguous_above: float = pydantic.Field(default=0.3, ge=0)
    """The same for a limb, which is then ambiguous: the least value, for edges and colours, that no right limb reaches
    on four recordings. On five others it finds 41 of 75 frames with a limb 150 mm off, and doubts 12 of 348 without."""

    improbable_below: float = pydantic.Field(default=0.5, ge=0, le=1)
    """Probability that a limb is right below which it is ambiguous; 0 for no such doubt. See
    `tracker.tracking.limb_probabilities` and `Estimate.vague`."""

    # See docs/lab/elsewhere.md.
    elsewhere_px: float = pydantic.Field(default=0.2, ge=0)
    """Extra cost up to which another place makes a limb ambiguous of which only one view shows a part, px; 0 for no
    such test. In four recordings by two cameras 24 of 26 frames with a joint 150 mm off are flagged, 6 without it, and
    56 of 208 others, 33 without. 0.15 px would leave out a third of the limbs that it names, right or wrong. In five
    recordings by three and four cameras it names 3 limbs of 1680. See `tracker.tracking.single_view`."""

    restart_every: int = pydantic.Field(default=3, ge=1)
    """Wait of a lost person's search, frames: it begins anew in the frame of the loss, so many frames later, and then
    after twice as many each time, up to eight times as many. For a person who has left the room for long every search
    is in vain, and beside another one's shadow it takes seconds. A person lost again, and in doubt all the while, waits
    as long. A second pass finds persons who come back from the first frame on."""

    start_within: int = pydantic.Field(default=25, ge=1)
    """Frames, from the first one with a person on, in which the first initialization must succeed."""

    start_within_s: float = pydantic.Field(default=600.0, gt=0)
    """Its processor time in all of them, seconds: then the run ends, with the reason why no person was found.
    Successful starts of six recordings without plates take 9 to 120 s."""

    rehearse: int = pydantic.Field(default=10, ge=0)
    """Most frames into which the start poses of an uncertain person are tracked before one is chosen, at least 0.03 s
    apart. 0 takes the first pose as it is found, and does not weigh it against others."""

    sure: float = pydantic.Field(default=0.8, ge=0, le=1)
    """Probability that a start pose is right from which on it is not followed, see `tracker.tracking.rehearsal`."""

    look_ahead_s: tuple[pydantic.NonNegativeFloat, ...] = (0.5, 1.0, 2.0)
    """If a start is more likely wrong than right: delays of later frames in which it may be easier, seconds. The
    run tracks the frames before back from the surest. It needs a recording: a live run keeps its first start."""

    # See docs/lab/later_starts.md.
    look_on_s: tuple[pydantic.NonNegativeFloat, ...] = (2.5, 4.0, 6.0)
    """Further delays while all starts found are more likely wrong than right: without plates those of push-ups in
    frames 8, 21, 33 and 58 are 0.20 sure at most, and 85 to 361 mm off, that in frame 72 0.94 (35 mm)."""

    # See docs/lab/limits_and_vain_searches.md.
    again_after: int = pydantic.Field(default=5, ge=1)
    """Consecutive frames in doubt after which the search begins anew for a person who is doubtful, or has several limbs
    in doubt; if the doubt stays, again after as many, and then after five times as many each time. Without plates each
    search takes 15 s, for one of two persons 35 to 75; for bodies that no model fits, or that the views hardly show, it
    is in vain. It finds legs exchanged for 40 frames at once; without plates, arms and legs in the tenth frame of
    doubt."""


def judged(body: BodyModel, estimate: Estimate, loss: LossRule, found: Status = Status.TRACKED) -> Estimate:
    """The estimate with its status and all doubts."""
    account = estimate.account
    doubts = [
        *_above({"": account.left_over}, Because.LEFT_OVER, loss.doubtful_above),
        *_above(limbs_left_over(body, account), Because.LEFT_OVER, loss.ambiguous_above),
    ]
    in_doubt, least = {doubt.limb for doubt in doubts}, loss.improbable_below
    if "" not in in_doubt:  # otherwise all limbs would be named for a fault of the whole
        told = limb_probabilities(body, estimate).items()
        doubts += [Doubt(limb, Because.IMPROBABLE, p, least) for limb, p in told if p < least and limb not in in_doubt]
    found_again = replace(estimate, status=found, doubts=tuple(doubts))
    if account.explained < loss.lost_below:
        return found_again.losing(Doubt("", Because.UNEXPLAINED, account.explained, loss.lost_below))
    return found_again


def _above(values: Mapping[str, float], because: Because, limit: float) -> list[Doubt]:
    """Doubts about limbs with a value above a limit; the person as a whole has the empty name."""
    return [Doubt(limb, because, value, limit) for limb, value in values.items() if value > limit]


def trusted_parts(body: BodyModel, estimate: Estimate) -> Mask:
    """(V, P) parts of a person that are right, as far as known, and that the view shows."""
    hidden, n_views = estimate.account.hidden, len(estimate.account.per_view_px)
    sure = not estimate.lost and not estimate.doubtful
    trusted: Mask = np.full((n_views, len(body.parts)), sure) if hidden is None else sure & ~hidden
    for group in estimate.limbs_in_doubt:
        trusted[:, body.parts_of(group)] = False
    return trusted


@dataclass(frozen=True)
class Troubles:
    """Time for which a person has been lost or in doubt, before this frame."""

    lost: int = 0
    """Consecutive frames."""

    tries: Tries = field(default_factory=Tries)
    """Searches since the person was last there without doubt."""

    again: bool = False
    """Whether the person was lost before, and has not been there without doubt since."""

    def after(self, estimate: Estimate, loss: LossRule) -> Troubles:
        """One frame on."""
        if not (estimate.lost or doubted(estimate)):
            return Troubles()
        searched = estimate.status is Status.RECOVERED or sought_anew(estimate, self, loss)
        again = self.again or (self.lost > 0 and not estimate.lost)
        return Troubles(self.lost + 1 if estimate.lost else 0, self.tries.after(searched), again)

    @staticmethod
    def of_lost(n_frames: int, estimate: Estimate, loss: LossRule) -> Troubles:
        """Those of a person lost for as long as an estimate is."""
        troubles = Troubles()
        for _ in range(n_frames):
            troubles = troubles.after(estimate, loss)
        return troubles


def sought_anew(estimate: Estimate, before: Troubles, loss: LossRule) -> bool:
    """Whether the search for a person begins anew in this frame.

    It does for a lost person, even if the pose of the loss explains the images again, because limbs have moved
    meanwhile. For a
    single limb in doubt it would be expensive: of one pass, without plates, a half. If a person is lost again and again
    without being free of doubt in between, as when the new pose is wrong, the search is as rare as for one lost
    throughout: without plates it takes up to 70 s.

    Args:
        estimate: in this frame.
        before: the person's troubles so far.
        loss: the rule.
    """
    if estimate.lost:
        return _is_due(before, loss)
    if before.lost:
        return not before.again
    as_a_whole = estimate.doubtful or len(estimate.limbs_in_doubt) > 1
    return as_a_whole and before.tries.due(loss.again_after, loss.again_after - 1, _DEARER)


def is_out_of_sight(before: Troubles, loss: LossRule) -> bool:
    """Whether a person has been lost for longer than a moment, and is not searched anew in this frame either."""
    return before.lost > loss.restart_every and not _is_due(before, loss)


def _is_due(before: Troubles, loss: LossRule) -> bool:
    return before.tries.due(loss.restart_every, most=_SELDOM * loss.restart_every)


def doubted(estimate: Estimate) -> bool:
    """Whether a pose that is not lost, or one of its limbs, may be wrong."""
    return not estimate.lost and (estimate.doubtful or bool(estimate.limbs_in_doubt))
