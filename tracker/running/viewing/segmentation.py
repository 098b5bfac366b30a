"""Contours by level sets along a finished run, with and without the shape prior: Rosenhahn et al. 2006, section 2.1."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Scene
from tracker.evidence import Memory
from tracker.evidence.level_set import LevelSetEvidence
from tracker.evidence.measures.outlines import overlap
from tracker.foundation.arrays import Image, Mask
from tracker.images.sight import Sight
from tracker.results.result import Result
from tracker.running.viewing.images import images_of
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Replay

STEPS = {"threshold_dynamics": (0, 1, 2, 4, 12), "descent": (0, 8, 20, 60)}
"""Way of minimization -> after how many steps the contour is kept; the first is where it begins, the last the result.

A step of the descent moves the contour by half a pixel at most, one of threshold dynamics by some pixels.
"""


@dataclass(frozen=True)
class Chosen:
    """Which frames are segmented, and from where."""

    every: int = 10
    """Every so many frames of the run one is."""

    first: int = 0
    behind: int | None = None
    """Numbers of the first frame, and of the one behind the last."""

    back: int = 1
    """The contour begins at the pose so many frames before."""

    def has(self, k: int, frame: int) -> bool:
        """Whether the k-th frame of a run, of this number, is segmented."""
        return k % self.every == 0 and self.first <= frame and (self.behind is None or frame < self.behind)


@dataclass(frozen=True)
class SegmentedView:
    """One view of a frame."""

    name: str
    image: Image
    pose: ViewContours
    """Of the model at the pose found."""

    silhouette: Mask
    """(H, W) what it covers."""

    alone: tuple[Mask, ...]
    """(H, W) each: the region after some steps of eq. 2, without the shape prior; none where nothing can be said."""

    held: tuple[Mask, ...]
    """The same of eq. 4, with the pose found as its prior."""


@dataclass(frozen=True)
class Segmented:
    """A frame of a run: the pose found, and the contours of all views."""

    frame: int
    time_s: float
    statuses: tuple[str, ...]
    views: tuple[SegmentedView, ...]
    """Those with an image; none where everybody is lost. Who is lost is in none of them."""

    def overlaps(self) -> tuple[float, float]:
        """Intersection over union of model and region, without and with the prior, mean over the views; may be NaN."""
        alone, held = (
            [overlap(stages[-1], view.silhouette) for view in self.views for stages in (getattr(view, way),) if stages]
            for way in ("alone", "held")
        )
        return float(np.mean(alone)) if alone else np.nan, float(np.mean(held)) if held else np.nan


def segmented(result: Result, by: LevelSetEvidence, chosen: Chosen) -> Iterator[Segmented]:
    """Segments frames of a run; what persons look like is learnt on the way, as tracking by level sets does it.

    Args:
        result: the run; of any evidence.
        by: its settings.
        chosen: which frames.

    Raises:
        TrackerError: the recording is not there any more.
    """
    replays = {replay.index: replay for replay in result.replays}
    memory: Memory = None
    before: list[Replay] = []
    for k, frame in enumerate(frame for frame in images_of(result) if frame.index in replays):
        replay, sight = replays[frame.index], Sight(frame)
        before = [*before, replay][-chosen.back - 1 :]
        who = [n for n, estimate in enumerate(replay.estimates) if not estimate.lost]
        # of who was lost then, the contour begins at the pose of now
        begins = replace(replay, estimates=_known_then(before[0], replay))
        scenes = _posed(result, begins, who), _posed(result, replay, who)
        if chosen.has(k, frame.index):
            yield _segmented(by, memory, sight, scenes, replay)
        if len(who) == len(replay.estimates):  # who is lost would be learnt as background
            scene = scenes[1]
            memory = by.learned(memory, sight, scene, CpuSynthesis().contours(scene), _trusted(replay, scene))


def _known_then(before: Replay, now: Replay) -> tuple[Estimate, ...]:
    """What was known of each person in a frame before, of who was lost then what is known now."""
    pairs = zip(before.estimates, now.estimates, strict=True)
    return tuple(late if early.lost else early for early, late in pairs)


def _posed(result: Result, replay: Replay, who: Sequence[int]) -> Scene:
    """Some of the persons at the poses of a frame."""
    persons = result.scene.with_poses(tuple(estimate.q for estimate in replay.estimates)).persons
    return replace(result.scene, persons=tuple(persons[n] for n in who))


def _segmented(
    by: LevelSetEvidence, memory: Memory, sight: Sight, scenes: tuple[Scene, Scene], replay: Replay
) -> Segmented:
    """A frame whose contours begin at the first scene's outline, and are held by that of the second."""
    statuses = tuple(str(estimate.verdict) for estimate in replay.estimates)
    if not scenes[1].persons:
        return Segmented(replay.index, replay.time_s, statuses, ())
    starts, priors = (CpuSynthesis().silhouettes(scene) for scene in scenes)
    found, steps = CpuSynthesis().contours(scenes[1]), STEPS[by.way]
    freely, views = replace(by, shape=0.0), []
    for v, name in enumerate(scenes[1].rig.names):
        known, image = None if memory is None else memory[v], sight.frame.images[v]
        if image is not None:
            alone = freely.stages(sight, v, (starts[v], starts[v]), known, steps)
            held = by.stages(sight, v, (starts[v], priors[v]), known, steps)
            views.append(SegmentedView(name, image, found.of(v), priors[v], alone, held))
    return Segmented(replay.index, replay.time_s, statuses, tuple(views))


def _trusted(replay: Replay, scene: Scene) -> Mask:
    """(P,) parts of the scene whose places can be learnt from."""
    persons = zip(replay.estimates, scene.persons, strict=True)
    parts: Mask = np.concatenate([np.full(len(who.body.parts), not found.doubtful) for found, who in persons])
    return parts
