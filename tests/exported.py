"""What exports of a made-up movement are compared with."""

from __future__ import annotations

from motions import LOST, N_FRAMES

from tracker.results.recording._motion import Motions, markers_of

HUNDREDTH_MM = 1e-5
FOUND = [t for t in range(N_FRAMES) if not LOST.start <= t < LOST.stop]


def motion_of(movement, k=0):
    motions = Motions(movement.context(None))
    for step in movement.steps:
        motions.add(step)
    return motions.all()[k]


def truth(movement, k=0):
    """Names and places (T, M, 3) of all markers, metres, also where the person was lost."""
    markers = markers_of(movement.scene.persons[k].body)
    motion = motion_of(movement, k)
    return [marker.name for marker in markers], motion.points(motion.q, markers)


def vars_of(motion):
    names = ("name", "body", "times_s", "interval_s", "q", "lost", "covariances", "shares")
    return {name: getattr(motion, name) for name in names}
