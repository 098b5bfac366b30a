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
    """The components of the cycle and its clean plates."""

    synthesis: Synthesis
    evidence: Evidence
    prediction: Prediction
    estimation: Estimation
    initialization: Initialization
    loss: LossRule
    plates: tuple[Plate | None, ...]
    backdrops: Backdrops = no_backdrops
    """The most frequent colours of each view."""

    progress: Progress = silent
    leaving: Callable[[], bool] = _never
    """Whether to end work that takes several frames."""

    patience: Patience = field(default_factory=Patience)
    """Cost of the search for the first pose so far, here and in other cycles of the run."""

    nobody_before: int = 0
    """Number of the first frame to search."""

    seeks: bool = True
    """Whether the search begins anew for persons who are lost, or long in doubt."""

    before: FoundBefore = field(default_factory=FoundBefore)
    """Earlier knowledge of the recording."""

    def knowing(
        self, known: Mapping[int, Sequence[Estimate]], start: Start | None = None, believed: bool = False
    ) -> Cycle:
        """The cycle that uses earlier results of the first frames, and searches for no person found there.

        Except for a person in doubt in the first frame.

        Args:
            known: frame -> earlier results, in order.
            start: the start of the persons, in the first frame or a later one.
            believed: in spite of any doubt.
        """
        first, estimates = next(iter(known.items()))
        if any(one.lost or (not believed and doubted(one)) for one in estimates):
            return replace(self, before=replace(self.before, estimates=known))
        found = replace(start or Start(()), poses=tuple(one.q for one in estimates))
        return replace(self, before=FoundBefore(found, first, believed=True, estimates=known))

    @property
    def stages(self) -> Stages:
        """Tools of the initialization, without plates in which a person stays who hardly stands out from them."""
        plates = tuple(None if one is None or one.stays else one for one in self.plates)
        return Stages(self.synthesis, self.evidence, self.estimation, plates, self.backdrops, self.progress)


@dataclass(frozen=True)
class State:
    """The changing data of tracking."""

    histories: tuple[History | None, ...]
    troubles: tuple[Troubles, ...]
    """Time for which each person has been lost, or in doubt."""

    memory: Memory = None
    """Knowledge of the evidence."""

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
        """Whether no person was found in any frame so far."""
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
