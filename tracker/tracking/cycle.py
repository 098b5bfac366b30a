"""The tracking cycle of Gavrila & Davis 1996, figure 1: predict, synthesize, analyse, estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tracker.bodies.scene import Scene
from tracker.evidence import Evidence, Memory
from tracker.foundation.progress import Progress, silent
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.synthesis import Synthesis
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation import Estimation
from tracker.tracking.found_before import FoundBefore
from tracker.tracking.initialization import Backdrops, Initialization, Stages, no_backdrops
from tracker.tracking.loss import LossRule, Troubles, doubted, trusted_parts
from tracker.tracking.patience import Patience
from tracker.tracking.prediction import Prediction
from tracker.tracking.start import Start
from tracker.tracking.trajectory import History, Step


def _never() -> bool:
    return False


@dataclass(frozen=True)
class Cycle:
    """The components of the cycle and the clean plates they may use."""

    synthesis: Synthesis
    evidence: Evidence
    prediction: Prediction
    estimation: Estimation
    initialization: Initialization
    loss: LossRule
    plates: tuple[Plate | None, ...]
    backdrops: Backdrops = no_backdrops
    """What each view shows most of the time."""

    progress: Progress = silent
    leaving: Callable[[], bool] = _never
    """Whether what takes several frames is to be ended."""

    patience: Patience = field(default_factory=Patience)
    """What looking for the first pose has cost so far, here and in other cycles of the run."""

    nobody_before: int = 0
    """Number of the first frame in which somebody is looked for."""

    seeks: bool = True
    """Whether who is lost, or long in doubt, is looked for anew."""

    before: FoundBefore = field(default_factory=FoundBefore)
    """What is known of the recording."""

    def knowing(
        self, known: Mapping[int, Sequence[Estimate]], start: Start | None = None, believed: bool = False
    ) -> Cycle:
        """The cycle, which weighs what was found before in the first frames, and looks for nobody who was found there.

        Unless somebody is in doubt in the first frame.

        Args:
            known: frame -> what was found, in order.
            start: how persons were found, in the first frame or a later one.
            believed: however doubtful.
        """
        first, estimates = next(iter(known.items()))
        if any(one.lost or (not believed and doubted(one)) for one in estimates):
            return replace(self, before=replace(self.before, estimates=known))
        found = replace(start or Start(()), poses=tuple(one.q for one in estimates))
        return replace(self, before=FoundBefore(found, first, believed=True, estimates=known))

    @property
    def stages(self) -> Stages:
        """What the initialization may use: no plates that somebody stays before, who hardly stands out from them."""
        plates = tuple(None if one is None or one.stays else one for one in self.plates)
        return Stages(self.synthesis, self.evidence, self.estimation, plates, self.backdrops, self.progress)


@dataclass(frozen=True)
class State:
    """Everything that changes while tracking."""

    histories: tuple[History | None, ...]
    troubles: tuple[Troubles, ...]
    """For how long each person has been lost, or in doubt."""

    memory: Memory = None
    """What the evidence has learned."""

    @staticmethod
    def before(scene: Scene) -> State:
        """The state before the first frame."""
        n = len(scene.persons)
        return State((None,) * n, (Troubles(),) * n)

    @property
    def anybody_lost(self) -> bool:
        """Whether a person was lost in the frame before."""
        return any(one.lost for one in self.troubles)

    @property
    def nobody_found(self) -> bool:
        """Whether no person was found in any frame yet."""
        return all(history is None for history in self.histories)

    def after(self, sight: Sight, step: Step, evidence: Evidence, loss: LossRule) -> State:
        """The state one frame on."""
        histories, troubles = [], []
        for history, before, estimate in zip(self.histories, self.troubles, step.estimates, strict=True):
            if history is not None:
                history = history.after(step.frame.time_s, estimate)
            elif not estimate.lost:
                history = History.start(step.frame.time_s, estimate.q)
            histories.append(history)
            troubles.append(before.after(estimate, loss))
        pairs = zip(step.scene.persons, step.estimates, strict=True)
        trusted = np.concatenate([trusted_parts(person.body, estimate) for person, estimate in pairs], axis=1)
        memory = evidence.learned(self.memory, sight, step.scene, step.fitted, trusted)
        return State(tuple(histories), tuple(troubles), memory)
