"""Messages of a tracking run: choices of its components, and input that looks wrong."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.rig import told_world
from tracker.evidence import Evidence
from tracker.evidence.keypoints import KeypointEvidence, ObservedKeypoints
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError, SequenceError
from tracker.foundation.progress import WARNING, Progress
from tracker.foundation.source_files import json_of
from tracker.images.inspection import Survey, first_in_view, other_colours, survey
from tracker.results.recording import RunContext
from tracker.running.jobs import Job, ResultFolder, described, versions
from tracker.running.jobs._delivery import chosen_settings, corrections, counts_of
from tracker.running.jobs._persons import OpenedTrack, frames_in_view
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.cycle import Cycle
from tracker.tracking.limb_probabilities import limbs_left_over
from tracker.tracking.start import Start
from tracker.tracking.trajectory import Step

_MOST_NAMED = 4
"""Largest number of limbs named in a line."""


class KeypointShare:
    """Compares the frames of a run with what their accounts would be without keypoints."""

    def __init__(self, evidence: Evidence, doubt_above: float) -> None:
        """Nothing is counted yet.

        Args:
            evidence: of the run.
            doubt_above: share of a limb's contour left over from which on the run doubts it.
        """
        self._doubt_above, self._n_frames, self._started = doubt_above, 0, ""
        self._held, self._doubted = Counter[str](), Counter[str]()
        self._frames: dict[str, set[int]] = {"held": set(), "doubted": set()}
        self._keypoints, self._share = _part_of(evidence)

    def kept(self, steps: Iterable[Step]) -> Iterator[Step]:
        """The frames of a run as they come."""
        for step in steps:
            self._add(step)
            yield step

    def told(self) -> str:
        """Effect of keypoints, in a sentence; empty without keypoints."""
        if self._keypoints is None or not self._n_frames:
            return ""
        parts = [self._started] if self._started else []
        parts.append(
            f"without them {_limbs(self._held, len(self._frames['held']), self._n_frames)} would be in doubt"
            if self._held
            else "no limb would be in doubt without them"
        )
        if self._doubted:
            parts.append(
                f"{_limbs(self._doubted, len(self._frames['doubted']), self._n_frames)} are in doubt by them alone"
            )
        return f"keypoints: {'; '.join(parts)}"

    def _add(self, step: Step) -> None:
        if self._keypoints is None:
            return
        self._n_frames += 1
        if step.start is not None and not self._started:
            self._started = (
                f"the start in frame {step.frame.index} is {'' if step.start.by_keypoints else 'not '}theirs"
            )
        missing = set(step.frame.missing)
        seen = tuple(v not in missing for v in range(len(step.scene.rig)))
        blank = replace(step.frame, images=(None,) * len(seen), masks=())
        observed = ObservedKeypoints(blank, seen)
        scene = step.scene.with_poses(tuple(one.q for one in step.estimates))
        for k, estimate in enumerate(step.estimates):
            if not estimate.lost:
                own = self._keypoints.account(Comparison(scene, k, CpuSynthesis(), observed), estimate.q)
                self._count(step.frame.index, scene, k, estimate.account, own)

    def _count(self, frame: int, scene: Scene, k: int, account: Account, own: Account) -> None:
        if not own.visible_px.any() or not account.visible_px.any():
            return
        person = scene.persons[k]
        both = limbs_left_over(person.body, account)
        images = limbs_left_over(person.body, _without(account, own, self._share))
        for limb in person.body.limbs:
            name = limb if len(scene.persons) == 1 else f"{person.name}'s {limb}"
            if both[limb] <= self._doubt_above < images[limb]:
                self._held[name] += 1
                self._frames["held"].add(frame)
            elif images[limb] <= self._doubt_above < both[limb]:
                self._doubted[name] += 1
                self._frames["doubted"].add(frame)


def _part_of(evidence: Evidence) -> tuple[KeypointEvidence | None, float]:
    """The keypoints among a run's evidence, and their share of its accounts; None if there is no other evidence."""
    if isinstance(evidence, TogetherEvidence):
        for one, weight in zip(evidence.of, evidence.refining, strict=True):
            if isinstance(one, KeypointEvidence) and 0 < weight < sum(evidence.refining):
                return one, weight / sum(evidence.refining)
    return None, 0.0


def _without(account: Account, own: Account, share: float) -> Account:
    """An account without one kind of evidence; see `tracker.evidence.measures.account.summed`."""
    visible = np.maximum(account.visible_px - share * own.visible_px, 0.0) / (1 - share)
    explained = np.clip(account.explained_px - share * own.explained_px, 0.0, None) / (1 - share)
    missed = np.maximum(account.missed_px - share * own.missed_px, 0.0) / (1 - share)
    return replace(account, visible_px=visible, explained_px=np.minimum(explained, visible), missed_px=missed)


def _limbs(counted: Counter[str], n_frames: int, n_all: int) -> str:
    named = [f"{limb} {n}" for limb, n in counted.most_common(_MOST_NAMED)]
    more = len(counted) - len(named)
    others = f" and {more} more" if more else ""
    n = sum(counted.values())
    return f"{n} limb{'s' * (n > 1)} in {n_frames} of {n_all} frames ({', '.join(named)}{others})"


log = logging.getLogger("tracker")

_LONG_FRAMES = 1000
"""Inspects foregrounds only on demand: those of four views of 1920 x 1080 take half a gigabyte."""


class Findings:
    """Warnings about the input of a run, reported at once."""

    def __init__(self, wanted: bool, progress: Progress, earlier: Iterable[str] = ()) -> None:
        self.lines = list(earlier)
        """All warnings so far, each once; the list grows during the run."""

        self._wanted, self._progress = wanted, progress

    def add(self, found: Iterable[str]) -> None:
        """Reports warnings, one line each; nothing if the input is not inspected."""
        for line in found if self._wanted else ():
            log.warning("%s%s", WARNING, line)
            self._progress(f"{WARNING}{line}")
            if line not in self.lines:  # a resumed run may find again what it reported before
                self.lines.append(line)


def told_before(folder: Path) -> tuple[str, ...]:
    """Warnings of an interrupted run about its input; empty without a readable `run.json`."""
    try:
        return tuple(map(str, json_of(folder / "run.json", ConfigError)["findings"]))
    except (ConfigError, KeyError, TypeError):
        return ()


def tell_choices(choices: Mapping[str, str], progress: Progress) -> None:
    """Reports the choices of components, if there are any.

    Args:
        choices: stage -> its choice; empty where the configuration decides.
        progress: told of each.
    """
    for stage, choice in choices.items():
        if choice:
            log.info("%s: %s", stage, choice)
            progress(f"{stage}: {choice}")


def run_context(
    job: Job, opened: OpenedTrack, folder: ResultFolder, choices: Mapping[str, str], findings: Findings
) -> RunContext:
    """Facts about a run that recordings need and keep with its result.

    Args:
        job: the tracking job.
        opened: its recording, and the persons with the bodies of the tracking.
        folder: place of the results.
        choices: as for `tell_choices`.
        findings: warnings so far; later ones are kept as well.
    """
    sequence = opened.sequence
    details = {
        "config": described(job),
        "choices": {stage: choice for stage, choice in choices.items() if choice},
        "versions": versions(),
        "inputs": dict(folder.inputs),
        "findings": findings.lines,
        "keypoints": [],
        "alignment": {},
        "bodies": {name: model.about for name, model in opened.models.items()},
    }
    asked = getattr(job, "reading", None)
    if chosen := chosen_settings(asked, sequence) | corrections(asked, opened.reading):
        details["images"] = chosen
    if (live := counts_of(sequence)) is not None:
        details["live"] = vars(live)  # they are counted on while the run lasts
    return RunContext(
        name=job.name,
        folder=folder.path,
        scene=opened.scene,
        fps=sequence.fps,
        interval_s=sequence.interval_s,
        n_frames=sequence.n_frames,
        details=details,
        resumed=frozenset(opened.done or ()),
    )


# Warnings about start poses.

_APART_M = 0.4
"""Least distance between the middles of two bodies; poses of one body are closer."""

_MOST_LEFT_OVER = 2.0
"""Another body may leave over this many times as much as the best one. Each of two persons leaves over the other one's
pose, too: two real persons left 1.3 and 1.7 times as much. A person alone, beside a shadow or a flaw of the plates,
left 11 and 12 times as much."""


def telling(steps: Iterable[Step], tell: Callable[[tuple[str, ...]], None]) -> Iterator[Step]:
    """The frames of a run as they come; warnings about a start come before its frame."""
    for step in steps:
        if step.start is not None:
            tell(told_of_start(step.start, step.scene))
        yield step


def told_of_start(start: Start, scene: Scene) -> tuple[str, ...]:
    """Warns of persons whose given pose fits better turned round, and of persons that may be another body.

    Args:
        start: the poses, and the other poses tried.
        scene: the persons, in the same order.
    """
    return (*_turned_round(start, scene), *_elsewhere(start, scene))


def _turned_round(start: Start, scene: Scene) -> tuple[str, ...]:
    """Warnings about given poses with left and right exchanged."""
    return tuple(
        f"{scene.persons[k].name} may be turned round: the given start pose is right with a probability of "
        f"{given:.0%}, and the same pose facing the other way fits better; check left and right in its poses or "
        "keypoints, or leave them out, and the run searches for the person"
        for k, given in start.turned_round.items()
    )


def _elsewhere(start: Start, scene: Scene) -> Iterator[str]:
    """Places of other bodies that fit a person almost as well; without plates poses are scattered over the floor."""
    for person, ranking, axes in zip(scene.persons, start.hypotheses, start.evidence, strict=False):
        places: list[Array] = []
        for one in ranking if axes else ():
            if one.left_over > _MOST_LEFT_OVER * ranking[0].left_over:
                continue
            place = person.body.landmarks_in_world(one.q)[:, :2].mean(axis=0)
            if all(np.linalg.norm(place - other) > _APART_M for other in places):
                places.append(place)
        if len(places) > 1:
            first, *others = (f"({x:.1f}, {y:.1f})" for x, y in places)
            yield (
                f"{person.name} may be one of {len(places)} bodies: the model fits best at {first} m, and was tried at "
                f"{', '.join(others)} too; if that is the wrong one say where the person is at the start, for "
                f'instance persons = [{{ name = "{person.name}", at = [{places[1][0]:.1f}, {places[1][1]:.1f}], ... }}]'
            )


# Inspection of the first frames before tracking: wrong input, and the frame in which persons come in.


def looked_at(opened: OpenedTrack, cycle: Cycle, stride: int) -> Survey | None:
    """Findings in the first frames; None for an interrupted run, which has reported them already.

    Args:
        opened: the recording and the persons.
        cycle: with the plates, and the first frame to search; reports slow work.
        stride: between the frames that are read, in frames of the recording.

    Raises:
        SequenceError: images are grey and plates are not, or the other way round.
    """
    if opened.done:
        return None
    cycle.progress(told_world(opened.sequence.rig))
    cycle.progress("looking at the first frames")
    frames = frames_in_view(opened.frames, cycle)
    longer = getattr(opened.reading, "in_step", "") == "long"
    seen = survey(frames, opened.scene, cycle.plates, stride, *([_LONG_FRAMES] if longer else []))
    if fault := other_colours(seen):
        raise SequenceError(fault)
    return seen


def first_sought(opened: OpenedTrack, cycle: Cycle, start: int, passes: int) -> int:
    """Number of the first frame to search for persons, in which they are in view; 0 if that is unknown.

    Args:
        opened: the recording and the persons.
        cycle: with the plates; gets a frame other than the first one.
        start: the first frame that is read.
        passes: number of passes over the recording.
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
