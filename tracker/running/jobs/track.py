"""Tracking: follows persons through a recording; each frame is written as soon as it is done."""

from __future__ import annotations

import dataclasses
import logging
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar

import pydantic

from tracker.acquisition.variations import telling_bodies
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.keypoint_layouts.views import KeypointFiles
from tracker.bodies.scene import Person, Scene
from tracker.bodies.subject import Subject
from tracker.evidence import Evidence
from tracker.foundation.configuration.components import ReadBy, component, find, standard
from tracker.foundation.errors import ConfigError, name_fault
from tracker.foundation.progress import Progress, silent
from tracker.images.first_frames import FirstFrames
from tracker.images.inspection import findings as found_in
from tracker.images.plate import Plate
from tracker.images.reading import Reading, Sequence
from tracker.results.recording import DEFAULTS, Recording, chosen_recordings, described_recordings
from tracker.results.recording.journal import Expected, OpenJournal, as_kept, open_journal
from tracker.results.smoothed_result import Pictures
from tracker.results.smoothing import Smoothing
from tracker.running.aligned_result import described
from tracker.running.jobs import ResultFolder
from tracker.running.jobs._delivery import (
    MOST_ROUNDS,
    corrected_before,
    counts_of,
    delivered,
    in_step,
    is_live,
    opened_even,
    patiently,
    settings_missing,
    sized,
    timed,
    told_of_delays,
    untold,
)
from tracker.running.jobs._folder import Stop
from tracker.running.jobs._messages import (
    Findings,
    KeypointShare,
    first_sought,
    looked_at,
    run_context,
    tell_choices,
    telling,
    told_before,
)
from tracker.running.jobs._one_moment import OneMoment
from tracker.running.jobs._persons import (
    OpenedTrack,
    beside,
    count,
    description_of,
    known_before,
    save_inputs,
    with_fitted_bodies,
)
from tracker.running.jobs._record import (
    TrackOutcome,
    Tracks,
    check_smoothing,
    compared_by_known,
    recorded,
    smoothed,
)
from tracker.synthesis import Synthesis
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimation import Estimation
from tracker.tracking.initialization import Initialization
from tracker.tracking.loss import LossRule
from tracker.tracking.prediction import Prediction
from tracker.tracking.recorded_plates import behind_who_stays, without_persons
from tracker.tracking.rehearsal import Reopen
from tracker.tracking.sequence import track
from tracker.tracking.trajectory import Step
from tracker.tracking.two_passes import track_twice
from tracker.tracking.windows import held_at_most

__all__ = ["OpenedTrack", "TrackJob", "TrackOutcome"]

log = logging.getLogger("tracker")

_FEWEST_VIEWS = 2
"""One view shows no depth."""


@component
class TrackJob:
    """Follows persons through a recording: poses, sigmas, joints, pictures and a report."""

    resumable: ClassVar[bool] = True

    name: str = "track"
    """Name of the results' folder: `results/NAME/TIME`."""

    reading: Reading = pydantic.Field(
        examples=['{ use = "video", path = "videos/{view}.mp4", rig = "Calib.toml" }; see configs/minimal.toml']
    )
    """The recording."""

    persons: tuple[Subject, ...] = pydantic.Field(
        min_length=1, examples=['[{ name = "anna", model = "human", stature_m = 1.68 }]; see configs/minimal.toml']
    )
    """The persons to follow."""

    synthesis: Synthesis = standard("synthesis", "cpu")
    """Predicts the images of a pose."""

    evidence: Evidence = standard("evidence", "auto")
    """Compares the images with a pose."""

    prediction: Prediction = standard("prediction", "polynomial")
    """Proposes the pose of the next frame."""

    estimation: Estimation = standard("estimation", "hybrid")
    """Finds the pose of a frame."""

    initialization: Initialization = standard("initialization", "auto")
    """Finds the first pose, without a prediction."""

    keypoints: KeypointFiles | None = None
    """2-D keypoints of the recording, from `bodytrack detect` or another program, for instance `{ path =
    "keypoints/{view}_json" }`. Where `evidence` and `initialization` are left to `auto`, the start uses them, and they
    are evidence beside the rest."""

    loss: LossRule = LossRule()
    """Decides when a person counts as lost."""

    passes: int = pydantic.Field(default=2, ge=1, le=2)
    """2: the run tracks a doubtful window of up to 100 frames back again, with the poses found on the way there as
    candidates, and does so for the first 40 frames of a window in which it finds a person; it writes the frames when
    both ways are done. 1: it writes every frame at once."""

    inspection: bool = True
    """Inspect the first frames for wrong input: exchanged or mirrored videos, views out of step, a wrong stature, more
    bodies than persons, a person in a plate, a calibration not upright or not in metres. By the tracked persons, also
    find delays by parts of a frame and cameras turned since calibration."""

    recordings: Annotated[tuple[Recording, ...], ReadBy(chosen_recordings, described_recordings)] = pydantic.Field(
        default_factory=lambda: tuple(find("recording", use)() for use in DEFAULTS)
    )
    """Files to write: a table changes the defaults (`overlay = false`, `c3d = true`), a list replaces them."""

    smoothing: Smoothing | None = None
    """Smoothing of the poses at the end, into the result folder `smoothed` beside the raw ones; None for none."""

    @pydantic.field_validator("reading")
    @classmethod
    def _is_calibrated(cls, reading: Reading) -> Reading:
        if getattr(reading, "rig", reading) is None:
            raise ValueError('the key "rig" is missing, expected the cameras\' calibration, e.g. rig = "Calib.toml"')
        return sized(reading)

    @pydantic.model_validator(mode="after")
    def _looks_at_keypoints(self) -> TrackJob:
        if self.keypoints is not None:
            if not count(self.evidence, self.initialization):
                raise ValueError(
                    "keypoints: evidence and initialization are both chosen, and neither uses them: leave one of them "
                    "to `auto`, or name the keypoints there"
                )
            evidence, start = beside(self.keypoints, self.evidence, self.initialization)
            object.__setattr__(self, "evidence", evidence)
            object.__setattr__(self, "initialization", start)
        return self

    @pydantic.field_validator("persons")
    @classmethod
    def _are_named(cls, persons: tuple[Subject, ...]) -> tuple[Subject, ...]:
        named = tuple(replace(one, name=one.name or f"person{k}") for k, one in enumerate(persons, start=1))
        for name in (one.name for one in named):
            if fault := name_fault(name):
                raise ValueError(f"a person is called {fault}")
        for name, n_times in Counter(one.name for one in named).items():
            if n_times > 1:
                raise ValueError(f'two persons are called "{name}"')
        return named

    @pydantic.model_validator(mode="after")
    def _looks_at_no_frame_twice(self) -> TrackJob:
        if is_live(self.reading) and (missing := "; ".join(settings_missing(self))):
            raise ValueError(f'reading.use = "live": the cameras deliver each frame once, expected {missing}')
        return self

    def open(self, earlier: Path | None = None) -> OpenedTrack:
        """Opens the recording, the models and the state of an interrupted run; see `jobs.Job.open`."""
        if earlier is not None and is_live(self.reading):
            raise ConfigError(
                'reading.use = "live": the frames since the interruption are lost: run anew without --resume'
            )
        models = {subject.name: description_of(subject, earlier) for subject in self.persons}
        reading = corrected_before(self.reading, earlier)
        sequence = opened_even(reading)
        if len(sequence.rig) < _FEWEST_VIEWS:
            raise ConfigError("one view: at least two are needed, for one does not show how far away a person is")
        if self.smoothing is not None:
            check_smoothing(self.smoothing, sequence.interval_s, self.recordings)
        scene = Scene(self.at_rest(models), sequence.rig)
        self.evidence.check(scene)
        self.initialization.check(scene, sequence.known)
        if earlier is None:
            return OpenedTrack(sequence, scene, models, self._frames(sequence), reading)
        kept = self._earlier(earlier, scene, reading), known_before(earlier, scene)
        return OpenedTrack(sequence, scene, models, self._frames(sequence), reading, *kept)

    def at_rest(self, models: Mapping[str, BodyDescription] | None = None) -> tuple[Person, ...]:
        """The persons in their models' reference poses.

        Args:
            models: person -> description of the body; None for the configured ones.

        Raises:
            ModelError: a model cannot be used.
        """
        known = models or {subject.name: subject.description() for subject in self.persons}
        bodies = [known[subject.name].build() for subject in self.persons]
        pairs = zip(self.persons, bodies, strict=True)
        return tuple(Person(subject.name, body, body.rest(), subject.at) for subject, body in pairs)

    def _frames(self, sequence: Sequence) -> Reopen:
        """Opens the recording; its first frames are decoded once, even if several inspections read them."""
        if not (self.inspection or self.passes > 1 or any(one.is_fitted for one in self.persons)):
            return sequence.frames
        n_bytes = sum(3 * width * height for width, height in (camera.size for camera in sequence.rig.cameras))
        return FirstFrames(sequence.frames, held_at_most(n_bytes))

    def _earlier(self, folder: Path, scene: Scene, reading: Reading) -> OpenJournal:
        """Frames of an interrupted run; damaged ones are cut off and logged."""
        first, stride = getattr(reading, "start", 0), getattr(reading, "stride", 1)
        found = open_journal(folder, Expected.of(scene, first, stride))
        if found.fault:
            log.warning("%s: %s: cut there, %d frames are kept", found.path, found.fault, len(found))
        return found

    def cycle(self, opened: OpenedTrack, progress: Progress = silent) -> Cycle:
        """The tracking cycle of these components; the job has fields of the same names.

        Args:
            opened: the persons, and a recording whose views have clean plates, or backdrops.
            progress: gets slow work.
        """
        sequence = opened.sequence

        def backdrops() -> tuple[Plate | None, ...]:
            return sequence.backdrops

        names = {field.name for field in dataclasses.fields(self)} & {field.name for field in dataclasses.fields(Cycle)}
        parts = {name: getattr(self, name) for name in names}
        cycle = Cycle(**parts, plates=sequence.plates, backdrops=backdrops, progress=progress)
        cycle = without_persons(cycle, opened.scene, opened.frames)
        return replace(cycle, nobody_before=self._first_in_view(opened, cycle))

    def _first_in_view(self, opened: OpenedTrack, cycle: Cycle) -> int:
        """Number of the first frame to search for persons; given poses are of the first frame."""
        if getattr(self.initialization, "poses", None) is not None or is_live(opened.sequence):
            return 0
        return first_sought(opened, cycle, getattr(opened.reading, "start", 0), self.passes)

    def fitted(self, opened: OpenedTrack, cycle: Cycle) -> tuple[OpenedTrack, Cycle]:
        """The persons with bodies fitted to the recording, and a cycle that reuses what the fit found.

        Args:
            opened: the persons with their models; those of an interrupted run with its fitted bodies.
            cycle: the components; they report slow work.

        Raises:
            InitializationError: nobody was found.
        """
        sequence = opened.sequence
        # a woman whose evidence is chosen for her alone was worse from two of three starts with them
        unplated = sequence.makes_plates and all(plate is None for plate in cycle.plates)
        if unplated and self.evidence.takes_part_plates():
            # of an interrupted run, too, as they were before bodies were fitted
            told = {k: subject.description().build() for k, subject in enumerate(self.persons) if opened.done}
            cycle = behind_who_stays(cycle, opened.scene.with_bodies(told), opened.frames)
        if not opened.done:
            opened, cycle = with_fitted_bodies(opened, self.persons, cycle)
        elif opened.known:
            found = compared_by_known(opened.known, opened.frames(), opened.scene, sequence.interval_s)
            opened, cycle = replace(opened, alignment=found), cycle.knowing(opened.known)
            refined = found is None or not found.findings()
            cycle = replace(cycle, before=replace(cycle.before, refined=refined))
        return opened, cycle

    def execute(self, opened: OpenedTrack, folder: ResultFolder, progress: Progress) -> TrackOutcome:
        """Tracks, and writes each frame as soon as it is done; see `jobs.Job.execute`."""
        begin = time.perf_counter()
        progress(f"{self.name}: {opened.sequence.n_frames} frames, results in {folder.path}")
        stop = Stop()
        findings = Findings(self.inspection, progress, told_before(folder.path) if opened.done else ())
        cycle = replace(self.cycle(opened, progress), leaving=stop.heard)
        choices = self._choices(opened, cycle)
        tell_choices(choices, progress)
        if self.inspection:
            opened, cycle = self._looked_at(opened, cycle, findings)
            choices = self._choices(opened, cycle)
        opened, cycle = self.fitted(opened, cycle)
        sequence = opened.sequence
        if opened.fitted_at and not opened.done:
            progress(f"step 3 of 3: tracking all {sequence.n_frames} frames with the fitted body")
        findings.add(opened.findings)
        if any(plate is not None and plate.stays for plate in cycle.plates):
            choices["evidence"] = self.evidence.told(cycle.plates)
            tell_choices({"evidence": choices["evidence"]}, progress)
        save_inputs(opened, folder.path)
        context = run_context(self, opened, folder, choices, findings)
        steps, live = self.followed(opened, cycle), counts_of(sequence)
        tracked, share = Tracks(), KeypointShare(self.evidence, self.loss.ambiguous_above)
        moment = OneMoment(opened, self.synthesis, findings.add)

        def conclude() -> None:
            context.details["keypoints"].extend(filter(None, [share.told()]))
            if moment.found is not None:
                context.details["alignment"].update(described(moment.found))
            elif self.inspection and not (opened.fitted_at or opened.known):
                findings.add(tracked.told(opened.scene, sequence, progress))

        steps = steps if live is None else timed(steps, live)
        steps = telling_bodies(steps, opened.models, opened.done or ())
        steps = tracked.kept(share.kept(telling(map(as_kept, steps), findings.add)))
        steps = moment.of(steps, self.inspection and self.passes > 1)
        outcome = recorded(self.recordings, context, steps, folder, (progress, stop), conclude)
        if self.smoothing is not None and outcome.n_frames:
            outcome = smoothed(outcome, self.smoothing, Pictures(self.recordings, opened.frames, progress))
        remarks = () if live is None else (live.told(),)
        return replace(outcome, seconds=time.perf_counter() - begin, keypoints=share.told(), remarks=remarks)

    def followed(self, opened: OpenedTrack, cycle: Cycle) -> Iterator[Step]:
        """The frames as they are tracked, in one pass or in two.

        Args:
            opened: the recording, and the persons with the bodies of the tracking.
            cycle: the components.

        Raises:
            TrackerError: an image cannot be read, or the first frames show no start pose.
        """
        if is_live(opened.sequence):
            return track(opened.frames(), opened.scene, patiently(cycle, opened.sequence))
        way = track if self.passes == 1 else track_twice
        return way(opened.frames(), opened.scene, cycle, opened.done or {}, opened.frames)

    def _looked_at(self, opened: OpenedTrack, cycle: Cycle, findings: Findings) -> tuple[OpenedTrack, Cycle]:
        """Inspects the first frames, and again after views were brought in step; reports warnings."""
        seen = looked_at(opened, cycle, getattr(self.reading, "stride", 1))
        for _ in range(MOST_ROUNDS):
            corrected = None if seen is None else in_step(opened.reading, opened.sequence, seen)
            if corrected is None:
                break
            sequence = opened_even(corrected)
            opened = replace(opened, reading=corrected, sequence=sequence, frames=self._frames(sequence))
            cycle.progress(f"reading: {told_of_delays(self.reading, corrected)}")
            cycle = replace(self.cycle(opened, cycle.progress), leaving=cycle.leaving)
            seen = looked_at(opened, cycle, getattr(self.reading, "stride", 1))
        if seen is not None:
            if words := untold(seen):
                cycle.progress(words)
            findings.add(found_in(seen))
        return opened, cycle

    def _choices(self, opened: OpenedTrack, cycle: Cycle) -> dict[str, str]:
        """Stage -> choice of its component; empty where it had none."""
        sequence = opened.sequence
        known = sequence.known if cycle.plates == sequence.plates else cycle.plates
        return {
            "reading": "; ".join(filter(None, (told_of_delays(self.reading, opened.reading), delivered(sequence)))),
            "synthesis": getattr(self.synthesis, "choice", ""),
            "evidence": self.evidence.told(known),
            "initialization": self.initialization.check(opened.scene, known),
        }
