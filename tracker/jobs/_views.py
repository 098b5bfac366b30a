"""What persons show of the views that they were tracked in, before the run itself begins."""

from __future__ import annotations

from collections.abc import Sequence

from tracker.alignment.adjustment import align
from tracker.alignment.moments import Tracked, chosen_moments, moments_of
from tracker.scene import Scene
from tracker.trajectory import Step


def told_of_views(steps: Sequence[Step], scene: Scene, interval_s: float) -> tuple[str, ...]:
    """Views that are out of step, and cameras that are turned; see `tracker.alignment.Alignment.findings`.

    Args:
        steps: frames that were tracked, with their images.
        scene: the persons with the bodies that they were tracked with.
        interval_s: from one frame to the next, seconds.
    """
    frames = [Tracked(step.frame.index, step.frame.time_s, step.estimates) for step in steps]
    images = (step.frame for step in steps)
    found = align(moments_of(scene, frames, chosen_moments(scene, frames), images), interval_s)
    return () if found is None else found.findings()
