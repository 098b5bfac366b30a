"""Pictures of a step: the model's contours over the views, as in the paper's figures 5 and 9."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Image, Mask
from tracker.tracking.estimate import Status
from tracker.tracking.start import AxisFit
from tracker.tracking.trajectory import Step

# BGR.
_WHITE, _GREY, _RED, _CYAN = (255, 255, 255), (150, 150, 150), (40, 40, 230), (230, 200, 60)
_ORANGE, _BLUE = (40, 140, 255), (220, 120, 60)
# Binary digits after the point in OpenCV's drawing; width of lines between parts.
_SUBPIXEL = 4
_BETWEEN_PX = 4.0
_LINE_PX = 30
_SMALL = 0.5
"""Share of a picture's size: smaller lines would be jagged."""
_LEAST_CLOSE = 0.1
"""Least share of a view in a close-up: a person at its border may show a single sample."""


def draw_step(step: Step, scene: Scene, width_px: int, stick_figure: bool = False, close: bool = False) -> Image:
    """All views tiled, with the model's contours in white, frame number and status.

    Args:
        step: one frame.
        scene: names the views and the persons.
        width_px: width of the picture.
        stick_figure: also draw the bones.
        close: show only the surroundings of the persons.

    Returns:
        BGR picture with even width and height.
    """
    sizes = [camera.size for camera in scene.rig.cameras]
    cell = _cell_of(sizes, width_px)
    # as large as it is shown, or as it is filmed where a part of it is shown
    scales = [1.0 if close else min(cell[0] / width, cell[1] / height) for width, height in sizes]
    pictures = [_draw_view(step, scene, v, stick_figure, scale) for v, scale in enumerate(scales)]
    if close:
        pictures = [_close_up(picture, step.fitted.of(v)) for v, picture in enumerate(pictures)]
    picture = tile(pictures, width_px, scene.rig.names)
    lost = [p.name for p, e in zip(step.scene.persons, step.estimates, strict=True) if e.lost]
    lines = states_of(step)
    for n, line in enumerate(lines):
        _label(picture, line, (10, 24 + _LINE_PX * n), _WHITE)
    if lost:
        height, width = picture.shape[:2]
        cv2.rectangle(picture, (2, 2), (width - 3, height - 3), _RED, 5)
        _label(picture, f"LOST: {', '.join(lost)}", (10, 24 + _LINE_PX * len(lines)), _RED, 0.9)
    return picture


def states_of(step: Step) -> list[str]:
    """Frame and status in words; for several persons, a line each with the ambiguous limbs."""
    frame = f"frame {step.frame.index}   {step.frame.time_s:.2f} s"
    states = []
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        limbs = ", ".join(sorted(limb.replace("_", " ") for limb in estimate.ambiguous if not estimate.lost))
        state = str(estimate.verdict) + (f", ambiguous: {limbs}" if limbs else "")
        states.append(state if len(step.estimates) == 1 else f"{person.name}: {state}")
    return [f"{frame}   {states[0]}"] if len(states) == 1 else [frame, *states]


def tile(pictures: list[Image], width_px: int, names: tuple[str, ...] = ()) -> Image:
    """Pictures side by side, named: upright ones in one row, others in two columns."""
    names = names or ("",) * len(pictures)
    sizes = [(picture.shape[1], picture.shape[0]) for picture in pictures]
    columns, (cell_width, cell_height) = _n_columns(sizes), _cell_of(sizes, width_px)
    cells = [_fitted(p, cell_width, cell_height) for p in pictures]
    for cell, name in zip(cells, names, strict=True):
        _label(cell, name, (10, cell_height - 12), _WHITE)
    cells += [np.zeros_like(cells[0])] * (-len(cells) % columns)
    rows = [np.hstack(cells[i : i + columns]) for i in range(0, len(cells), columns)]
    whole = np.vstack(rows)
    return np.ascontiguousarray(whole[: whole.shape[0] // 2 * 2, : whole.shape[1] // 2 * 2])


def _n_columns(sizes: Sequence[tuple[int, int]]) -> int:
    upright = sizes[0][1] > sizes[0][0]
    return len(sizes) if upright or len(sizes) == 1 else 2


def _cell_of(sizes: Sequence[tuple[int, int]], width_px: int) -> tuple[int, int]:
    """Width and height of each of several pictures in one of all, px."""
    width = width_px // _n_columns(sizes)
    return width, max(round(h * width / w) for w, h in sizes)


def _fitted(picture: Image, width: int, height: int) -> Image:
    """A picture scaled into a cell, the rest black."""
    scale = min(width / picture.shape[1], height / picture.shape[0])
    shown = _scaled(picture, scale)
    cell = np.zeros((height, width, 3), dtype=np.uint8)
    cell[: shown.shape[0], : shown.shape[1]] = shown
    return cell


def _scaled(picture: Image, scale: float) -> Image:
    """A copy; a small picture is averaged over areas, which takes eight times as long as interpolation."""
    size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
    if size == (picture.shape[1], picture.shape[0]):
        return picture.copy()
    way = cv2.INTER_AREA if scale < _SMALL else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, size, interpolation=way), dtype=np.uint8)


def _draw_view(step: Step, scene: Scene, v: int, stick_figure: bool, scale: float) -> Image:
    camera = scene.rig.cameras[v]
    image = step.frame.images[v]
    if image is None:
        picture = np.full((round(camera.size[1] * scale), round(camera.size[0] * scale), 3), 60, dtype=np.uint8)
        _label(picture, "no image", (20, picture.shape[0] // 2), _GREY, 1.0)
    else:
        picture = _scaled(image, scale)
    doubted, hidden = doubted_parts(step), _hidden_parts(step, v)
    draw_contours(picture, step.fitted.of(v), doubted=doubted, hidden=hidden, scale=scale)
    if stick_figure:
        _draw_bones(picture, step, scene, v, scale)
    return picture


def _close_up(picture: Image, contours: ViewContours) -> Image:
    """The part of a view, in its proportions, that shows the contours with a margin of a fifth around them."""
    if len(contours.parts) == 0:
        return picture
    low, high = contours.pixels.min(axis=0), contours.pixels.max(axis=0)
    height, width = picture.shape[:2]
    scale = 1.4 * float(max((high[0] - low[0]) / width, (high[1] - low[1]) / height))
    scale = min(1.0, max(_LEAST_CLOSE, scale))
    size = np.array([max(1, round(width * scale)), max(1, round(height * scale))])
    x, y = np.clip(np.round((low + high - size) / 2), 0, (width, height) - size).astype(int).tolist()
    return picture[y : y + size[1], x : x + size[0]]


def doubted_parts(step: Step) -> Mask:
    """(P,) doubtful parts of the scene: ambiguous limbs, doubtful or lost persons."""
    doubted = []
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        own = np.full(len(person.body.parts), estimate.doubtful or estimate.lost)
        for group in estimate.ambiguous:
            own |= person.body.parts_of(group)
        doubted.append(own)
    parts: Mask = np.concatenate(doubted)
    return parts


def _hidden_parts(step: Step, v: int) -> Mask:
    """(P,) parts of the scene that something hides in a view."""
    hidden = []
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        known = estimate.account.hidden
        hidden.append(np.zeros(len(person.body.parts), dtype=np.bool_) if known is None else known[v])
    parts: Mask = np.concatenate(hidden)
    return parts


def draw_contours(
    picture: Image,
    contours: ViewContours,
    colour: tuple[int, int, int] = _WHITE,
    doubted: Mask | None = None,
    hidden: Mask | None = None,
    scale: float = 1.0,
) -> None:
    """Draws each sample as a short piece of its contour; edges between parts in grey (paper, section 5).

    Args:
        picture: to draw into.
        contours: of a view.
        colour: of the contours.
        doubted: (P,) parts drawn in orange.
        hidden: (P,) parts drawn in blue.
        scale: of the picture, against the contours' view.
    """
    nothing = np.zeros(len(contours.parts), dtype=np.bool_)
    unsure, unseen = (nothing if parts is None else parts[contours.parts] for parts in (doubted, hidden))
    between = contours.between
    along = np.stack([-contours.normals[:, 1], contours.normals[:, 0]], axis=1)
    half = np.where(between, _BETWEEN_PX, contours.weights)[:, None] / 2
    ends = np.stack([contours.pixels - half * along, contours.pixels + half * along], axis=1)
    lines = np.round(((ends + 0.5) * scale - 0.5) * 2**_SUBPIXEL).astype(np.int32)
    thick = max(1, round(max(picture.shape[:2]) / 700))
    outer = ~between & ~unsure
    shades = ((_GREY, between), (_BLUE, outer & unseen), (colour, outer & ~unseen), (_ORANGE, ~between & unsure))
    for shade, chosen in shades:
        cv2.polylines(picture, list(lines[chosen]), False, shade, thick, cv2.LINE_AA, _SUBPIXEL)


def _draw_bones(picture: Image, step: Step, scene: Scene, v: int, scale: float) -> None:
    for person in step.scene.persons:
        pixels = scale * scene.rig.cameras[v].project(person.body.landmarks_in_world(person.q))
        names = person.body.landmark_names
        for one, other in person.body.links:
            ends = pixels[[names.index(one), names.index(other)]]
            if np.isfinite(ends).all():
                a, b = np.round(ends).astype(int).tolist()
                cv2.line(picture, tuple(a), tuple(b), _CYAN, 2, cv2.LINE_AA)


def _label(picture: Image, text: str, at: tuple[int, int], colour: tuple[int, int, int], scale: float = 0.6) -> None:
    # OpenCV 5 widens the text with its thickness: the shadow is the same text, shifted.
    for shift, shade in ((1, (0, 0, 0)), (0, colour)):
        where = at[0] + shift, at[1] + shift
        cv2.putText(picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, scale, shade, 1, cv2.LINE_AA)


def draw_axes(image: Image | None, fit: AxisFit) -> Image:
    """Bootstrapping evidence: foreground and successive major axes in lighter colours (paper, figure 5)."""
    picture = np.zeros((*fit.foreground.shape, 3), dtype=np.uint8)
    if image is not None:
        picture = (image * 0.35).astype(np.uint8)
    picture[fit.foreground] = (picture[fit.foreground] * 0.3 + np.array([110, 80, 60])).astype(np.uint8)
    for k, ends in enumerate(fit.axes):
        shade = 90 + round(165 * (k + 1) / len(fit.axes))
        a, b = np.round(_inside(ends, picture)).astype(int).tolist()
        cv2.line(picture, tuple(a), tuple(b), (shade, shade, shade), 2, cv2.LINE_AA)
    return picture


def _inside(ends: Array, picture: Image) -> Array:
    limit = 4 * max(picture.shape[:2])
    return np.clip(ends, -limit, limit)


def encoded(picture: Image, kind: str = ".jpg") -> bytes:
    """A picture as JPEG or PNG bytes."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, 85] if kind == ".jpg" else []
    return bytes(cv2.imencode(kind, picture, quality)[1].tobytes())


STATUS_COLOURS = {
    Status.TRACKED: "#4a90a4",
    Status.BOOTSTRAPPED: "#7a5ea8",
    Status.RECOVERED: "#2e8b57",
    Status.DOUBTFUL: "#e67e22",
    Status.FILLED: "#b0a160",
    Status.LOST: "#c0392b",
}
"""Colours of the frames' states in plots and tables."""

LIMB_COLOUR = "#f4c272"
"""The same for frames in which a limb is ambiguous, and nothing else is in doubt."""
