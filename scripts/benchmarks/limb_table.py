"""A recorder for fitting doubt: what a run knows of every limb in every frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.foundation.configuration.components import component
from tracker.foundation.files import csv_lines
from tracker.results.recording import RunContext
from tracker.tracking.loss import left_over_of, limb_spreads_m, limbs_left_over
from tracker.tracking.trajectory import Step

FILE = "limbs_known.csv"
COLUMNS = (
    "frame", "person", "limb", "joints", "status", "left_over", "explained", "visible_px", "spread_m", "whole",
    "doubts", "whole_doubts", "views",
)  # fmt: skip


@component
class LimbTable:
    """`limbs_known.csv`: a row a frame, person and limb; the trunk is the limb without a name."""

    def begin(self, run: RunContext) -> LimbRecorder:
        """Makes the file."""
        return LimbRecorder(run)


class LimbRecorder:
    """The open table."""

    def __init__(self, run: RunContext) -> None:
        self._path = run.folder / FILE
        self._path.write_text(csv_lines([COLUMNS]), encoding="utf-8")

    def write(self, step: Step) -> None:
        """Adds the rows of one frame."""
        rows = []
        for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
            body, account = person.body, estimate.account
            spreads, left = limb_spreads_m(body, estimate), limbs_left_over(body, account)
            whole = " ".join(str(one.because) for one in estimate.doubts if not one.limb)
            for limb in body.limbs:
                own = account.of(body.parts_of(limb))
                joints = np.array(body.landmark_names)[body.landmarks_of(limb)]
                views = 0
                if own.by_view_px is not None:
                    views = int(np.count_nonzero(own.by_view_px[0].sum(axis=1) > 20.0))
                reasons = " ".join(str(one.because) for one in estimate.doubts if one.limb == limb)
                rows.append([
                    step.frame.index, person.name, limb, " ".join(joints), str(estimate.status),
                    f"{left.get(limb, left_over_of(own)):.5f}", f"{own.explained:.5f}",
                    f"{own.visible_px.sum():.1f}", f"{spreads[limb]:.5f}", f"{account.left_over:.5f}",
                    reasons, whole, views,
                ])  # fmt: skip
        with self._path.open("a", encoding="utf-8") as file:
            file.write(csv_lines(rows))

    def finish(self) -> tuple[Path, ...]:
        """The file is complete."""
        return (self._path,)
