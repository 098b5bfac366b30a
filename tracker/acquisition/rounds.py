"""Frames at the poses that persons were followed at, and the bodies fitted to them: a round of fitting."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.acquisition.calibrated_views import Seen, ViewSettings, Watching, fit_to_views
from tracker.acquisition.fitting import Fit
from tracker.acquisition.looks import Look
from tracker.acquisition.shape_space import ShapeSpace
from tracker.bodies.scene import Scene
from tracker.foundation.freed_memory import give_back
from tracker.tracking.cycle import Cycle
from tracker.tracking.loss import doubted
from tracker.tracking.trajectory import Step
from tracker.tracking.way_round import LEAST_SEEN, n_sure

LEAST_OUTLINED = 2
"""Views in which the person stands out before a known background, below which nothing is fitted: edges alone made of a
real man a body with which an arm was wrong in 98 of 100 frames (scaled, without plates: in none)."""

_LEAST_CLEARED = 0.5
"""Share of the frames that a body fitted in spite of doubts must free of them: one that is right frees most."""


@dataclass(frozen=True)
class Round:
    """The first frames at the poses found, and the bodies fitted to them so far."""

    fits: Mapping[int, Fit]
    scene: Scene
    steps: Sequence[Step]

    def watching(self, cycle: Cycle, settings: ViewSettings) -> Watching:
        """The cameras, and what is made of their images."""
        return Watching(self.scene.rig, cycle.synthesis, settings.analysis, cycle.plates)

    def fitted(
        self,
        spaces: Mapping[int, ShapeSpace],
        cycle: Cycle,
        settings: ViewSettings,
        in_spite: Collection[int] = (),
    ) -> Round:
        """Bodies fitted to the poses, of some in spite of doubts; the steps are then of these bodies."""
        give_back()
        watching, fits = self.watching(cycle, settings), dict(self.fits)
        for k, space in spaces.items():
            seen = best_seen(self.steps, k, len(self.steps), settings.frames, doubted_too=k in in_spite)
            if len(seen) >= LEAST_SEEN:
                shape = fits[k].shape if k in fits else np.zeros(len(space.names))
                fit = fit_to_views(space, (shape, k), seen, watching, settings, cycle.progress)
                if sum(_n_outlined(look) >= LEAST_OUTLINED for look in fit.looks) >= LEAST_SEEN:
                    fits[k] = fit
        return self.of(fits)

    def of(self, fits: Mapping[int, Fit]) -> Round:
        """The same poses with these bodies and, of the others, those of the models."""
        scene = self.scene.with_bodies({k: fit.body for k, fit in fits.items()})
        steps = [replace(step, scene=scene.with_poses(tuple(one.q for one in step.estimates))) for step in self.steps]
        return replace(self, fits=fits, steps=steps)

    def cleared(self, unlike: Collection[int]) -> Round:
        """Without those bodies, of some that were fitted in spite of doubts, that have not freed the frames of them."""
        least = _LEAST_CLEARED * len(self.steps)
        return self.of({k: fit for k, fit in self.fits.items() if k not in unlike or n_sure(self.steps, k) >= least})

    def told(self, k: int, unlike: bool) -> str:
        """What was done for a person."""
        if k not in self.fits:
            sure = n_sure(self.steps, k)
            what = (
                "without doubt" if sure < LEAST_SEEN else f"without doubt, too few outlined in {LEAST_OUTLINED} views"
            )
            return f"as the model has them: {sure} of the first {len(self.steps)} frames {what}"
        freed = ", which were in doubt before" if unlike else ""
        return f"fitted to {len(self.fits[k].looks)} of the first {len(self.steps)} frames{freed}"


def best_seen(
    steps: Iterable[Step], person: int, n_frames: int, n_kept: int, doubted_too: bool = False
) -> tuple[Seen, ...]:
    """Of each stretch of a recording the frame in which a person is seen best.

    Args:
        steps: the frames, tracked.
        person: place in the scene.
        n_frames: their number.
        n_kept: stretches, at the most.
        doubted_too: also of frames in which something of the person is in doubt.
    """
    best: dict[int, tuple[float, Seen]] = {}
    for n, step in enumerate(steps):
        estimate = step.estimates[person]
        if estimate.lost or (doubted(estimate) and not doubted_too):
            continue
        stretch, left_over = n * min(n_kept, n_frames) // n_frames, estimate.account.left_over
        if stretch not in best or left_over < best[stretch][0]:
            best[stretch] = (left_over, Seen(step.frame, step.scene))
    return tuple(best[stretch][1] for stretch in sorted(best))


def _n_outlined(look: Look) -> int:
    """Views in which the person does."""
    return 0 if look.outlines is None else sum(view is not None for view in look.outlines.views)
