"""Contours by level sets along a finished run, with and without the shape prior: Rosenhahn et al. 2006, section 2.1."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Scene
from tracker.evidence import Memory
from tracker.evidence.level_set import LevelSetEvidence
from tracker.evidence.measures.outlines import overlap
from tracker.foundation.arrays import Array, Image, Mask
from tracker.images.sight import Sight
from tracker.results.result import Result
from tracker.running.viewing.images import images_of
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Replay

STEPS = {"threshold_dynamics": (0, 1, 2, 4, 12), "descent": (0, 8, 20, 60)}
"""Way of minimization -> steps after which the contour is kept; the first is the start, the last the result.

A step of the descent moves the contour by half a pixel at most, one of threshold dynamics by some pixels.
"""


@dataclass(frozen=True)
class Chosen:
    """Frames to segment, and their first contours."""

    every: int = 10
    """Every so many frames of the run."""

    first: int = 0
    behind: int | None = None
    """Numbers of the first frame, and of the one behind the last."""

    back: int = 1
    """The contour begins at the pose so many frames before."""

    def has(self, k: int, frame: int) -> bool:
        """Whether the k-th frame of a run, with this number, is segmented."""
        return k % self.every == 0 and self.first <= frame and (self.behind is None or frame < self.behind)


@dataclass(frozen=True)
class SegmentedView:
    """One view of a frame."""

    name: str
    image: Image
    pose: ViewContours
    """Contours of the model at the pose found."""

    silhouette: Mask
    """(H, W) its silhouette."""

    alone: tuple[Mask, ...]
    """(H, W) each: the region after some steps of eq. 2, without the shape prior; empty if there is none."""

    held: tuple[Mask, ...]
    """The same for eq. 4, with the pose found as its prior."""


@dataclass(frozen=True)
class Segmented:
    """A frame of a run: the pose found, and the contours of all views."""

    frame: int
    time_s: float
    statuses: tuple[str, ...]
    views: tuple[SegmentedView, ...]
    """Views with an image; none if every person is lost. Lost persons are in none of them."""

    def overlaps(self) -> tuple[float, float]:
        """Intersection over union of model and region, without and with the prior, mean over the views; may be NaN."""
        alone, held = (
            [overlap(stages[-1], view.silhouette) for view in self.views for stages in (getattr(view, way),) if stages]
            for way in ("alone", "held")
        )
        return float(np.mean(alone)) if alone else np.nan, float(np.mean(held)) if held else np.nan


def segmented(result: Result, by: LevelSetEvidence, chosen: Chosen) -> Iterator[Segmented]:
    """Segments frames of a run; it learns the persons' appearance on the way, as tracking by level sets does.

    Args:
        result: the run; of any evidence.
        by: settings of the level sets.
        chosen: the frames.

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
    """Each person's state in a frame before; a person who was lost then has the present state."""
    pairs = zip(before.estimates, now.estimates, strict=True)
    return tuple(late if early.lost else early for early, late in pairs)


def _posed(result: Result, replay: Replay, who: Sequence[int]) -> Scene:
    """Some of the persons at the poses of a frame."""
    persons = result.scene.with_poses(tuple(estimate.q for estimate in replay.estimates)).persons
    return replace(result.scene, persons=tuple(persons[n] for n in who))


def _segmented(
    by: LevelSetEvidence, memory: Memory, sight: Sight, scenes: tuple[Scene, Scene], replay: Replay
) -> Segmented:
    """A frame whose contours begin at the first scene's outline; the second scene is the shape prior."""
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


# BGR; contours between are blue, lighter step by step.
_START, _FIRST, _LAST, _RESULT = (60, 60, 255), (160, 60, 0), (255, 220, 90), (255, 255, 255)

_MARGIN = 1.15
"""Longer side of the shown rectangle, over that of the person."""

_HEIGHT = 1.3
"""Height over width of a view's picture: persons are upright."""

_SUBPIXEL = 4
"""Binary digits after the point in OpenCV's drawing."""


def picture_of(segmented: Segmented, width_px: int) -> Image:
    """A column a view: the pose found, the contour without the shape prior, the contour with it.

    Contours are red where they begin, blue on their way and white where they end.

    Args:
        segmented: a frame; at least one view.
        width_px: of the picture.
    """
    width = width_px // len(segmented.views)
    columns = [_column(view, (width, round(_HEIGHT * width))) for view in segmented.views]
    picture: Image = np.ascontiguousarray(np.hstack(columns))
    states = ", ".join(sorted(set(segmented.statuses)))
    _write(picture, f"frame {segmented.frame}, {segmented.time_s:.2f} s, {states}", (8, 18))
    return picture


def _column(view: SegmentedView, size: tuple[int, int]) -> Image:
    """The pictures (h, w, 3) of a view below each other, each of a size."""
    window = _window(view, size)
    found = cv2.warpAffine(view.image, window, size, flags=cv2.INTER_LINEAR)
    rows = [found.copy() for _ in range(3)]
    _draw_pose(rows[0], view.pose, window)
    for row, stages in zip(rows[1:], (view.alone, view.held), strict=True):
        for k, mask in enumerate(stages):
            _draw_outline(row, mask, window, _shade(k, len(stages)))
    for row, name in zip(rows, _told(view), strict=True):
        _write(row, f"{view.name}: {name}", (8, size[1] - 8))
    column: Image = np.vstack(rows)
    return column


def _told(view: SegmentedView) -> tuple[str, str, str]:
    """The three pictures of a view."""
    ways = ("contour without shape", view.alone), ("contour with shape", view.held)
    alone, held = (what if stages else f"{what}: unknown" for what, stages in ways)
    return "pose found", alone, held


def _window(view: SegmentedView, size: tuple[int, int]) -> Array:
    """(2, 3) from pixels of the view to those of its picture, which the person fills."""
    drawn = np.any([view.silhouette, *view.alone, *view.held], axis=0)
    x, y, width, height = cv2.boundingRect(drawn.view(np.uint8)) if drawn.any() else (0, 0, *drawn.shape[::-1])
    scale = min(size[0] / width, size[1] / height) / _MARGIN
    centre = np.array([x + (width - 1) / 2, y + (height - 1) / 2])
    shift = (np.array(size) - 1) / 2 - scale * centre
    return np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])


def _draw_pose(picture: Image, pose: ViewContours, window: Array) -> None:
    """Draws each sample of the model's contours as a piece of it, except those between touching parts."""
    seen = ~pose.between
    along = np.stack([-pose.normals[seen, 1], pose.normals[seen, 0]], axis=1) * pose.weights[seen, None] / 2
    ends = np.stack([pose.pixels[seen] - along, pose.pixels[seen] + along], axis=1)
    places = 2**_SUBPIXEL * (ends @ window[:, :2].T + window[:, 2])
    pieces = [np.rint(piece).astype(np.int32) for piece in places]
    cv2.polylines(picture, pieces, False, _RESULT, 1, cv2.LINE_AA, _SUBPIXEL)


def _shade(k: int, n: int) -> tuple[float, ...]:
    """Colour of the k-th of n contours."""
    if k in (0, n - 1):
        return _START if k == 0 else _RESULT
    share = (k - 1) / max(n - 3, 1)
    return tuple((1 - share) * one + share * other for one, other in zip(_FIRST, _LAST, strict=True))


def _draw_outline(picture: Image, mask: Mask, window: Array, colour: tuple[float, ...]) -> None:
    """Draws the outline of a mask of the whole view."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    for outline in outlines:
        places = 2**_SUBPIXEL * (outline[:, 0] @ window[:, :2].T + window[:, 2])
        cv2.polylines(picture, [np.rint(places).astype(np.int32)], True, colour, 1, cv2.LINE_AA, _SUBPIXEL)


def _write(picture: Image, text: str, place: tuple[int, int]) -> None:
    for shift, shade in ((1, (0, 0, 0)), (0, _RESULT)):
        where = place[0] + shift, place[1] + shift
        cv2.putText(picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.45, shade, 1, cv2.LINE_AA)
