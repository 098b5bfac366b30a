"""The persons of a tracking job: their models as read, as kept by an interrupted run, or fitted to the recording."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from tracker.acquisition.calibrated_views import ViewSettings
from tracker.acquisition.cells import How
from tracker.acquisition.from_recording import fit_bodies
from tracker.acquisition.result import model_of
from tracker.acquisition.shape_space import space_of
from tracker.acquisition.things import Thing, carried_of, entry_of, told_of_things, told_of_uncarried
from tracker.acquisition.variations import of_people
from tracker.bodies.body.description import BodyDescription, read_description, save_description
from tracker.bodies.scene import Scene
from tracker.bodies.subject import Subject
from tracker.cameras.frame import Frame
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.files import write_whole
from tracker.images.reading import Sequence as Recording
from tracker.results.recording.journal import Expected, OpenJournal, as_kept, line_of, open_journal
from tracker.running.jobs._views import told_of_views
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Estimate
from tracker.tracking.found_before import knowing
from tracker.tracking.rehearsal import Reopen

log = logging.getLogger("tracker")

_LEAST_STATURE, _MOST_STATURE = 0.97, 1.04
"""Of the stature that was told what a fitted body has, at least and at most. What persons of one stature differ by
holds it there: right ones of 75 recordings came out 0.981 to 1.037 times as tall (shoes and hair count), and of a man
of 1.80 m who was told to be 2.20 or 1.65 m tall the fit made 2.12 and 1.72."""

MODELS = "models"
"""Folder of a result: each person's model, as tracked with."""

FITTED_AT = "bodies.jsonl"
"""In a result: the poses that bodies were fitted at, as the journal has them."""


@dataclass(frozen=True)
class OpenedTrack:
    """The inputs of a tracking job, opened."""

    sequence: Recording
    scene: Scene
    """The persons at rest, and the rig of the images as they are delivered."""

    models: Mapping[str, BodyDescription]
    """The model of each person, scaled or fitted."""

    frames: Reopen
    """Opens the frames of the recording, from the first one on."""

    done: OpenJournal | None = None
    """Frames of an interrupted run."""

    known: Mapping[int, Sequence[Estimate]] = field(default_factory=dict)
    """Frame -> the poses at which it has fitted bodies."""

    fitted_at: tuple[str, ...] = ()
    """Lines of these poses, where bodies have just been fitted."""

    findings: tuple[str, ...] = ()
    """What they tell of the views."""


def description_of(subject: Subject, earlier: Path | None) -> BodyDescription:
    """A person's model, with the shape that an interrupted run has fitted.

    Args:
        subject: the person.
        earlier: result folder of the interrupted run, if one is continued.

    Raises:
        ModelError: the model file is wrong.
        ConfigError: a stature is given for a model that does not tell its own.
    """
    kept = None if earlier is None else earlier / MODELS / f"{subject.name}.toml"
    fitted = kept is not None and kept.is_file() and subject.is_fitted
    return read_description(kept) if kept is not None and fitted else subject.description()


def with_fitted_bodies(opened: OpenedTrack, persons: Sequence[Subject], cycle: Cycle) -> tuple[OpenedTrack, Cycle]:
    """Fits the bodies of those whose shape the recording is to tell; see `tracker.running.jobs.track.TrackJob.fitted`.

    Args:
        opened: the persons as their models have them.
        persons: what is told of them, in the same order.
        cycle: the components.
    """
    settings = ViewSettings()
    spaces = {k: space_of(opened.models[one.name], settings.prior) for k, one in enumerate(persons) if one.is_fitted}
    if not spaces:
        return opened, cycle
    sequence, models = opened.sequence, dict(opened.models)
    reopen = partial(frames_in_view, opened.frames, cycle)
    untold = [k for k in spaces if persons[k].carries is None]
    found = fit_bodies(spaces, opened.scene, cycle, reopen, sequence.n_frames, settings, untold)
    for k, words in found.told.items():
        name = persons[k].name
        log.info("%s: lengths and shapes %s", name, words)
        cycle.progress(f"{name}: lengths and shapes {words}")
        if k in found.fits:
            carried = {one.name for one in (*(persons[k].carries or ()), *carried_of(found.things.get(k, ())))}
            models[name] = model_of(found.fits[k], models[name].name, f"{models[name].name}, {words}", carried)
        elif not models[name].variations:
            models[name] = models[name].model_copy(update={"variations": of_people(spaces[k])})
    scene = opened.scene.with_bodies({k: models[persons[k].name].build() for k in found.fits})
    opened = replace(opened, models=models)
    if not found.steps:
        return opened, cycle
    steps = [as_kept(step) for step in found.steps]
    # as kept, so that a resumed run comes to the same
    of_views = told_of_views(steps, scene, sequence.interval_s, cycle.progress)
    of_things = (_told(persons[k].name, things, k in found.fits) for k, things in found.things.items())
    of_statures = (_unlike(persons[k], models[persons[k].name].stature_m) for k in found.fits)
    findings = (*of_views, *itertools.chain.from_iterable((*of_statures, *of_things)))
    known = {step.frame.index: step.estimates for step in steps}
    opened = replace(opened, scene=scene, fitted_at=tuple(map(line_of, steps)), findings=findings)
    # with the same bodies the same start would be found again, and those begun the other way round as they were before
    cycle = knowing(cycle, known, found.start, believed=not found.fits)
    return opened, replace(cycle, refines_known=not of_views)


def _unlike(person: Subject, fitted_m: float) -> Iterator[str]:
    """What is said where the images show somebody of another stature than was told."""
    told_m = person.stature_m
    if told_m is not None and not _LEAST_STATURE <= fitted_m / told_m <= _MOST_STATURE:
        yield (
            f"{person.name}: fitted stature {fitted_m:.2f} m, told {told_m:.2f} m, and a fit goes part of the way: "
            "is stature_m right, and the rig in metres?"
        )


def _told(name: str, things: Sequence[Thing], is_fitted: bool) -> Iterator[str]:
    """What is said of things that nobody told of: of those that are tracked as carried, and of all others."""
    yield from told_of_uncarried(name, things)
    moving = [one for one in things if one.how is How.CARRIED]
    carried = [one for one in moving if is_fitted and not one.around]
    others = [one for one in moving if one not in carried]
    if carried:
        tell = f"set carries = []; else tell its true size: {entry_of(carried_of(carried))}"
        unseen = ", and what it hides nobody sees: look at the overlay" if any(one.hides for one in carried) else ""
        yield f"{told_of_things(name, carried)}; tracked as carried{unseen}. If nothing is, {tell}"
    if others:
        yield f"{told_of_things(name, others)}; it may hide limbs, or draw them to it: look at the overlay"


def frames_in_view(frames: Reopen, cycle: Cycle) -> Iterator[Frame]:
    """The frames of a recording from the first one on in which somebody is looked for."""
    return itertools.dropwhile(lambda frame: frame.index < cycle.nobody_before, frames())


def known_before(folder: Path, scene: Scene) -> Mapping[int, Sequence[Estimate]]:
    """The poses that an interrupted run has fitted bodies at; none if it has fitted none.

    Args:
        folder: its result.
        scene: its persons and rig.
    """
    if not (folder / FITTED_AT).is_file():
        return {}
    found = open_journal(folder, Expected.of(scene), FITTED_AT)
    return {frame: replay.estimates for frame, replay in found.items()}


def save_inputs(opened: OpenedTrack, folder: Path) -> None:
    """Keeps cameras and models as tracked with: a result can be read without the files it was made from."""
    save_rig(opened.sequence.rig, folder / "rig.toml")
    for name, model in opened.models.items():
        save_description(model, folder / MODELS / f"{name}.toml", decimals=None)
    if opened.fitted_at:
        write_whole(folder / FITTED_AT, "".join(opened.fitted_at).encode())
