"""Pictures of a following: points over the images (paper, figure 10), trajectories from two sides (figures 11, 13)."""

from __future__ import annotations

import cv2
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from tracker.arrays import Array, Image, Integers
from tracker.following.motion import Motion
from tracker.following.record import Rows
from tracker.point_trajectories import PointStatus, PointTrajectories
from tracker.rig import Rig

_COLOURS = "turbo"
# Of a view in the report.
_WIDTH_PX = 700
# Of the trails: a third of a second at 25 frames/s.
_TAIL_FRAMES = 8
# More are a carpet.
_MOST_LINES = 3000


def points_picture(pictures: tuple[Image | None, ...], rows: Rows, frame: int) -> Image:
    """The views of a frame side by side, with the points' ways through the last frames.

    Green points are followed by their key patch, orange ones have got a new key, blue ones were found again.
    """
    recent = rows[(rows["frame"] > frame - _TAIL_FRAMES) & (rows["frame"] <= frame)]
    drawn = [_drawn(picture, recent, v, frame) for v, picture in enumerate(pictures) if picture is not None]
    height = min(picture.shape[0] for picture in drawn)
    return np.concatenate([picture[:height] for picture in drawn], axis=1)


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


def trajectories_figure(trajectories: PointTrajectories, motion: Motion, rig: Rig | None) -> Figure:
    """All trajectories, coloured by their speed: in space from the front and from the left, else in the image."""
    chosen = _some(trajectories)
    speed = np.linalg.norm(motion.velocities[:, chosen], axis=2)
    positions = trajectories.positions[:, chosen]
    sides: tuple[tuple[str, Array], ...] = (("in the image, px", positions * (1, -1)),) if rig is None else ()
    if rig is not None:
        right, down, away = _directions(trajectories, rig)
        sides = (
            ("from the front, m", np.stack([positions @ right, -(positions @ down)], axis=2)),
            ("from the left, m", np.stack([positions @ away, -(positions @ down)], axis=2)),
        )
    top = float(np.nanpercentile(speed, 99)) if np.isfinite(speed).any() else 1.0
    scale = Normalize(0.0, max(top, 1e-9))
    widths = [float(np.ptp(places[..., 0][np.isfinite(places[..., 0])])) for _, places in sides]
    height = max(float(np.ptp(places[..., 1][np.isfinite(places[..., 1])])) for _, places in sides)
    ratios = [np.clip(width / height, 0.3, 2.0) for width in widths]
    figure = Figure((6.0 * sum(ratios) + 2.5, 6.6), layout="constrained")
    axes = figure.subplots(1, len(sides), squeeze=False, width_ratios=ratios)[0]
    for axis, (title, places) in zip(axes, sides, strict=True):
        segments = np.stack([places[:-1], places[1:]], axis=2).reshape(-1, 2, 2)
        known = np.isfinite(segments).all(axis=(1, 2))
        lines = LineCollection(list(segments[known]), cmap=_COLOURS, norm=scale, linewidths=0.6)
        lines.set_array(np.nan_to_num(speed[1:].ravel()[known]))
        axis.add_collection(lines)
        axis.set_aspect("equal")
        axis.autoscale()
        axis.locator_params(nbins=4)
        axis.set_title(title, fontsize=10)
    unit = "px/s" if rig is None else "m/s"
    figure.colorbar(ScalarMappable(scale, _COLOURS), ax=axes, label=f"speed, {unit}", shrink=0.7)
    return figure


def _some(trajectories: PointTrajectories) -> Integers:
    """Rows of no more trajectories than can be told apart."""
    n = len(trajectories.ids)
    return np.linspace(0, n - 1, min(n, _MOST_LINES)).astype(np.int64)


def _directions(trajectories: PointTrajectories, rig: Rig) -> tuple[Array, Array, Array]:
    """Right, down and away as the cameras see them, unit vectors in the world."""
    centre = np.mean([camera.centre for camera in rig.cameras], axis=0)
    away = np.nanmedian(trajectories.positions.reshape(-1, 3), axis=0) - centre
    away /= np.linalg.norm(away)
    down = np.mean([camera.camera_from_world[1, :3] for camera in rig.cameras], axis=0)
    down -= (down @ away) * away
    down /= np.linalg.norm(down)
    return np.cross(down, away), down, away


def counts_figure(trajectories: PointTrajectories) -> Figure:
    """How many points each frame shows, and how many got a new key, were found again or born in it."""
    figure = Figure((9, 3.2), layout="constrained")
    seen, events = figure.subplots(1, 2)
    seen.plot(trajectories.times, trajectories.seen.sum(axis=1), color="tab:green")
    seen.set(xlabel="s", title="points seen")
    seen.set_ylim(0, 1.1 * max(1, int(trajectories.seen.sum(axis=1).max())))
    for status, colour in (
        (PointStatus.REKEYED, "tab:orange"),
        (PointStatus.FOUND_AGAIN, "tab:blue"),
        (PointStatus.BORN, "tab:grey"),
    ):
        count = (trajectories.status[1:] == status).sum(axis=1)
        events.plot(trajectories.times[1:], count, color=colour, label=status.name.lower().replace("_", " "))
    events.set(xlabel="s", title="a frame")
    events.legend(fontsize=8)
    return figure
