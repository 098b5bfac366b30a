"""Results of a run: one Step a frame, and the history for predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import opposite_deg
from tracker.evidence.measures.account import LONG_FRAMES
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.tracking.budget import Tries
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.start import FACES_RIGHTLY, Start, confidence


@dataclass(frozen=True)
class Step:
    """One frame: the estimates, and information about them."""

    frame: Frame
    scene: Scene
    """All persons at their estimated poses."""

    estimates: tuple[Estimate, ...]
    """One a person."""

    fitted: Contours
    """Contours of the estimated scene, B = 1."""

    seconds: dict[str, float] = field(default_factory=dict)
    """Stage name -> seconds spent in it."""

    overlap: Array | None = None
    """(V,) intersection over union of model and foreground silhouettes; NaN where unknown."""

    model_px: Array | None = None
    """(V,) pixels that the persons cover; None without plates, or with a person lost."""

    untrusted: Mapping[int, str] = field(default_factory=dict)
    """View -> why its foreground was not used."""

    strangers: bool = False
    """Whether a stranger was beside the persons, and was taken for a thing that hides them."""

    start: Start | None = None
    """Evidence of the bootstrapping, in the frame in which it happened."""

    why_unfound: str = ""
    """Why no person was found, if the search was for persons without an earlier frame."""

    ready: int = 0
    """Number of following steps that are ready."""

    provisional: bool = False
    """Whether an interruption prevented a second pass: a resumed run tracks it again."""

    as_tracked: tuple[Array, ...] = ()
    """For each person the pose (dof,) with which tracking goes on, if `estimates` were brought to another moment; empty
    if they are it."""

    told_confidence: tuple[float, ...] = ()
    """Its `start_confidence`, if the start itself is unknown: a journal does not keep it."""

    told_unfaced: bool = False
    """The same of `may_face_the_other_way`."""

    @property
    def start_confidence(self) -> tuple[float, ...]:
        """For each person the share of such starts that are right, see `start.confidence`; empty without one.

        A given pose that fits less well than the same turned round stays unsure, however well it was tracked: a
        standing person looks the same from behind.
        """
        if self.start is None:
            return self.told_confidence
        turned, pairs = self.start.turned_round, zip(self.start.told_sureness, self.estimates, strict=False)
        faces = FACES_RIGHTLY if self.may_face_the_other_way else 1.0
        return tuple(sure if k in turned else faces * confidence(sure, one) for k, (sure, one) in enumerate(pairs))

    @property
    def may_face_the_other_way(self) -> bool:
        """Whether persons were found by two cameras alone that face each other: nothing shows who faces where."""
        if self.start is None:
            return self.told_unfaced
        told = self.start.given or self.start.by_keypoints
        return not told and opposite_deg(self.scene.rig) > 0


@dataclass(frozen=True)
class Replay:
    """One frame of an interrupted run, from its journal."""

    index: int
    time_s: float
    estimates: tuple[Estimate, ...]
    seconds: dict[str, float]
    overlap: Array | None
    """(V,) as in `Step`."""

    untrusted: Mapping[int, str] = field(default_factory=dict)
    """As in `Step`."""

    strangers: bool = False
    """As in `Step`."""

    start_confidence: tuple[float, ...] = ()
    """As in `Step`."""

    unfaced: bool = False
    """`Step.may_face_the_other_way`."""

    as_tracked: tuple[Array, ...] = ()
    """As in `Step`."""

    @property
    def tracked(self) -> tuple[Estimate, ...]:
        """The estimates with which tracking goes on."""
        pairs = zip(self.estimates, self.as_tracked, strict=bool(self.as_tracked))
        return tuple(replace(one, q=q) for one, q in pairs) if self.as_tracked else self.estimates


_FORGOTTEN_AFTER = 32
"""Frames without a search after which searches in vain are forgotten: twice the longest wait."""

KEPT = 16
"""Largest number of frames in a history."""


@dataclass(frozen=True)
class History:
    """Poses of one person in the frames without a loss, oldest first, and searches in vain."""

    times: Array
    """(T,) seconds."""

    poses: Array
    """(T, dof) rad and m."""

    tries: Mapping[str, Tries] = field(default_factory=dict)
    """Group of parameters -> searches in vain."""

    unseen: Integers | None = None
    """(V, P) number of consecutive frames, up to the last one, in which a view has not shown a part that others do;
    None for no part."""

    @property
    def hidden(self) -> Mask | None:
        """(V, P) parts that something hid from a view in the last frame; None for none."""
        hidden = None if self.unseen is None else self.unseen > LONG_FRAMES
        return None if hidden is None or not hidden.any() else hidden

    @staticmethod
    def start(time_s: float, q: Array) -> History:
        """The history of a person just found."""
        return History(frozen([time_s]), frozen(q[None]))

    def after(self, time_s: float, estimate: Estimate, window: int = KEPT) -> History:
        """The history one frame on: extended, begun anew after a recovery, or unchanged by a loss."""
        if estimate.status is Status.LOST:
            return self
        if estimate.status is not Status.TRACKED:
            return History.start(time_s, estimate.q)
        times = np.append(self.times, time_s)[-window:]
        poses = np.concatenate([self.poses, estimate.q[None]])[-window:]
        tries = {g: so_far.after(False) for g, so_far in self.tries.items() if so_far.frames < _FORGOTTEN_AFTER}
        tries |= {g: self.tries.get(g, Tries()).after(True, share) for g, share in estimate.vain.items()}
        return History(frozen(times), frozen(poses), tries, _counted(self.unseen, estimate.account.not_shown))


def _counted(unseen: Integers | None, not_shown: Mask | None) -> Integers | None:
    if not_shown is None:
        return None
    return frozen(not_shown * (1 if unseen is None else unseen + 1), np.int64)
