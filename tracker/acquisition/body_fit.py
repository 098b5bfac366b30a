"""Persons' bodies from the recording that they are tracked in: followed as they are, then fitted to what was seen.

Limbs were wrong mostly because the body was: over five recordings of hard movement, three starts each, 37 frames had a
joint more than 150 mm off with `human` scaled by stature, and 6 with bodies fitted to the same views.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.acquisition.calibrated_views import Seen, ViewSettings, Watching, fit_to_views
from tracker.acquisition.clouds import Look
from tracker.acquisition.fitting import Fit
from tracker.acquisition.result import stature_of
from tracker.acquisition.shape_space import ShapeSpace, space_of
from tracker.acquisition.things import Thing, carried_of, things_of, tracked_with
from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.bodies.subject import Carried, with_carried
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.foundation.resources import give_back
from tracker.tracking.confirmation import LEAST_SEEN, n_sure
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.estimate import Estimate
from tracker.tracking.found_before import start_of
from tracker.tracking.loss import doubted
from tracker.tracking.rehearsal import Reopen
from tracker.tracking.start import Start
from tracker.tracking.trajectory import Step
from tracker.tracking.windows import back, length_of_windows, there

# Assigns several persons by the bodies that were fitted to them.
#
# At the start that is told by how high heads are. A person who lies or kneels would otherwise count as the smallest: a
# scanned man of 1.85 m who gets up beside a woman of 1.73 m was tracked by her name, and with a body between the two.

_HELD_BACK = 2.5
"""How much farther from the stature that is told a fitted one may be if nothing is told, at most: bodies fitted under
each other's names went 22, 54, 70 and 71 % of the way to the right stature."""

_BY_M = 0.03
"""By how much less all statures must differ from those told to others before that is tried. Six fitted under the right
names were 1 to 15 mm off."""


def whose(told: Sequence[BodyModel], fitted: Mapping[int, BodyModel]) -> tuple[int, ...] | None:
    """For each person the place of who seems to be that one; None if everybody seems to be in its own.

    Args:
        told: the persons' bodies as models and statures have them.
        fitted: place -> the body fitted. Those without one, and bodies of other models, stay who they are.
    """
    order = list(range(len(told)))
    for names in {told[k].names for k in fitted}:
        alike = [k for k in fitted if told[k].names == names]
        wanted, found = (np.array([stature_of(bodies[k]) for k in alike]) for bodies in (told, fitted))
        low, high = np.sort([found, wanted + _HELD_BACK * (found - wanted)], axis=0)
        costs = np.maximum(np.maximum(low - wanted[:, None], wanted[:, None] - high), 0.0)
        rows, columns = linear_sum_assignment(costs)
        if np.trace(costs) - costs[rows, columns].sum() > _BY_M:
            for row, column in zip(rows, columns, strict=True):
                order[alike[row]] = alike[column]
    return tuple(order) if order != list(range(len(told))) else None


def apart_m(told: Sequence[BodyModel], fitted: Mapping[int, BodyModel], whom: Set[int]) -> float:
    """Mean distance of the fitted statures of some persons to those told, metres; inf where one has no fitted body."""
    if not whom <= fitted.keys():
        return float("inf")
    return float(np.mean([abs(stature_of(fitted[k]) - stature_of(told[k])) for k in whom]))


# Frames at the poses that persons were followed at, and the bodies fitted to them: a round of fitting.

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
        """Result for a person."""
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
    """The frame of each stretch of a recording that shows a person best.

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


Spaces = Mapping[int, ShapeSpace]
"""Place of a person in the scene -> how its body may differ from that in the scene."""

LONGEST = 100
"""Frames that a recording is followed through before bodies are fitted to it: four seconds show most limbs bent and
straight, and a long recording does not wait for more."""


# See docs/lab/one_fit.md.
@dataclass(frozen=True)
class Fitting:
    """Bodies fitted to a recording."""

    fits: Mapping[int, Fit]
    """Place of a person in the scene -> its body; without those who were not seen well enough."""

    told: Mapping[int, str]
    """Place -> result in a few words, for every person concerned."""

    steps: Sequence[Step]
    """The frames followed through, with the poses that the bodies were fitted at; none where none were followed."""

    start: Start | None
    """The start of the persons."""

    things: Mapping[int, tuple[Thing, ...]]
    """Place -> things that the person holds or wears without an entry; likely ones are a part of the fitted body."""


def fit_bodies(
    spaces: Spaces,
    scene: Scene,
    cycle: Cycle,
    reopen: Reopen,
    n_frames: int,
    settings: ViewSettings,
    untold: Collection[int] = (),
) -> Fitting:
    """Fits bodies to the first frames of a recording.

    They are tracked forwards with the bodies as they are, and are fitted then; the tracking of the recording goes
    through the same frames from the poses found (`tracker.tracking.found_before.gone_again`), and back where there is
    doubt. Tracked back again before that, and fitted anew, bodies cost a third of a run's CPU; over ten recordings
    (plates, one start) joints were 24.6 instead of 22.9 mm off on average, and with offsets removed 12.5 and 12.1.
    Who is in doubt all the way there is followed back before anything is fitted: a scanned man, rendered crawling from
    the first frame on, kept the scaled body (28 mm, 11 of 50 frames falsely flagged; fitted 22 mm and none). Who is so
    still, though found for sure, may be built otherwise than the model: fitted to frames in doubt, such a body is kept
    if it leaves half of them without. A person who was not found for sure may face the other way, and a body fitted
    to frames in doubt would end the doubts: a man was 447 mm off in 90 frames, none doubtful.

    Args:
        spaces: place of a person in the scene -> how its body may differ from that in the scene.
        scene: the persons and the rig.
        cycle: the components.
        reopen: opens the recording.
        n_frames: frames of the recording.
        settings: of the fit.
        untold: those of whom nobody has told whether they carry something. What seems carried on both ways is, and
            frames are tracked anew with it as a part of the body.

    Raises:
        InitializationError: no person was found.
    """
    give_back()
    frames = _first(reopen, min(n_frames, LONGEST))
    if _n_known(frames[0], cycle) < LEAST_OUTLINED:
        few = f"as the model has them: no background is known in {LEAST_OUTLINED} views"
        return Fitting({}, dict.fromkeys(spaces, few), (), None, {})
    following = _Following(frames, reopen, settings)
    way = _named(following.there(scene, spaces, cycle), scene, following)
    if way.unlike & way.found.fits.keys():
        way = following.back(way)
    things = _all_things(way, spaces, untold, settings)
    if any(map(carried_of, things.values())) and way.found.fits:
        # the poses were found with bodies as the models have them; with those fitted a shoe may be one
        way = following.back(way)
        things = _all_things(way, spaces, untold, settings)
    if any(map(carried_of, things.values())):
        cycle.progress("bodies: the frames are tracked anew, with what the persons carry")
        with_things = {k: _with(spaces[k], carried_of(some)) for k, some in things.items()}
        laden = scene.with_bodies({k: space.description.build() for k, space in with_things.items()})
        known = cycle.knowing(*_as_found(way.found.steps), believed=True)
        way = following.there(laden, {**spaces, **with_things}, known)
        things = {k: tracked_with(some, *_poses(way, k)) for k, some in things.items()}
    found = way.found
    start = start_of(found.steps)
    told = {k: found.told(k, k in way.unlike) for k in spaces}
    return Fitting(found.fits, told, found.steps, start, things)


@dataclass(frozen=True)
class _Way:
    """Frames followed through, and the bodies fitted to them."""

    found: Round
    spaces: Spaces
    cycle: Cycle
    state: State
    """Behind the last frame."""

    unlike: frozenset[int]
    """Persons who were fitted in doubt."""


@dataclass(frozen=True)
class _Following:
    """The frames, and how bodies are fitted to them."""

    frames: Sequence[Frame]
    reopen: Reopen
    settings: ViewSettings

    def there(self, scene: Scene, spaces: Spaces, cycle: Cycle) -> _Way:
        """Frames tracked with the bodies of a scene and those fitted to them."""
        cycle.progress(f"step 1 of 3: tracking the first {len(self.frames)} frames with the average body")
        steps, state = there(self.frames, scene, cycle, self.reopen)
        if any(len(best_seen(steps, k, len(steps), self.settings.frames)) < LEAST_SEEN for k in spaces):
            cycle.progress("bodies: the frames are tracked back as well, since hardly one is without doubt")
            steps = back(steps, cycle, state)
        doubted = frozenset(k for k in spaces if n_sure(steps, k) < LEAST_SEEN)
        unlike = frozenset(k for k in doubted if _found_for_sure(steps, k, cycle))
        cycle.progress("step 2 of 3: fitting the body to these frames")
        found = Round({}, scene, steps).fitted(spaces, cycle, self.settings, unlike)
        return _Way(found, spaces, cycle, state, unlike)

    def back(self, way: _Way) -> _Way:
        """The same frames tracked back with the bodies fitted, and bodies fitted to that."""
        way.cycle.progress("bodies: the frames are tracked back with the fitted body")
        found = replace(way.found, steps=back(way.found.steps, way.cycle, way.state)).cleared(way.unlike)
        return replace(way, found=found.fitted(way.spaces, way.cycle, self.settings))


def _named(way: _Way, scene: Scene, following: _Following) -> _Way:
    """The way, or that on which persons have each other's names, if the bodies fitted are more like those told then."""
    told = any(person.at is not None for person in scene.persons)
    order = None if told else whose(*_bodies(scene, way.found))
    if order is None:
        return way
    way.cycle.progress("bodies: the persons may have each other's names, since one is as tall as another should be")
    known = way.cycle.knowing(*_as_found(way.found.steps, order), believed=True)
    other, whom = following.there(scene, way.spaces, known), way.found.fits.keys()
    if apart_m(*_bodies(scene, other.found), whom) >= apart_m(*_bodies(scene, way.found), whom):
        return way
    way.cycle.progress("bodies: the persons' names are exchanged")
    return replace(other, cycle=way.cycle)


def _all_things(
    way: _Way, spaces: Spaces, untold: Collection[int], settings: ViewSettings
) -> dict[int, tuple[Thing, ...]]:
    """Place -> findings about persons without an entry."""
    give_back()
    return {k: some for k in spaces if k in untold and (some := _things(way, k, settings))}


def _things(way: _Way, k: int, settings: ViewSettings) -> tuple[Thing, ...]:
    """What a person carries: one who wears a skirt may be in doubt everywhere, and the body not fitted."""
    fit = way.found.fits.get(k)
    description = way.spaces[k].description if fit is None else fit.space.described(fit.shape)
    seen = [Seen(step.frame, step.scene) for step in way.found.steps if not step.estimates[k].lost]
    return things_of(seen, k, description, way.found.watching(way.cycle, settings))


def _poses(way: _Way, k: int) -> tuple[BodyModel, Array]:
    """The body that a person was followed with, and the poses (N, dof) of frames in which she is not lost."""
    found = [step.estimates[k].q for step in way.found.steps if not step.estimates[k].lost]
    body = way.found.steps[-1].scene.persons[k].body
    return body, np.array(found).reshape(-1, body.dof)


def _with(space: ShapeSpace, things: Sequence[Carried]) -> ShapeSpace:
    return space_of(with_carried(space.description, things), space.prior)


def _bodies(scene: Scene, found: Round) -> tuple[list[BodyModel], dict[int, BodyModel]]:
    """Those of all persons as they are told, and those fitted."""
    return [person.body for person in scene.persons], {k: fit.body for k, fit in found.fits.items()}


def _as_found(
    steps: Sequence[Step], order: Sequence[int] | None = None
) -> tuple[dict[int, Sequence[Estimate]], Start | None]:
    """Frame -> estimates, perhaps under other names, and how persons were found."""
    start = start_of(steps)
    if order is None:
        return {step.frame.index: step.estimates for step in steps}, start
    known: dict[int, Sequence[Estimate]] = {step.frame.index: tuple(step.estimates[k] for k in order) for step in steps}
    return known, None if start is None else start.of(order)


def _found_for_sure(steps: Sequence[Step], k: int, cycle: Cycle) -> bool:
    """Whether a person's start was sure, or nothing was there to choose from."""
    start = start_of(steps)
    return start is None or not start.sureness or start.sureness[k] >= cycle.loss.sure


def _n_known(frame: Frame, cycle: Cycle) -> int:
    """Views in which a person may stand out."""
    return sum(frame.mask(v) is not None or plate is not None for v, plate in enumerate(cycle.plates))


def _first(reopen: Reopen, n_frames: int) -> list[Frame]:
    """The first frames, as many as may be held."""
    frames = reopen()
    first = next(frames)
    return [first, *itertools.islice(frames, min(n_frames, max(length_of_windows(first), LEAST_SEEN)) - 1)]
