"""What each kind of evidence saw in one frame of a finished run: figure 6 of Gavrila & Davis 1996, for all evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import EvidencePicture
from tracker.evidence.auto import WHERE_NOBODY_STAYS, WITHOUT_PLATES
from tracker.evidence.measures.comparison import Comparison
from tracker.foundation.errors import ConfigError
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.results.result import Result
from tracker.running.viewing.images import chosen_images, job_of
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.cycle import State
from tracker.tracking.estimate import Estimate
from tracker.tracking.limb_probabilities import limb_probabilities
from tracker.tracking.trajectory import Replay, Step

BEFORE = 16
"""Frames before the one shown that colours are learnt from and places followed through: half of what a colour was is
forgotten in four frames."""

_NOT_MADE_AGAIN = (
    "the run knew what is behind the person where nobody stays; such plates are not made again: no foreground, "
    "and without it contours, colours and motion alone"
)


@dataclass(frozen=True)
class SeenView:
    """One view of the frame."""

    name: str
    image: EvidencePicture
    pictures: tuple[EvidencePicture, ...]
    expected: ViewContours
    """Of the prediction; of the pose found where there was none."""

    found: ViewContours


@dataclass(frozen=True)
class SeenFrame:
    """The frame, and the person asked about."""

    frame: int
    time_s: float
    person: str
    estimate: Estimate
    probabilities: Mapping[str, float]
    """Limb -> how probable it is that it is right; see `tracker.tracking.limb_probabilities`."""

    differs: str
    """What the run had and is not seen here; empty for nothing."""

    views: tuple[SeenView, ...]
    """Those with an image."""


def seen_in_frame(result: Result, number: int, person: str) -> SeenFrame:
    """Looks at a frame once more as the run did: by its evidence, from its prediction, with its plates.

    Colours and followed places are learnt anew over the `BEFORE` frames before, at the poses of the result, so they
    may differ a little from the run's.

    Args:
        result: the run.
        number: of the frame.
        person: whose pose is looked at.

    Raises:
        TrackerError: the result has no such frame or person, or the recording is not there any more.
    """
    who = list(result.bodies).index(result.person(person).name)
    replays = _until(result, number)
    job = job_of(result, chosen_images(result))
    sequence, state = job.reading.open(), State.before(result.scene)
    for frame in sequence.frames():
        if frame.index not in replays:
            continue
        replay = replays[frame.index]
        sight, step = Sight(frame, _plates(result, sequence.plates)), _step(result, frame, replay)
        if frame.index == number:
            return _seen(result, (job.evidence, job.prediction), (sight, step, state), who)
        state = state.after(sight, step, job.evidence)
    raise ConfigError(f"{result.folder}: the recording has no image of frame {number} any more")


def _until(result: Result, number: int) -> Mapping[int, Replay]:
    """The frame and some before it, by their numbers."""
    frames = result.frames.tolist()
    if number not in frames:
        nearest = min(frames, key=lambda one: abs(one - number))
        raise ConfigError(f"{result.folder}: no frame {number}, the nearest is {nearest}")
    k = frames.index(number)
    return {replay.index: replay for replay in result.replays[max(k - BEFORE, 0) : k + 1]}


def _plates(result: Result, plates: tuple[Plate | None, ...]) -> tuple[Plate | None, ...]:
    """The plates that the run used: those that a recording makes of itself only where the run took them."""
    none = WITHOUT_PLATES in _told(result)
    return tuple(None if plate is None or (none and plate.recorded) else plate for plate in plates)


def _told(result: Result) -> str:
    """What the run told of what its components chose by themselves."""
    choices: Any = result.details.get("choices", {})
    return "; ".join(map(str, choices.values())) if isinstance(choices, dict) else ""


def _step(result: Result, frame: Frame, replay: Replay) -> Step:
    scene = result.scene.with_poses(tuple(estimate.q for estimate in replay.estimates))
    return Step(frame, scene, replay.estimates, CpuSynthesis().contours(scene))


def _seen(result: Result, by: tuple[Any, Any], moment: tuple[Sight, Step, State], who: int) -> SeenFrame:
    (evidence, prediction), (sight, step, state) = by, moment
    expected = CpuSynthesis().contours(_predicted(step, state, prediction))
    observed = evidence.observe(sight, expected, state.memory)
    asked = Comparison(step.scene, who, CpuSynthesis(), observed)
    views = []
    for v, name in enumerate(result.rig.names):
        if (image := sight.frame.images[v]) is not None:
            drawn = evidence.pictures(asked, sight, v)
            views.append(SeenView(name, EvidencePicture("image", image), drawn, expected.of(v), step.fitted.of(v)))
    person, estimate = step.scene.persons[who], step.estimates[who]
    right = {} if estimate.lost else limb_probabilities(person.body, estimate)
    differs = _NOT_MADE_AGAIN if WHERE_NOBODY_STAYS in _told(result) else ""
    return SeenFrame(step.frame.index, step.frame.time_s, person.name, estimate, right, differs, tuple(views))


def _predicted(step: Step, state: State, prediction: Any) -> Scene:
    """The persons as predicted; who was in no frame before, as found."""
    time_s, poses = step.frame.time_s, []
    for person, history in zip(step.scene.persons, state.histories, strict=True):
        poses.append(person.q if history is None else prediction.predict(person.body, history, time_s)[0])
    return step.scene.with_poses(tuple(poses))
