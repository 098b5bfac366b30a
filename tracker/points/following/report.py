"""The report of a following: its numbers, its pictures, and a page that needs no other file."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.pages import filled
from tracker.points.following.filters import Cuts
from tracker.points.following.record import AT_A_TIME, Motion, Rows, Window, between
from tracker.points.following.tables import Markers
from tracker.points.trajectories import PointStatus

# More lines are a carpet; of long recordings fewer are drawn, for the time that it takes.
_MOST_LINES, _MOST_STEPS = 3000, 400_000


@dataclass(frozen=True)
class Overview:
    """Of T frames."""

    n_with_status: Integers
    """(T, 5) points with each status; the first column, hidden ones, is empty."""

    steps: Array
    """(S, 2, D) both ends of the steps to be drawn."""

    speeds: Array
    """(S,) at their ends, units of the positions a second."""


@dataclass
class Gathering:
    """An overview that is being gathered."""

    n_frames: int
    markers: Integers
    """(M,) ids of the points for marker files."""

    n_with_status: list[Integers] = field(default_factory=list)
    steps: list[Array] = field(default_factory=list)
    speeds: list[Array] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    sigmas: list[Array] = field(default_factory=list)

    def add(self, window: Window, motion: Motion) -> None:
        """The next window."""
        own, inner = window.trajectories, window.inner
        status = np.where(own.seen, own.status, 0)[inner]
        self.n_with_status.append(np.stack([(status == kind).sum(axis=1) for kind in range(len(PointStatus))], axis=1))
        self.n_with_status[-1][:, int(PointStatus.HIDDEN)] = 0
        self._add_steps(window, motion)
        if not own.flat:
            columns = np.searchsorted(own.ids, self.markers)
            known = np.isin(self.markers, own.ids)
            places, sigmas = own.positions[inner], np.sqrt((own.sigmas[inner] ** 2).sum(axis=2))
            shape = (len(places), len(self.markers))
            self.positions.append(np.full((*shape, 3), np.nan))
            self.sigmas.append(np.full(shape, np.nan))
            self.positions[-1][:, known] = places[:, columns[known]]
            self.sigmas[-1][:, known] = sigmas[:, columns[known]]

    def _add_steps(self, window: Window, motion: Motion) -> None:
        own, inner = window.trajectories, window.inner
        share = min(_MOST_LINES, _MOST_STEPS // self.n_frames) / max(len(own.ids), 1)
        # a fixed shuffle of the ids: the same trajectories in all windows
        chosen = np.flatnonzero((own.ids * 2654435761) % 2**32 < share * 2**32)
        ends = np.arange(max(inner.start, 1), inner.stop)
        steps = np.stack([own.positions[ends - 1][:, chosen], own.positions[ends][:, chosen]], axis=2)
        known = np.isfinite(steps).all(axis=(2, 3))
        self.steps.append(steps[known])
        self.speeds.append(np.nan_to_num(np.linalg.norm(motion.velocities[ends][:, chosen], axis=2)[known]))

    def overview(self) -> Overview:
        """Of all windows."""
        n_with_status = np.concatenate(self.n_with_status)
        return Overview(n_with_status, np.concatenate(self.steps), np.concatenate(self.speeds))

    def as_markers(self, labels: tuple[str, ...], times: Array) -> Markers:
        """Of all windows."""
        return Markers(labels, times, np.concatenate(self.positions), np.concatenate(self.sigmas))


# A following in numbers.


@dataclass(frozen=True)
class Summary:
    """A following in numbers."""

    n_frames: int
    n_points: int
    """Points that were born."""

    n_seen_first: int
    n_seen_last: int
    n_rekeyed: int
    """Times that a point got a new key."""

    n_found_again: int
    n_cut: int
    """Steps that the filters took for false."""

    n_removed: int
    median_sigma_mm: float | None
    """Point error in the last frame, root of the sum of the three variances; None in 2-D mode or without points."""

    median_sigma_px: float | None
    """The same of the image of one view, in 2-D mode."""

    points_a_second: float
    interrupted: bool

    warnings: tuple[str, ...]
    """Warnings for users of the trajectories."""


@dataclass(frozen=True)
class Course:
    """Course of the following."""

    seconds: float
    interrupted: bool
    warnings: tuple[str, ...]
    """Messages on the way."""


def summarized(rows: Rows, frames: Integers, cuts: Cuts, course: Course) -> Summary:
    """Counts what was followed, and what the filters made of it.

    Args:
        rows: sightings in the order of the frames, before the filters.
        frames: (T,) all frame numbers.
        cuts: what the filters do.
        course: how the following went.
    """
    first, last = (between(rows, int(frame), int(frame) + 1) for frame in (frames[0], frames[-1]))
    flat = rows["pixels"].shape[1] == 1
    squares = last["sigmas_px"][:, 0] ** 2 if flat else np.diagonal(last["covariance"], axis1=1, axis2=2)
    usual = float(np.median(np.sqrt(squares.sum(axis=1)))) if len(last) else None
    n_with = np.zeros(len(PointStatus), dtype=np.int64)
    for k in range(0, len(rows), AT_A_TIME):
        n_with += np.bincount(rows["status"][k : k + AT_A_TIME], minlength=len(n_with))
    return Summary(
        n_frames=len(frames),
        n_points=cuts.n_before,
        n_seen_first=len(first),
        n_seen_last=len(last),
        n_rekeyed=int(n_with[PointStatus.REKEYED]),
        n_found_again=int(n_with[PointStatus.FOUND_AGAIN]),
        n_cut=cuts.n_fast + cuts.n_unlike,
        n_removed=cuts.n_removed,
        median_sigma_mm=None if flat or usual is None else 1000 * usual,
        median_sigma_px=usual if flat else None,
        points_a_second=round(len(rows) / max(course.seconds, 1e-9)),
        interrupted=course.interrupted,
        warnings=(*course.warnings, *_warnings(len(first), len(last), cuts)),
    )


# Below half of the points of the first frame.
_FEW = 0.5


def _warnings(first: int, last: int, cuts: Cuts) -> tuple[str, ...]:
    told = []
    if cuts.n_removed and cuts.n_removed == cuts.n_before:
        told.append(f"all {cuts.n_removed} trajectories are seen in too few frames, and removed: filters.min_frames")
    if last < _FEW * first:
        told.append(f"of {first} points at first, {last} are seen at last: most have been lost or are hidden")
    return tuple(told)


# Pictures of a following: points over the images (paper, figure 10), trajectories from two sides (figures 11, 13).

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


def report_html(name: str, summary: Summary, folder: Path, flat: bool) -> str:
    """Numbers and pictures of a result folder; `flat`: of one view alone."""
    warnings = list(summary.warnings)
    if summary.interrupted:
        warnings.insert(0, "The job was interrupted: what follows is of the frames before.")
    pictures = sorted(folder.glob("points_*.jpg"))
    content = {
        "name": name,
        "summary": summary,
        "flat": flat,
        "sigma": _sigma(summary),
        "warnings": warnings,
        "frames": [(int(path.stem.removeprefix("points_")), _uri(path)) for path in pictures],
        "snakes": _uri(folder / "snakes.jpg"),
        "trajectories": _uri(folder / "trajectories.png"),
        "counts": _uri(folder / "counts.png"),
        "files": sorted(path.name for path in folder.iterdir() if path.suffix in _TABLES),
    }
    return filled("tracker.points.following", "_report.html", content)


_TABLES = {".csv", ".trc", ".c3d", ".json"}


def _sigma(summary: Summary) -> str:
    if summary.median_sigma_mm is not None:
        return f"{summary.median_sigma_mm:.2f} mm"
    return "-" if summary.median_sigma_px is None else f"{summary.median_sigma_px:.3f} px"


def _uri(path: Path) -> str:
    """A picture as part of the page; empty where there is none."""
    if not path.is_file():
        return ""
    kind = "png" if path.suffix == ".png" else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"
