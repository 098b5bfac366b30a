"""The persons of a tracking job: models as read, as kept by an interrupted run, or fitted to the recording."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tracker.acquisition.body_fit import fit_bodies
from tracker.acquisition.calibrated_views import ViewSettings
from tracker.acquisition.cells import How
from tracker.acquisition.result import BoneLength, Panel, PartResidual, fit_figure, model_of
from tracker.acquisition.scan_rigging import Fitted
from tracker.acquisition.shape_space import space_of
from tracker.acquisition.things import Thing, carried_of, entry_of, told_of_things, told_of_uncarried
from tracker.acquisition.variations import of_people
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription, measured_pose, read_description, save_description
from tracker.bodies.body.sections import SkinSection
from tracker.bodies.keypoint_layouts.views import KeypointFiles
from tracker.bodies.scene import Person, Scene
from tracker.bodies.skin import Rigging, ScannedSurface, write_rigging, write_surface
from tracker.bodies.subject import Subject
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import save_rig
from tracker.evidence import Evidence
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.keypoints import KeypointEvidence
from tracker.evidence.measures.outlines import overlap
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array
from tracker.foundation.files import replacing, write_whole
from tracker.images.reading import Reading
from tracker.images.reading import Sequence as Recording
from tracker.results.alignment import ViewAlignment
from tracker.results.recording.journal import Expected, OpenJournal, as_kept, line_of, open_journal
from tracker.running.jobs._acquisition import AcquireOutcome
from tracker.running.jobs._delivery import brings
from tracker.running.jobs._record import compared_views
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Estimate
from tracker.tracking.initialization import Initialization
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.keypoints import KeypointInitialization
from tracker.tracking.rehearsal import Reopen

log = logging.getLogger("tracker")

_LEAST_STATURE, _MOST_STATURE = 0.97, 1.04
"""Range of a fitted body's stature, as a share of the configured stature. Differences between persons of one stature
holds it there: right ones of 75 recordings came out 0.981 to 1.037 times as tall (shoes and hair count), and of a man
of 1.80 m who was told to be 2.20 or 1.65 m tall the fit made 2.12 and 1.72."""

MODELS = "models"
"""Folder of a result: the models that the run tracked with."""

FITTED_AT = "bodies.jsonl"
"""File of a result: the poses at which bodies were fitted, as journal lines."""


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

    reading: Reading
    """Settings of the recording, with the run's corrections."""

    done: OpenJournal | None = None
    """Frames of an interrupted run."""

    known: Mapping[int, Sequence[Estimate]] = field(default_factory=dict)
    """Frame -> the poses at which it fitted bodies."""

    fitted_at: tuple[str, ...] = ()
    """Journal lines of these poses, if bodies have just been fitted."""

    findings: tuple[str, ...] = ()
    """Delays of the views by these poses."""

    alignment: ViewAlignment | None = None
    """Delays of the views by these poses; of an interrupted run by the known ones."""


def description_of(subject: Subject, earlier: Path | None) -> BodyDescription:
    """A person's model, with the shape that an interrupted run fitted.

    Args:
        subject: the person.
        earlier: result folder of the interrupted run that is continued, if any.

    Raises:
        ModelError: the model file is wrong.
        ConfigError: the configuration gives a stature, and the model has none of its own.
    """
    kept = None if earlier is None else earlier / MODELS / f"{subject.name}.toml"
    fitted = kept is not None and kept.is_file() and subject.is_fitted
    return read_description(kept) if kept is not None and fitted else subject.description()


def with_fitted_bodies(opened: OpenedTrack, persons: Sequence[Subject], cycle: Cycle) -> tuple[OpenedTrack, Cycle]:
    """Fits the bodies of persons whose shape is open; see `tracker.running.jobs.track.TrackJob.fitted`.

    Args:
        opened: the persons with their models.
        persons: their entries in the configuration, in the same order.
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
    found_of_views = compared_views(steps, scene, sequence.interval_s, cycle.progress)
    of_views = () if found_of_views is None else found_of_views.findings(brings(opened.reading))
    of_things = (_told(persons[k].name, things, k in found.fits) for k, things in found.things.items())
    of_statures = (_unlike(persons[k], models[persons[k].name].stature_m) for k in found.fits)
    findings = (*of_views, *itertools.chain.from_iterable((*of_statures, *of_things)))
    known = {step.frame.index: step.estimates for step in steps}
    opened = replace(opened, scene=scene, fitted_at=tuple(map(line_of, steps)), findings=findings)
    opened = replace(opened, alignment=found_of_views)
    # with the same bodies the same start would be found again, and those begun the other way round as they were before
    cycle = cycle.knowing(known, found.start, believed=not found.fits)
    return opened, replace(cycle, before=replace(cycle.before, refined=not of_views))


def _unlike(person: Subject, fitted_m: float) -> Iterator[str]:
    """Warning if the images show another stature than the configuration."""
    told_m = person.stature_m
    if told_m is not None and not _LEAST_STATURE <= fitted_m / told_m <= _MOST_STATURE:
        yield (
            f"{person.name}: fitted stature {fitted_m:.2f} m, told {told_m:.2f} m, and a fit goes part of the way: "
            "is stature_m right, and the rig in metres?"
        )


def _told(name: str, things: Sequence[Thing], is_fitted: bool) -> Iterator[str]:
    """Warnings about things that the configuration does not mention: those tracked as carried, and all others."""
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
    """The frames of a recording from the first one on that is searched for persons."""
    return itertools.dropwhile(lambda frame: frame.index < cycle.nobody_before, frames())


def known_before(folder: Path, scene: Scene) -> Mapping[int, Sequence[Estimate]]:
    """The poses at which an interrupted run fitted bodies; empty if it fitted none.

    Args:
        folder: its result.
        scene: its persons and rig.
    """
    if not (folder / FITTED_AT).is_file():
        return {}
    found = open_journal(folder, Expected.of(scene), FITTED_AT)
    return {frame: replay.estimates for frame, replay in found.items()}


def save_inputs(opened: OpenedTrack, folder: Path) -> None:
    """Writes the cameras and models of the run, so that its result is readable without the original files."""
    save_rig(opened.sequence.rig, folder / "rig.toml")
    for name, model in opened.models.items():
        save_description(model, folder / MODELS / f"{name}.toml", decimals=None)
    if opened.fitted_at:
        write_whole(folder / FITTED_AT, "".join(opened.fitted_at).encode())


# Use of keypoints that lie beside a recording: for the start, and as evidence beside the rest.


def count(evidence: Evidence, start: Initialization) -> bool:
    """Whether keypoints are used at all: evidence or start are left to `auto`, or name keypoints themselves."""
    chosen = isinstance(evidence, AutoEvidence) or isinstance(start, AutoInitialization)
    return chosen or _names_keypoints(evidence) or _names_keypoints(start)


def beside(files: KeypointFiles, evidence: Evidence, start: Initialization) -> tuple[Evidence, Initialization]:
    """Evidence and start that use keypoints, too, where they are left to `auto`."""
    told: dict[str, Any] = {field.name: getattr(files, field.name) for field in fields(KeypointFiles)}
    if isinstance(evidence, AutoEvidence):
        # See docs/lab/detections_beside.md.
        evidence = TogetherEvidence(of=(evidence, KeypointEvidence(**told)), ranking=(1.0, 1.0), refining=(1.0, 1.0))
    if isinstance(start, AutoInitialization) and start.keypoints is None:
        start = replace(start, keypoints=KeypointInitialization(**told))
    return evidence, start


def _names_keypoints(part: Any) -> bool:
    """Whether evidence or start use keypoints already, as in the configuration that a result keeps."""
    kinds = KeypointEvidence | KeypointInitialization
    inner = (getattr(part, "keypoints", None), *getattr(part, "of", ()))
    return isinstance(part, kinds) or any(isinstance(one, kinds) for one in inner)


# Models with a skin of their own: saved with it, and shown beside it.

# Size of the pictures that show how the parts fit the skin.
_PICTURE_PX = (480, 640)
_DIRECTIONS_DEG = {"front": 0.0, "side": 90.0}


def save_with_skin(
    description: BodyDescription, surface: ScannedSurface, rigging: Rigging, path: Path
) -> BodyDescription:
    """Writes a model with the files of its skin beside it; the model's section about the skin is completed."""
    files = {"surface": str(path.with_suffix(".scan.ply")), "weights": str(path.with_suffix(".scan.npz"))}
    write_surface(surface, Path(files["surface"]))
    write_rigging(rigging, Path(files["weights"]))
    skin = description.skin or SkinSection(surface="")
    description = description.model_copy(update={"skin": skin.model_copy(update=files)})
    save_description(description, path)
    for file in files.values():
        Path(file).unlink()
    return description


def skinned_outcome(
    fits: Mapping[str, Fitted], description: BodyDescription, general: BodyDescription, path: Path
) -> AcquireOutcome:
    """Pictures of the parts over the silhouettes of a skin, and the figures.

    Args:
        fits: part -> its fit to the skin.
        description: of the saved model, with its skin.
        general: of the general body, for its lengths.
        path: of the saved model; the picture lies beside it.
    """
    body = read_description(path).build()
    assert description.skin is not None
    q = measured_pose(body, description.skin)
    parts, cameras = _without_skin(description), _cameras(body, q)
    synthesis, panels, overlaps = CpuSynthesis(), [], {}
    for name, camera in cameras.items():
        mask = synthesis.silhouettes(Scene((Person(body.name, body, q),), Rig((camera,))))[0]
        covered = synthesis.silhouettes(Scene((Person(body.name, parts, q),), Rig((camera,))))[0]
        overlaps[name] = overlap(covered, mask)
        image = np.where(mask[..., None], np.uint8(150), np.uint8(235)).repeat(3, axis=2)
        panels.append(Panel(f"{name}: parts to skin, IoU {overlaps[name]:.3f}", image, mask, camera, q))
    figure, renderer = fit_figure(parts, panels, body.name)
    with replacing(path.with_suffix(".png")) as picture:
        figure.savefig(picture, dpi=100)
    residuals = _residuals(fits)
    rms = float(np.sqrt(np.mean([one.rms_mm**2 for one in residuals])))
    return AcquireOutcome(
        model=path,
        picture=path.with_suffix(".png"),
        shaded_by=renderer,
        stature_m=description.stature_m,
        overlaps=overlaps,
        before={},
        turns_deg=(),
        contour_rms_mm=rms,
        parts=residuals,
        bones=_bones(body, general),
    )


def _without_skin(description: BodyDescription) -> BodyModel:
    return description.model_copy(update={"skin": None}).build()


def _cameras(body: BodyModel, q: Array) -> dict[str, Camera]:
    """Cameras that see the whole skin, however wide it is."""
    assert body.skin is not None
    points = body.skin.world_points(body.world_from_part(q))
    middle, (depth, width, height) = (points.min(axis=0) + points.max(axis=0)) / 2, np.ptp(points, axis=0)
    extent = float(max(height, np.hypot(depth, width) * _PICTURE_PX[1] / _PICTURE_PX[0]))
    found = {}
    for name, degrees in _DIRECTIONS_DEG.items():
        angle, distance = np.radians(degrees), 4.0 * extent
        x, y, z = middle + distance * np.array([np.cos(angle), np.sin(angle), 0.0])
        focal_px = 0.85 * _PICTURE_PX[1] * distance / extent
        found[name] = Camera.looking_at(name, _PICTURE_PX, focal_px, (x, y, z), middle)
    return found


def _residuals(fits: Mapping[str, Fitted]) -> tuple[PartResidual, ...]:
    return tuple(
        PartResidual(
            part=name,
            rms_mm=1000 * fit.rms_m,
            bias_mm=1000 * fit.bias_m,
            contour_m=float(2 * fit.shape[2]),
            size_mm=(2000 * float(fit.shape[0]), 2000 * float(fit.shape[1]), 2000 * float(fit.shape[2])),
            sigma_mm=(0.0, 0.0, 0.0),
        )
        for name, fit in fits.items()
    )


def _bones(body: BodyModel, general: BodyDescription) -> tuple[BoneLength, ...]:
    """Lengths of all links, as scanned and in the general model scaled by the stature."""
    ratio = body.stature_m / general.stature_m if general.stature_m > 0 else 1.0
    before = {name: ratio * np.array(mark.at) for name, mark in general.landmarks.items()}
    after = {mark.name: mark.point for mark in body.landmarks}

    def length(points: dict[str, Array], link: tuple[str, str]) -> float:
        return 1000 * float(np.linalg.norm(points[link[0]] - points[link[1]]))

    return tuple(BoneLength("-".join(link), length(after, link), 0.0, length(before, link)) for link in body.links)
