"""A simulated recording tracked from a known start, and its errors against the exact truth."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import Evidence
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import InitializationError
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.plate import Plate
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.initialization import Initialization, Stages
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.loss import LossRule
from tracker.tracking.prediction.polynomial import PolynomialPrediction
from tracker.tracking.sequence import track
from tracker.tracking.start import Start

TRACKED_MM = 100.0
"""Mean joint error above which a pose is wrong."""

LIMB_MM = 150.0
"""Error of a single joint above which a limb is off."""


class KnownStart:
    """Starts frame 0 at a pose; a person lost later is looked for as `again` does, or not at all."""

    def __init__(self, q: Array, again: Initialization | None) -> None:
        self._q, self._again = q, again

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Nothing can be wrong."""
        return "a known pose"

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """See `tracker.tracking.initialization.Initialization.start`."""
        if frame.index == 0:
            return Start((self._q,))
        if self._again is None:
            raise InitializationError("only the first frame has a known start")
        return self._again.start(frame, scene, stages)


def default_cycle(start: Array, plates: tuple[Plate | None, ...], threads: int = 2, *, recovers: bool = True) -> Cycle:
    """The components as they come, started at a known pose (dof,)."""
    return Cycle(
        synthesis=CpuSynthesis(),
        evidence=_default_evidence(ContourAnalysis(threads=threads, ahead_px=40.0 if threads > 1 else 0.0)),
        prediction=PolynomialPrediction(),
        estimation=HybridEstimation(),
        initialization=KnownStart(start, PcaInitialization() if recovers else None),
        loss=LossRule(),
        plates=plates,
    )


def _default_evidence(analysis: ContourAnalysis) -> Evidence:
    """The evidence of a run without a section on it, with edges found by an analysis."""

    def with_edges(evidence: Evidence) -> Evidence:
        assert isinstance(evidence, TogetherEvidence)
        changed = (replace(one, analysis=analysis) if isinstance(one, ContourEvidence) else one for one in evidence.of)
        return replace(evidence, of=tuple(changed))

    usual = AutoEvidence()
    return replace(usual, with_plates=with_edges(usual.with_plates), without=with_edges(usual.without))


@dataclass(frozen=True)
class Outcome:
    """Tracked frames beside the truth."""

    body: BodyModel
    estimates: tuple[Estimate, ...]
    """One a frame."""

    truth: Array
    """(T, dof) rad and m."""

    stages: tuple[dict[str, float], ...]
    """Seconds spent in each stage of each frame, as the tracking tells."""

    wall_s: Array
    """(T,) wall time of each frame, with what is not done ahead of decoding or rendering."""

    cpu_s: Array
    """(T,) processor time of each frame, of all threads and with decoding or rendering."""

    @property
    def lost(self) -> Mask:
        """(T,) frames flagged as lost."""
        return np.array([estimate.lost for estimate in self.estimates])

    @property
    def poses(self) -> Array:
        """(T, dof) estimated."""
        return np.array([estimate.q for estimate in self.estimates])

    @property
    def sigmas(self) -> Array:
        """(T, dof) predicted standard deviations."""
        deviations: Array = np.sqrt([np.diag(estimate.covariance) for estimate in self.estimates])
        return deviations

    @property
    def joints_mm(self) -> Array:
        """(T, L) distances of the landmarks to the truth."""
        gaps = self.body.landmarks_in_world(self.poses) - self.body.landmarks_in_world(self.truth)
        errors: Array = 1000 * np.linalg.norm(gaps, axis=-1)
        return errors

    @property
    def hinges_deg(self) -> Array:
        """(T, 4) errors of the elbow and knee angles."""
        columns = [k for k, name in enumerate(self.body.names) if name.endswith("_extension")]
        errors: Array = np.degrees(self.poses - self.truth)[:, columns]
        return errors

    def error_cells(self) -> list[str]:
        """Mean and 95 % of the joint errors, mm, and the hinges' RMS, degrees, of the frames not lost."""
        kept = ~self.lost
        return error_cells(self.joints_mm[kept], self.hinges_deg[kept])

    @property
    def wrong(self) -> Mask:
        """(T,) frames whose mean joint error exceeds 100 mm."""
        mask: Mask = self.joints_mm.mean(axis=1) > TRACKED_MM
        return mask


def tracked(frames: Iterable[Frame], scene: Scene, truth: Array, cycle: Cycle) -> Outcome:
    """Tracks one person through frames whose true poses (T, dof) are known, in order."""
    estimates, stages, times = [], [], []
    begin = time.perf_counter(), time.process_time()
    for step in track(iter(frames), scene, cycle):
        now = time.perf_counter(), time.process_time()
        times.append((now[0] - begin[0], now[1] - begin[1]))
        estimates.append(step.estimates[0])
        stages.append(step.seconds)
        begin = time.perf_counter(), time.process_time()
    wall_s, cpu_s = np.array(times).T
    body = scene.persons[0].body
    return Outcome(body, tuple(estimates), truth[: len(estimates)], tuple(stages), wall_s, cpu_s)


def error_cells(joints_mm: Array, hinges_deg: Array) -> list[str]:
    """Mean and 95 % of joint errors, mm, and the RMS of hinge errors, degrees."""
    if joints_mm.size == 0:
        return ["-", "-", "-"]
    rms = float(np.sqrt(np.mean(hinges_deg**2)))
    return [f"{joints_mm.mean():.2f}", f"{np.percentile(joints_mm, 95):.2f}", f"{rms:.2f}"]


def longest(mask: Mask) -> int:
    """Length of the longest run of true values."""
    run = most = 0
    for value in mask.tolist():
        run = run + 1 if value else 0
        most = max(most, run)
    return most
