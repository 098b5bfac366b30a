"""Poses of a run brought to one moment as they come, if its views are late by parts of a frame."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from tracker.foundation.progress import silent
from tracker.results.alignment import ViewAlignment
from tracker.results.alignment.adjustment import at_one_moment
from tracker.results.alignment.moments import Moment, Tracked, rates_at
from tracker.running.jobs._delivery import brings
from tracker.running.jobs._persons import OpenedTrack
from tracker.running.jobs._record import compared_views
from tracker.synthesis import Synthesis
from tracker.tracking.trajectory import Step

_BESIDE = 2
"""Frames on either side that show a movement."""


def brought(steps: Iterable[Step], found: ViewAlignment, synthesis: Synthesis) -> Iterator[Step]:
    """The steps with all poses at the first view's moment, except lost persons; `as_tracked` keeps the tracked ones.

    A step comes when the two after it are ready, so that `ready` counts two less: a run that is asked to stop does so
    before the last two of a window.

    Args:
        steps: as tracked.
        found: delays of the views.
        synthesis: makes the contours of the poses.
    """
    held: list[Step] = []
    place = 0
    for step in steps:
        held.append(step)
        if len(held) > place + _BESIDE:
            yield _brought(held, place, found, synthesis)
            place += 1
        if len(held) > 2 * _BESIDE:
            del held[0]
            place -= 1
    for k in range(place, len(held)):
        yield _brought(held, k, found, synthesis)


class OneMoment:
    """Decides whether a run's poses are brought to one moment, and by which delays."""

    def __init__(self, opened: OpenedTrack, synthesis: Synthesis, tell: Callable[[Iterable[str]], None]) -> None:
        """The delays that the poses of the fit of bodies show are known from the beginning.

        Args:
            opened: the recording and the persons.
            synthesis: makes the contours of the poses.
            tell: called with the late views, if their first window shows them.
        """
        self._opened, self._synthesis, self._tell = opened, synthesis, tell
        self.found = self._late(opened.alignment)

    def of(self, steps: Iterable[Step], asks: bool) -> Iterator[Step]:
        """The steps of the run, see `brought`.

        Args:
            steps: as tracked.
            asks: whether their first window, whose steps come at once, is measured if no bodies were fitted.
        """
        coming, window, opened = iter(steps), list[Step](), self._opened
        if self.found is None and asks and brings(opened.reading) and not (opened.fitted_at or opened.known):
            window = list(_first_window(coming))
            if window:
                self.found = self._late(compared_views(window, opened.scene, opened.sequence.interval_s, silent))
            self._tell(() if self.found is None else self.found.findings(True))
        together = itertools.chain(_given_away(window), coming)
        yield from together if self.found is None else brought(together, self.found, self._synthesis)

    def _late(self, found: ViewAlignment | None) -> ViewAlignment | None:
        return found if found is not None and found.late and brings(self._opened.reading) else None


def _first_window(steps: Iterator[Step]) -> Iterator[Step]:
    for step in steps:
        yield step
        if not step.ready:
            return


def _given_away(steps: list[Step]) -> Iterator[Step]:
    """The steps; each is released once it is taken, because of its images."""
    steps.reverse()
    while steps:
        yield steps.pop()


def _brought(steps: Sequence[Step], place: int, found: ViewAlignment, synthesis: Synthesis) -> Step:
    """One step after the other, at the first view's moment."""
    step = steps[place]
    tracked = [Tracked(one.frame.index, one.frame.time_s, one.estimates) for one in steps]
    estimates = list(step.estimates)
    for k, estimate in enumerate(estimates):
        if not estimate.lost:
            rates = rates_at(step.scene.persons[k].body, tracked, k, place)
            q = at_one_moment(Moment(step.frame, step.scene, k, rates), found.delays_at(step.frame.index))
            estimates[k] = replace(estimate, q=q)
    scene = step.scene.with_poses(tuple(one.q for one in estimates))
    return replace(
        step,
        scene=scene,
        estimates=tuple(estimates),
        fitted=synthesis.contours(scene),
        ready=max(step.ready - _BESIDE, 0),
        as_tracked=tuple(one.q for one in step.estimates),
    )
