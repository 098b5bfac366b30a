"""What a tracking job sees in the first frames, before it tracks: input that is wrong, and when persons come in."""

from __future__ import annotations

from tracker.cameras.world import told_world
from tracker.foundation.errors import SequenceError
from tracker.images.inspection import findings, first_in_view, other_colours, survey
from tracker.running.jobs._persons import OpenedTrack, frames_in_view
from tracker.tracking.cycle import Cycle


def looked_at(opened: OpenedTrack, cycle: Cycle, stride: int) -> tuple[str, ...]:
    """What looks wrong in the input; nothing of an interrupted run, which was told already.

    Args:
        opened: the recording and the persons.
        cycle: with the plates, and the frame from which on persons are looked for; told what takes long.
        stride: of the frames that are read, in frames of the recording.

    Raises:
        SequenceError: images are grey and plates are not, or the other way round.
    """
    if opened.done:
        return ()
    cycle.progress(told_world(opened.sequence.rig))
    cycle.progress("looking at the first frames")
    frames = frames_in_view(opened.frames, cycle)
    seen = survey(frames, opened.scene, cycle.plates, stride)
    if fault := other_colours(seen):
        raise SequenceError(fault)
    return findings(seen)


def first_sought(opened: OpenedTrack, cycle: Cycle, start: int, passes: int) -> int:
    """Number of the frame from which on persons are looked for: not before they come in; 0 where there is no telling.

    Args:
        opened: the recording and the persons.
        cycle: with the plates; told of a frame that is not the first one.
        start: the first frame that is read.
        passes: how often the recording is tracked.
    """
    n_persons = len(opened.scene.persons)
    for n in dict.fromkeys((n_persons, 1)):  # those who are never seen apart may be in view all the same
        found = first_in_view(opened.frames(), cycle.plates, n, cycle.progress)
        if found is not None:
            break
    if found is None:
        return 0
    if found > start:
        who = "nobody is" if n == 1 else f"not all {n} persons are"
        back = ", and the frames before are tracked back from it" if passes == 2 else ""
        cycle.progress(f"{who} seen whole before frame {found}: the start is looked for there{back}")
    return found
