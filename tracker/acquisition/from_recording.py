"""Persons' bodies from the recording that they are tracked in: followed as they are, then fitted to what was seen.

Limbs were wrong mostly because the body was: over five recordings of hard movement, three starts each, 37 frames had a
joint more than 150 mm off with `human` scaled by stature, and 6 with bodies fitted to the same views (V-Dance 31 and 20
mm on average, K-Kick 25 and 17).
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.acquisition.calibrated_views import Seen, ViewSettings, Watching, fit_to_views
from tracker.acquisition.fitting import Fit
from tracker.acquisition.looks import Look
from tracker.acquisition.shape_space import ShapeSpace
from tracker.acquisition.who_is_who import apart_m, whose
from tracker.body import BodyModel
from tracker.cycle import Cycle, State
from tracker.estimate import Estimate
from tracker.found_before import knowing
from tracker.frame import Frame
from tracker.loss import doubted
from tracker.rehearsal import Reopen
from tracker.scene import Scene
from tracker.start import Start
from tracker.trajectory import Step
from tracker.windows import back, length_of_windows, there

LONGEST = 100
"""Frames that a recording is followed through before bodies are fitted to it: four seconds show most limbs bent and
straight, and a long recording does not wait for more."""

_LEAST_OUTLINED = 2
"""Views in which the person stands out before a known background, below which nothing is fitted: edges alone made of a
real man a body with which an arm was wrong in 98 of 100 frames (scaled, without plates: in none)."""

_LEAST_SEEN = 4
"""Frames in which a person is seen without doubt, below which its body is not fitted: a pose that is wrong makes a
body that fits it. If it is the body that is unlike the model's, one fitted all the same ends the doubts."""

_LEAST_CLEARED = 0.5
"""Share of the frames that a body fitted in spite of doubts must free of them: one that is right frees most."""


@dataclass(frozen=True)
class Fitting:
    """Bodies fitted to a recording."""

    fits: Mapping[int, Fit]
    """Place of a person in the scene -> its body; without those who were not seen well enough."""

    told: Mapping[int, str]
    """Place -> what was done, in a few words, of everybody asked for."""

    steps: Sequence[Step]
    """The frames followed through, with the poses that the bodies were fitted at; none where none were followed."""

    start: Start | None
    """How persons were found."""


def fit_bodies(
    spaces: Mapping[int, ShapeSpace], scene: Scene, cycle: Cycle, reopen: Reopen, n_frames: int, settings: ViewSettings
) -> Fitting:
    """Fits bodies to the first frames of a recording.

    They are tracked forwards with the bodies as they are, and back again with those fitted then, each pose weighed
    against that of the way there; then bodies are fitted anew. A start that was wrong is seldom so on the way back: in
    R-Turn legs were exchanged in the first 14 frames, untold, when both ways went forwards from a start of their own.
    Who is in doubt all the way there is followed back before anything is fitted: a scanned man, rendered crawling from
    the first frame on, kept the scaled body (28 mm, 11 of 50 frames falsely flagged; fitted 22 mm and none). Who is so
    still may be built otherwise than the model: fitted to frames in doubt, such a body is kept if it leaves half of
    them without. Poses that are wrong seldom get there: K-Kick, N-Stride and N-WalkCircle, begun turned round or by a
    quarter, were found again on the way (17 to 20 mm).

    Args:
        spaces: place of a person in the scene -> how its body may differ from that in the scene.
        scene: the persons and the rig.
        cycle: the components.
        reopen: opens the recording.
        n_frames: frames of the recording.
        settings: of the fit; a second round is the way back.

    Raises:
        InitializationError: nobody was found.
    """
    frames = _first(reopen, min(n_frames, LONGEST))
    if _n_known(frames[0], cycle) < _LEAST_OUTLINED:
        few = f"as the model has them: no background is known in {_LEAST_OUTLINED} views"
        return Fitting({}, dict.fromkeys(spaces, few), (), None)
    found, state, unlike = _as_they_are(frames, (scene, spaces), cycle, reopen, settings)
    told = any(person.at is not None for person in scene.persons)
    if not told and (order := whose(*_bodies(scene, found))) is not None:
        cycle.progress("bodies: under each other's names, for one is as tall as another is told to be")
        known = knowing(cycle, *_exchanged(found.steps, order), believed=True)
        other = _as_they_are(frames, (scene, spaces), known, reopen, settings)
        whom = found.fits.keys()
        if apart_m(*_bodies(scene, other[0]), whom) < apart_m(*_bodies(scene, found), whom):
            cycle.progress("bodies: names are exchanged")
            found, state, unlike = other
    if found.fits and (settings.rounds > 1 or unlike & found.fits.keys()):
        cycle.progress("bodies: tracked back as fitted")
        found = replace(found, steps=back(found.steps, cycle, state)).cleared(unlike)
        found = found.fitted(spaces, cycle, settings)
    start = next((step.start for step in found.steps if step.start is not None), None)
    return Fitting(found.fits, {k: found.told(k, k in unlike) for k in spaces}, found.steps, start)


def _as_they_are(
    frames: Sequence[Frame],
    persons: tuple[Scene, Mapping[int, ShapeSpace]],
    cycle: Cycle,
    reopen: Reopen,
    settings: ViewSettings,
) -> tuple[_Round, State, frozenset[int]]:
    """Frames tracked with the bodies of a scene and those fitted to them, the state, and who was fitted in doubt."""
    scene, spaces = persons
    cycle.progress("bodies: tracked as their models have them")
    steps, state = there(frames, scene, cycle, reopen)
    if any(len(best_seen(steps, k, len(steps), settings.frames)) < _LEAST_SEEN for k in spaces):
        cycle.progress("bodies: tracked back, for hardly a frame is without doubt")
        steps = back(steps, cycle, state)
    unlike = frozenset(k for k in spaces if _n_sure(steps, k) < _LEAST_SEEN)
    return _Round({}, scene, steps).fitted(spaces, cycle, settings, unlike), state, unlike


def _bodies(scene: Scene, found: _Round) -> tuple[list[BodyModel], dict[int, BodyModel]]:
    """Those of all persons as they are told, and those fitted."""
    return [person.body for person in scene.persons], {k: fit.body for k, fit in found.fits.items()}


def _exchanged(steps: Sequence[Step], order: Sequence[int]) -> tuple[dict[int, Sequence[Estimate]], Start | None]:
    """Frame -> estimates under other names, and how persons were found."""
    known: dict[int, Sequence[Estimate]] = {step.frame.index: tuple(step.estimates[k] for k in order) for step in steps}
    start = next((step.start for step in steps if step.start is not None), None)
    return known, None if start is None else start.of(order)


def _n_sure(steps: Iterable[Step], person: int) -> int:
    """Frames in which a person is seen without doubt."""
    return sum(not (step.estimates[person].lost or doubted(step.estimates[person])) for step in steps)


def _n_known(frame: Frame, cycle: Cycle) -> int:
    """Views in which somebody may stand out."""
    return sum(frame.mask(v) is not None or plate is not None for v, plate in enumerate(cycle.plates))


def _n_outlined(look: Look) -> int:
    """Views in which the person does."""
    return 0 if look.outlines is None else sum(view is not None for view in look.outlines.views)


def _first(reopen: Reopen, n_frames: int) -> list[Frame]:
    """The first frames, as many as may be held."""
    frames = reopen()
    first = next(frames)
    return [first, *itertools.islice(frames, min(n_frames, max(length_of_windows(first), _LEAST_SEEN)) - 1)]


@dataclass(frozen=True)
class _Round:
    """The first frames at the poses found, and the bodies fitted to them so far."""

    fits: Mapping[int, Fit]
    scene: Scene
    steps: Sequence[Step]

    def fitted(
        self,
        spaces: Mapping[int, ShapeSpace],
        cycle: Cycle,
        settings: ViewSettings,
        in_spite: Collection[int] = (),
    ) -> _Round:
        """Bodies fitted to the poses, of some in spite of doubts; the steps are then of these bodies."""
        watching = Watching(self.scene.rig, cycle.synthesis, settings.analysis, cycle.plates)
        fits = dict(self.fits)
        for k, space in spaces.items():
            seen = best_seen(self.steps, k, len(self.steps), settings.frames, doubted_too=k in in_spite)
            if len(seen) >= _LEAST_SEEN:
                shape = fits[k].shape if k in fits else np.zeros(len(space.names))
                fit = fit_to_views(space, (shape, k), seen, watching, settings, cycle.progress)
                if sum(_n_outlined(look) >= _LEAST_OUTLINED for look in fit.looks) >= _LEAST_SEEN:
                    fits[k] = fit
        return self.of(fits)

    def of(self, fits: Mapping[int, Fit]) -> _Round:
        """The same poses with these bodies and, of the others, those of the models."""
        scene = self.scene.with_bodies({k: fit.body for k, fit in fits.items()})
        steps = [replace(step, scene=scene.with_poses(tuple(one.q for one in step.estimates))) for step in self.steps]
        return replace(self, fits=fits, steps=steps)

    def cleared(self, unlike: Collection[int]) -> _Round:
        """Without those bodies, of some that were fitted in spite of doubts, that have not freed the frames of them."""
        least = _LEAST_CLEARED * len(self.steps)
        return self.of({k: fit for k, fit in self.fits.items() if k not in unlike or _n_sure(self.steps, k) >= least})

    def told(self, k: int, unlike: bool) -> str:
        """What was done for a person."""
        if k not in self.fits:
            n_sure = _n_sure(self.steps, k)
            what = (
                "without doubt"
                if n_sure < _LEAST_SEEN
                else f"without doubt, too few outlined in {_LEAST_OUTLINED} views"
            )
            return f"as the model has them: {n_sure} of the first {len(self.steps)} frames {what}"
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
