"""Pictures of a step: the model's contours over the views, as in the paper's figures 5 and 9."""

from __future__ import annotations

from collections.abc import Sequence

import av
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
    cameras, names = scene.rig.cameras, scene.rig.names
    if close:
        # as large as it is filmed, for a part of it is shown
        views = [_blank(camera.size) for camera in cameras]
        for v, view in enumerate(views):
            _draw_view(step, scene, v, stick_figure, view)
        picture = tile([_close_up(view, step.fitted.of(v)) for v, view in enumerate(views)], width_px, names)
    else:
        # as large as it is shown, and where: copies of four views took a third of the time
        picture, cells = _sheet([camera.size for camera in cameras], width_px)
        for v, (camera, cell) in enumerate(zip(cameras, cells, strict=True)):
            _draw_view(step, scene, v, stick_figure, _window(cell, camera.size))
            _name(cell, names[v])
        picture = _even(picture)
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
    sheet, cells = _sheet([(picture.shape[1], picture.shape[0]) for picture in pictures], width_px)
    for cell, picture, name in zip(cells, pictures, names or ("",) * len(pictures), strict=True):
        _scale_into(_window(cell, (picture.shape[1], picture.shape[0])), picture)
        _name(cell, name)
    return _even(sheet)


def _name(cell: Image, name: str) -> None:
    _label(cell, name, (10, cell.shape[0] - 12), _WHITE)


def _even(picture: Image) -> Image:
    """With even width and height."""
    return np.ascontiguousarray(picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2])


def _n_columns(sizes: Sequence[tuple[int, int]]) -> int:
    upright = sizes[0][1] > sizes[0][0]
    return len(sizes) if upright or len(sizes) == 1 else 2


def _sheet(sizes: Sequence[tuple[int, int]], width_px: int) -> tuple[Image, list[Image]]:
    """A black picture of all of several pictures, and the cell of each in it.

    Args:
        sizes: widths and heights of the pictures, px.
        width_px: of all.
    """
    n_columns = _n_columns(sizes)
    width = width_px // n_columns
    height = max(round(h * width / w) for w, h in sizes)
    sheet = _blank((width * n_columns, height * -(-len(sizes) // n_columns)))
    corners = [(height * (k // n_columns), width * (k % n_columns)) for k in range(len(sizes))]
    return sheet, [sheet[top : top + height, left : left + width] for top, left in corners]


def _blank(size: tuple[int, int]) -> Image:
    return np.zeros((size[1], size[0], 3), dtype=np.uint8)


def _window(cell: Image, size: tuple[int, int]) -> Image:
    """The part of a cell that a picture of some width and height fills in its proportions."""
    scale = min(cell.shape[1] / size[0], cell.shape[0] / size[1])
    return cell[: max(1, round(size[1] * scale)), : max(1, round(size[0] * scale))]


def _scale_into(window: Image, picture: Image) -> None:
    """A small picture is averaged over areas, which takes eight times as long as interpolation."""
    if picture.shape == window.shape:
        window[:] = picture
    else:
        way = cv2.INTER_AREA if window.shape[1] < _SMALL * picture.shape[1] else cv2.INTER_LINEAR
        cv2.resize(picture, (window.shape[1], window.shape[0]), dst=window, interpolation=way)


def _draw_view(step: Step, scene: Scene, v: int, stick_figure: bool, picture: Image) -> None:
    """Draws a view into a picture, which gives its size."""
    image, scale = step.frame.images[v], picture.shape[1] / scene.rig.cameras[v].size[0]
    if image is None:
        picture[:] = 60
        _label(picture, "no image", (20, picture.shape[0] // 2), _GREY, 1.0)
    else:
        _scale_into(picture, image)
    doubted, hidden = doubted_parts(step), _hidden_parts(step, v)
    draw_contours(picture, step.fitted.of(v), doubted=doubted, hidden=hidden, scale=scale)
    if stick_figure:
        _draw_bones(picture, step, scene, v, scale)


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


def film_frame(picture: Image) -> av.VideoFrame:
    """A BGR picture of even width and height as an encoder takes it; OpenCV converts it in a third of FFmpeg's time."""
    planes = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
    return av.VideoFrame.from_ndarray(np.asarray(planes, dtype=np.uint8), format="yuv420p")


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
