"""What persons show of the views that they were tracked in, before the run itself begins."""

from __future__ import annotations

from collections.abc import Sequence

from tracker.alignment.adjustment import align
from tracker.alignment.moments import Tracked, chosen_moments, moments_of
from tracker.progress import Progress
from tracker.scene import Scene
from tracker.trajectory import Step


def told_of_views(steps: Sequence[Step], scene: Scene, interval_s: float, progress: Progress) -> tuple[str, ...]:
    """Views that are out of step, and cameras that are turned; see `tracker.alignment.Alignment.findings`.

    Args:
        steps: frames that were tracked, with their images.
        scene: the persons with the bodies that they were tracked with.
        interval_s: from one frame to the next, seconds.
        progress: told that all is as it should be; findings are for the caller to tell.
    """
    frames = [Tracked(step.frame.index, step.frame.time_s, step.estimates) for step in steps]
    images = (step.frame for step in steps)
    found = align(moments_of(scene, frames, chosen_moments(scene, frames), images), interval_s)
    if found is None:
        return ()
    if not found.findings():
        beside_ms = 1000 * interval_s * float(abs(found.late_frames).max())
        progress(
            f"views: in step to {beside_ms:.0f} ms, cameras as calibrated to {found.turned_px.max():.1f} px, by the "
            f"persons in {found.n_moments} frames"
        )
    return found.findings()
