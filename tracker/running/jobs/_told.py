"""What a tracking run tells of itself: what components chose by themselves, and what looks wrong in the input."""

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
"""Limbs that are named in a line."""


class KeypointShare:
    """The frames of a run so far, with what their accounts would be without the keypoints' part."""

    def __init__(self, evidence: Evidence, doubt_above: float) -> None:
        """Nothing is counted yet.

        Args:
            evidence: of the run.
            doubt_above: share of a limb's contour that is left over, from which on the run doubts it.
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
        """What keypoints changed, in a sentence; empty where the run has none."""
        if self._keypoints is None or not self._n_frames:
            return ""
        parts = [self._started] if self._started else []
        parts.append(
            f"without them {_limbs(self._held, len(self._frames['held']), self._n_frames)} would be in doubt"
            if self._held
            else "no limb would be in doubt for want of them"
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
    """The keypoints among a run's evidence, and their share of its accounts; None where they are none of several."""
    if isinstance(evidence, TogetherEvidence):
        for one, weight in zip(evidence.of, evidence.refining, strict=True):
            if isinstance(one, KeypointEvidence) and 0 < weight < sum(evidence.refining):
                return one, weight / sum(evidence.refining)
    return None, 0.0


def _without(account: Account, own: Account, share: float) -> Account:
    """An account without the part of one kind of evidence; see `tracker.evidence.measures.account.summed`."""
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
"""Looked at where that is asked for: half a gigabyte of foregrounds of four views of 1920 x 1080."""


class Findings:
    """What looks wrong in the input of a run, told as soon as it is found."""

    def __init__(self, wanted: bool, progress: Progress, earlier: Iterable[str] = ()) -> None:
        self.lines = list(earlier)
        """All that was told so far, each once; it grows while the run goes on."""

        self._wanted, self._progress = wanted, progress

    def add(self, found: Iterable[str]) -> None:
        """Tells more of it, one line each; nothing where the input is not to be looked at."""
        for line in found if self._wanted else ():
            log.warning("%s%s", WARNING, line)
            self._progress(f"{WARNING}{line}")
            if line not in self.lines:  # a resumed run may find again what it has told before
                self.lines.append(line)


def told_before(folder: Path) -> tuple[str, ...]:
    """What an interrupted run has found in its input; nothing if it has kept no `run.json` that can be read."""
    try:
        return tuple(map(str, json_of(folder / "run.json", ConfigError)["findings"]))
    except (ConfigError, KeyError, TypeError):
        return ()


def tell_choices(choices: Mapping[str, str], progress: Progress) -> None:
    """Says what was chosen by itself, if anything was.

    Args:
        choices: stage -> what it goes by; empty where the configuration says it.
        progress: told of each.
    """
    for stage, choice in choices.items():
        if choice:
            log.info("%s: %s", stage, choice)
            progress(f"{stage}: {choice}")


def run_context(
    job: Job, opened: OpenedTrack, folder: ResultFolder, choices: Mapping[str, str], findings: Findings
) -> RunContext:
    """What recordings need to know of a run, and keep with its result.

    Args:
        job: what is done.
        opened: its recording, and the persons with the bodies that they are tracked with.
        folder: where results go.
        choices: as of `tell_choices`.
        findings: those so far; those to come are kept as well.
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


# What a run says of the poses that it starts from.

_APART_M = 0.4
"""Between the middles of two bodies, at least; of poses of one body they are nearer."""

_MOST_LEFT_OVER = 2.0
"""By what factor more than the best one another body may leave over. Of two persons either is left over by the other
one's pose, too: theirs left 1.3 and 1.7 times as much; where one person is alone, and the other "body" a shadow or a
flaw of the plates, 11 and 12 times as much."""


def telling(steps: Iterable[Step], tell: Callable[[tuple[str, ...]], None]) -> Iterator[Step]:
    """The frames of a run as they come; what is to be said of a start in one of them is told before it."""
    for step in steps:
        if step.start is not None:
            tell(told_of_start(step.start, step.scene))
        yield step


def told_of_start(start: Start, scene: Scene) -> tuple[str, ...]:
    """Persons whose given pose fits less well than the same turned round, and those who may be another body there.

    Args:
        start: the poses, and what else was tried.
        scene: the persons, in the same order.
    """
    return (*_turned_round(start, scene), *_elsewhere(start, scene))


def _turned_round(start: Start, scene: Scene) -> tuple[str, ...]:
    """Of poses that were given, left and right exchanged."""
    return tuple(
        f"{scene.persons[k].name} may be turned round: of the start pose given {given:.0%} of the contour are left "
        f"over, of the same facing the other way {turned:.0%}; check left and right in the poses or keypoints that it "
        "is from, or leave them out, and the person is looked for"
        for k, (given, turned) in start.turned_round.items()
    )


def _elsewhere(start: Start, scene: Scene) -> Iterator[str]:
    """Where else bodies stand out that fit a person hardly worse; without plates poses are scattered over the floor."""
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


# What a tracking job sees in the first frames, before it tracks: input that is wrong, and when persons come in.


def looked_at(opened: OpenedTrack, cycle: Cycle, stride: int) -> Survey | None:
    """What the first frames show; None of an interrupted run, which has told it already.

    Args:
        opened: the recording and the persons.
        cycle: with the plates, and the frame from which on persons are looked for; told what takes long.
        stride: of the frames that are read, in frames of the recording.

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
