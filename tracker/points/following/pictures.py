"""Pictures of a following: points over the images (paper, figure 10), trajectories from two sides (figures 11, 13)."""

from __future__ import annotations

import cv2
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.points.following.overview import Overview
from tracker.points.following.record import Rows, between
from tracker.points.trajectories import PointStatus

_COLOURS = "turbo"
# Of a view in the report.
_WIDTH_PX = 700
# Of the trails: a third of a second at 25 frames/s.
_TAIL_FRAMES = 8


def points_picture(pictures: tuple[Image | None, ...], rows: Rows, frame: int) -> Image:
    """The views of a frame side by side, with the points' ways through the last frames.

    Green points are followed by their key patch, orange ones have got a new key, blue ones were found again.
    """
    recent = between(rows, frame - _TAIL_FRAMES + 1, frame + 1)
    drawn = [_drawn(picture, recent, v, frame) for v, picture in enumerate(pictures) if picture is not None]
    height = max(picture.shape[0] for picture in drawn)
    return np.concatenate([np.pad(p, ((0, height - len(p)), (0, 0), (0, 0))) for p in drawn], axis=1)


def _drawn(picture: Image, rows: Rows, view: int, frame: int) -> Image:
    scale = _WIDTH_PX / picture.shape[1]
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    smaller = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    canvas: Image = cv2.cvtColor((0.6 * smaller).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    order = np.lexsort((rows["frame"], rows["id"]))
    pixels, ids = rows["pixels"][order, view] * scale, rows["id"][order]
    steps = np.flatnonzero((ids[1:] == ids[:-1]) & (np.diff(rows["frame"][order]) == 1))
    known = steps[np.isfinite(pixels[steps]).all(axis=1) & np.isfinite(pixels[steps + 1]).all(axis=1)]
    lines = np.round(8 * np.stack([pixels[known], pixels[known + 1]], axis=1)).astype(np.int32)
    cv2.polylines(canvas, list(lines), False, (170, 170, 170), 1, cv2.LINE_AA, shift=3)
    now = rows[rows["frame"] == frame]
    for place, status in zip(now["pixels"][:, view] * scale, now["status"], strict=True):
        if np.isfinite(place).all():
            x, y = np.round(8 * place).astype(int)
            cv2.circle(canvas, (x, y), 12, _STATUS_COLOURS[int(status)], -1, cv2.LINE_AA, shift=3)
    return canvas


# BGR, as OpenCV draws.
_STATUS_COLOURS = {
    int(PointStatus.FOLLOWED): (90, 220, 90),
    int(PointStatus.REKEYED): (40, 150, 255),
    int(PointStatus.FOUND_AGAIN): (255, 160, 60),
    int(PointStatus.BORN): (255, 255, 255),
}


def trajectories_figure(overview: Overview, false: Array, rig: Rig | None) -> Figure:
    """Trajectories coloured by their speed: in space from the front and from the left, else in the image.

    Args:
        overview: what to draw.
        false: (F, 2, D) steps that the filters took for false, drawn in black.
        rig: cameras that say where the front is; None for trajectories in an image.
    """
    places, speed = overview.steps, overview.speeds
    sides: tuple[tuple[str, Array, Array], ...]
    if rig is None:
        sides = (("in the image, px", places * (1, -1), false * (1, -1)),)
    else:
        right, down, away = _directions(places, rig)

        def seen_from(across: Array) -> tuple[Array, Array]:
            first, second = (np.stack([part @ across, -(part @ down)], axis=-1) for part in (places, false))
            return first, second

        sides = (("from the front, m", *seen_from(right)), ("from the left, m", *seen_from(away)))
    top = float(np.percentile(speed, 99)) if len(speed) else 1.0
    scale = Normalize(0.0, max(top, 1e-9))
    extents = [np.ptp(lines.reshape(-1, 2), axis=0) if len(lines) else np.ones(2) for _, lines, _ in sides]
    height = max(1e-9, *(float(extent[1]) for extent in extents))
    ratios = [float(np.clip(extent[0] / height, 0.3, 2.0)) for extent in extents]
    figure = Figure((6.0 * sum(ratios) + 2.5, 6.6), layout="constrained")
    axes = figure.subplots(1, len(sides), squeeze=False, width_ratios=ratios)[0]
    for axis, (title, segments, cut) in zip(axes, sides, strict=True):
        lines = LineCollection(list(segments), cmap=_COLOURS, norm=scale, linewidths=0.6)
        lines.set_array(speed)
        axis.add_collection(lines)
        axis.set_aspect("equal")
        axis.autoscale()
        # after the axes are scaled: a false step may lead anywhere
        axis.add_collection(LineCollection(list(cut), colors="black", linewidths=1.2), autolim=False)
        axis.locator_params(nbins=4)
        axis.set_title(title, fontsize=10)
    unit = "px/s" if rig is None else "m/s"
    if len(false):
        figure.suptitle(f"black: {len(false)} steps that the filters took for false, and cut", fontsize=10)
    figure.colorbar(ScalarMappable(scale, _COLOURS), ax=axes, label=f"speed, {unit}", shrink=0.7)
    return figure


def _directions(places: Array, rig: Rig) -> tuple[Array, Array, Array]:
    """Right, down and away as the cameras see places (..., 3), unit vectors in the world."""
    centre = np.mean([camera.centre for camera in rig.cameras], axis=0)
    away = np.median(places.reshape(-1, 3), axis=0) - centre if places.size else np.array([1.0, 0.0, 0.0])
    away /= np.linalg.norm(away)
    down = np.mean([camera.camera_from_world[1, :3] for camera in rig.cameras], axis=0)
    down -= (down @ away) * away
    down /= np.linalg.norm(down)
    return np.cross(down, away), down, away


def counts_figure(overview: Overview, times: Array) -> Figure:
    """How many points each frame shows, and how many got a new key, were found again or born in it."""
    figure = Figure((9, 3.2), layout="constrained")
    seen, events = figure.subplots(1, 2)
    n_seen = overview.n_with_status[:, 1:].sum(axis=1)
    seen.plot(times, n_seen, color="tab:green")
    seen.set(xlabel="s", title="points seen")
    seen.set_ylim(0, 1.1 * max(1, int(n_seen.max())))
    for status, colour in (
        (PointStatus.REKEYED, "tab:orange"),
        (PointStatus.FOUND_AGAIN, "tab:blue"),
        (PointStatus.BORN, "tab:grey"),
    ):
        label = status.name.lower().replace("_", " ")
        events.plot(times[1:], overview.n_with_status[1:, int(status)], color=colour, label=label)
    events.set(xlabel="s", title="a frame")
    events.legend(fontsize=8)
    return figure
