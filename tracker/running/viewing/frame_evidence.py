"""What each kind of evidence saw in one frame of a finished run: figure 6 of Gavrila & Davis 1996, for all evidence."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np

from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import EvidencePicture
from tracker.evidence.auto import WHERE_NOBODY_STAYS, WITHOUT_PLATES
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array32, Image
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
"""Earlier frames for learning colours and following places: four frames forget half of a colour."""

_NOT_MADE_AGAIN = (
    "the run's plates came from places where nobody stays; they are not made again: no foreground, "
    "and without it only contours, colours and motion"
)


@dataclass(frozen=True)
class SeenView:
    """One view of the frame."""

    name: str
    image: EvidencePicture
    pictures: tuple[EvidencePicture, ...]
    expected: ViewContours
    """Contours of the prediction; of the pose found if there is no prediction."""

    found: ViewContours


@dataclass(frozen=True)
class SeenFrame:
    """The frame, and the chosen person."""

    frame: int
    time_s: float
    person: str
    estimate: Estimate
    probabilities: Mapping[str, float]
    """Limb -> probability that it is right; see `tracker.tracking.limb_probabilities`."""

    differs: str
    """What the run had and this view of it lacks; empty for nothing."""

    views: tuple[SeenView, ...]
    """Views with an image."""


def seen_in_frame(result: Result, number: int, person: str) -> SeenFrame:
    """Examines a frame again as the run did: with its evidence, its prediction and its plates.

    It learns colours and followed places anew over the `BEFORE` frames before, at the poses of the result, so they may
    differ a little from the run's.

    Args:
        result: the run.
        number: of the frame.
        person: owner of the pose.

    Raises:
        TrackerError: the result has no such frame or person, or the recording is gone.
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
        state = state.after(sight, step, job.evidence, job.loss)
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
    """The plates that the run used: the recording makes plates only if it did so in the run."""
    none = WITHOUT_PLATES in _told(result)
    return tuple(None if plate is None or (none and plate.recorded) else plate for plate in plates)


def _told(result: Result) -> str:
    """Choices of the run's components."""
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
    """The persons as predicted; a person without an earlier frame as found."""
    time_s, poses = step.frame.time_s, []
    for person, history in zip(step.scene.persons, state.histories, strict=True):
        poses.append(person.q if history is None else prediction.predict(person.body, history, time_s)[0])
    return step.scene.with_poses(tuple(poses))


# All kinds of evidence in a view as one picture.

# BGR: contours expected, and found.
_EXPECTED, _FOUND, _WRITING = (0, 215, 255), (255, 120, 255), (255, 255, 255)

_MARGIN = 0.15
"""Margin around the persons, share of their size."""

_LINE_PX, _SIGN_PX = 20, 7.5
"""Height of a line of text, and width of a letter."""

_SUBPIXEL = 4
"""Binary digits after the point in OpenCV's drawing."""


def evidence_picture(seen: SeenFrame, view: SeenView, cell_px: int) -> Image:
    """The image and each kind of evidence, with the expected contours in yellow, and those found on the image.

    Args:
        seen: the frame.
        view: of it.
        cell_px: width of each.
    """
    drawn = [view.image, *(one for one in view.pictures if one.picture is not None)]
    cells = [_cell(one, view, n == 0, cell_px) for n, one in enumerate(drawn)]
    # about as high as wide
    n_columns = min(len(cells), max(2, math.ceil(math.sqrt(len(cells) * cells[0].shape[0] / cell_px))))
    cells += [np.zeros_like(cells[0])] * (-len(cells) % n_columns)
    rows = [np.hstack(cells[n : n + n_columns]) for n in range(0, len(cells), n_columns)]
    most = int(rows[0].shape[1] / _SIGN_PX)
    lines = [line for told in _title(seen, view) for line in textwrap.wrap(told, most, subsequent_indent="    ")]
    head: Image = np.zeros((_LINE_PX * len(lines) + 6, rows[0].shape[1], 3), dtype=np.uint8)
    for n, line in enumerate(lines):
        _write(head, line, _LINE_PX * (n + 1) - 4)
    picture: Image = np.ascontiguousarray(np.vstack([head, *rows]))
    return picture


def _title(seen: SeenFrame, view: SeenView) -> list[str]:
    """Frame and status, and a line a doubt."""
    first = f"{view.name}, frame {seen.frame}, {seen.time_s:.2f} s, {seen.person}: {seen.estimate.verdict}"
    doubts = []
    for one in seen.estimate.doubts:
        what = f"{(one.limb or 'person').replace('_', ' ')}: {str(one.because).replace('_', ' ')}"
        doubts.append(f"{what} ({one.measured})" if one.measured else what)
    right = ", ".join(f"{limb.replace('_', ' ')} {100 * share:.0f} %" for limb, share in seen.probabilities.items())
    lines = [first if doubts else f"{first}, nothing in doubt", *doubts]
    return [*lines, *([f"within 150 mm: {right}"] if right else []), *([seen.differs] if seen.differs else [])]


def _cell(one: EvidencePicture, view: SeenView, with_found: bool, width: int) -> Image:
    """A picture cut around the persons, with contours and its title, of the given width."""
    height, width_px = np.asarray(view.image.picture).shape[:2]
    x, y, w, h = around(np.concatenate([view.expected.pixels, view.found.pixels]), (width_px, height))
    scale = width / w
    picture: Image = cv2.resize(
        np.ascontiguousarray(one.picture)[y : y + h, x : x + w], (width, round(h * scale)), interpolation=cv2.INTER_AREA
    )
    draw_contours(picture, view.expected, (x, y), scale, _EXPECTED)
    if with_found:
        draw_contours(picture, view.found, (x, y), scale, _FOUND)
    _write(picture, "image: expected yellow, found violet" if with_found else one.title, picture.shape[0] - 8)
    return picture


class Window(NamedTuple):
    """A rectangle of a view, px."""

    left: int
    top: int
    width: int
    height: int


def around(pixels: Array32, size: tuple[int, int]) -> Window:
    """The rectangle of a view to show: contours with a margin, else the whole view.

    Args:
        pixels: (N, 2) of the contours.
        size: width and height of the view.
    """
    inside = pixels[((pixels > -1) & (pixels < size)).all(axis=1)]
    if not len(inside):
        return Window(0, 0, *size)
    low, high = inside.min(axis=0), inside.max(axis=0)
    margin = _MARGIN * float((high - low).max()) + 8
    left, top = np.clip(low - margin, 0, np.array(size) - 8).astype(int).tolist()
    right, bottom = np.clip(high + margin, (left + 8, top + 8), size).astype(int).tolist()
    return Window(left, top, right - left, bottom - top)


def draw_contours(
    picture: Image, contours: ViewContours, origin: tuple[int, int], scale: float, shade: tuple[int, ...]
) -> None:
    """Draws each matched sample as a piece of its contour.

    Args:
        picture: drawn into.
        contours: of a view.
        origin: pixel of the view at the picture's left upper corner.
        scale: of the picture, against the view.
        shade: BGR.
    """
    seen = ~contours.between
    normals = contours.normals[seen]
    along = np.stack([-normals[:, 1], normals[:, 0]], axis=1) * contours.weights[seen, None] / 2
    ends = np.stack([contours.pixels[seen] - along, contours.pixels[seen] + along], axis=1)
    lines = np.rint(((ends - origin + 0.5) * scale - 0.5) * 2**_SUBPIXEL).astype(np.int32)
    cv2.polylines(picture, list(lines), False, shade, 1, cv2.LINE_AA, _SUBPIXEL)


def _write(picture: Image, text: str, y: int) -> None:
    for shift, shade in ((1, (0, 0, 0)), (0, _WRITING)):
        where = 6 + shift, y + shift
        cv2.putText(picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.45, shade, 1, cv2.LINE_AA)
