"""Strain of skin and cloth from a finished following: a table, pictures, and its sliding over the bones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.body.surface import nearest_parts
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.foundation.errors import ConfigError, SequenceError, TrackerError, nearest
from tracker.foundation.files import GrowingFile, csv_lines, replacing, write_whole
from tracker.foundation.geometry.superquadrics import signed_distance
from tracker.foundation.progress import Progress, silent
from tracker.foundation.source_files import json_of
from tracker.points.following.tables import PointTable, read_trajectories
from tracker.points.strain import (
    COLUMNS,
    Gauges,
    Near,
    StrainFrame,
    gauges_of,
    near,
    smoothed,
    spacing_m,
    strain_figure,
    strain_lines,
    strains_of,
)
from tracker.results.result import Result
from tracker.running.jobs import CONFIG, load_job
from tracker.running.viewing.images import without_plates
from tracker.tracking.estimate import Estimate

_LEAST_LEAD_M = 0.01
"""A point this much nearer to its part than to the next one belongs to that part; between two parts it belongs to
none."""

_FARTHEST_M = 0.06
"""A point farther from the body is neither skin nor cloth of it."""

_LEAST_POINTS = 10
"""Least number of points of a segment for a statement about it."""


@dataclass(frozen=True)
class Slide:
    """Sliding over a segment, from the frame of reference to another one."""

    segment: str
    n_points: int
    slide_m: float
    """Distance of points along the surface, beside the bone, median."""

    most_m: float
    """95 % of the points slide less."""

    lift_m: float
    """Distance off the bone, median; negative towards it."""

    sigma_m: float
    """Standard deviation of a slide because of the two poses; NaN if the method gives none."""


@dataclass(frozen=True)
class OnBones:
    """N points on the parts of a body in the frame of reference."""

    body: BodyModel
    part: Integers
    """(N,) numbers of the parts; -1 for points of no part."""

    place: Array
    """(N, 3) in the part's frame, metres."""

    normal: Array
    """(N, 3) outwards, in the part's frame."""

    begun: Estimate


def on_bones(body: BodyModel, begun: Estimate, positions: Array) -> OnBones:
    """The points of a frame on the parts of a body.

    Args:
        body: the person's.
        begun: its pose in the frame of reference.
        positions: (N, 3) metres; NaN where a point is not seen.

    Raises:
        SequenceError: the points are not on this body.
    """
    seen = np.flatnonzero(np.isfinite(positions[:, 0]))
    placed, part = body.world_from_part(begun.q), np.full(len(positions), -1)
    place, normal = np.zeros((len(positions), 3)), np.zeros((len(positions), 3))
    if not len(seen):
        raise SequenceError("no point is seen in the frame of reference")
    found, distance, lead = nearest_parts(positions[seen], placed, body.shapes)
    if np.median(np.abs(distance)) > _FARTHEST_M:
        raise SequenceError(
            f"half of the points are more than {1000 * float(np.median(np.abs(distance))):.0f} mm from the body: "
            "expected points and poses of one recording, in the world of one calibration"
        )
    sure = (np.abs(distance) < _FARTHEST_M) & (lead > _LEAST_LEAD_M)
    part[seen[sure]] = found[sure]
    for p, shape in enumerate(body.shapes):
        own = np.flatnonzero(part == p)
        place[own] = (positions[own] - placed[p, :3, 3]) @ placed[p, :3, :3]
        normal[own] = signed_distance(shape, place[own])[1]
    return OnBones(body, part, place, normal, begun)


def slides(points: OnBones, now: Estimate, positions: Array) -> tuple[Slide, ...]:
    """Sliding of the points of each segment since the frame of reference.

    Args:
        points: positions in the frame of reference.
        now: the pose of the frame.
        positions: (N, 3) of the points in it, metres; NaN where a point is not seen.
    """
    body, found = points.body, []
    placed = body.world_from_part(now.q)[points.part]
    local = np.einsum("nji,nj->ni", placed[:, :3, :3], positions - placed[:, :3, 3])
    moved = local - points.place
    lift = (moved * points.normal).sum(axis=1)
    along = moved - lift[:, None] * points.normal
    seen: Mask = (points.part >= 0) & np.isfinite(positions[:, 0])
    segments = np.where(seen, body.segments_of_parts[points.part], -1)
    for k, segment in enumerate(body.segments):
        own = np.flatnonzero(segments == k)
        if len(own) >= _LEAST_POINTS:
            length = np.linalg.norm(along[own], axis=1)
            most, middle = float(np.percentile(length, 95)), float(np.median(lift[own]))
            sigma = _pose_sigma(points, (points.begun, now), own)
            found.append(Slide(segment.name, len(own), float(np.median(length)), most, middle, sigma))
    return tuple(found)


def _pose_sigma(points: OnBones, estimates: Sequence[Estimate], own: Integers) -> float:
    """Standard deviation of a point's position along the surface by the poses, RMS over points and axes."""
    body, total = points.body, 0.0
    for one in estimates:
        placed = body.world_from_part(one.q)[points.part[own]]
        world = np.einsum("nij,nj->ni", placed[:, :3, :3], points.place[own]) + placed[:, :3, 3]
        normal = np.einsum("nij,nj->ni", placed[:, :3, :3], points.normal[own])
        jacobian = body.point_jacobian(one.q, world, body.part_parameters[points.part[own]])
        across = jacobian - normal[:, :, None] * np.einsum("ni,nij->nj", normal, jacobian)[:, None]
        total += float(np.einsum("nij,jk,nik->n", across, one.covariance, across).mean())
    return float(np.sqrt(total / 2)) if np.isfinite(total) else np.nan


GAUGE, DEPTH = 2.5, 4.5
"""Radius of a gauge, and of the surface that smooths depths, in distances between neighbouring points. On
`closerange/back`, points 5 mm apart, 68 % of the strains then have errors below 0.005; see docs/lab/strain.md."""

_ENDS = 98.0
"""Percentile of the strains and shears of all frames at the end of the colours."""

_SLIDE_COLUMNS = ("frame", "time_s", "segment", "points", "slide_mm", "most_mm", "lift_mm", "sigma_mm")


@dataclass(frozen=True)
class Asked:
    """Frames to compare, and settings."""

    reference: int | None = None
    """Number of the frame without strain; None for the first one."""

    every: int = 10
    """Every so many frames from the first chosen one; and the last one."""

    first: int = 0
    behind: int | None = None
    """Numbers of the first frame, and of the one behind the last."""

    gauge_mm: float | None = None
    """Radius of a gauge; None for 2.5 times the distance of neighbours."""

    view: str | None = None
    """View of the pictures; None for the middle one."""


@dataclass(frozen=True)
class Strained:
    """Outcome of a strain measurement."""

    reference: int
    spacing_mm: float
    gauge_mm: float
    frames: tuple[StrainFrame, ...]
    slides: Mapping[int, tuple[Slide, ...]]
    """Frame -> segments, if a body was given and is not lost."""

    files: tuple[Path, ...]
    told: str
    """Why pictures have no images; empty if they have."""


def strain_followed(
    folder: Path, asked: Asked, body: tuple[Result, str] | None, output: Path, progress: Progress = silent
) -> Strained:
    """Finds the strains of a following, and writes a table, and a picture a frame.

    Args:
        folder: result of `bodytrack follow`, in space.
        asked: frames and gauges.
        body: a run of the same recording and a person in it, whose bones sliding is measured against; None for none.
        output: folder for the files; created if missing.
        progress: told how far it is.

    Raises:
        TrackerError: the folder is not a following in space, a frame, view or person is not in it, or points and body
            do not belong together.
    """
    table, rig, patch_px = _opened(folder)
    rows, reference = _rows(table, asked, folder)
    camera = _camera(rig, asked.view)
    spacing = spacing_m(table.positions[reference])
    reach = asked.gauge_mm / 1000 if asked.gauge_mm else GAUGE * spacing
    if not np.isfinite(reach):
        raise SequenceError(f"{folder}: fewer than two points in frame {table.frames[reference]}: no strain")
    seen = table.positions[reference][table.seen[reference]]
    patch_m = patch_px * float(np.median(camera.in_camera(seen)[:, 2]) / camera.matrix[0, 0])
    around = near(table.positions[reference], DEPTH * spacing)
    gauges = gauges_of(smoothed(table.positions[reference], table.covariances[reference], around), reach)
    begun = _Begun(gauges, around, patch_m)
    found = [begun.strained(table, t) for t in rows]
    slid = {} if body is None else _slid(table, rows, reference, body)
    output.mkdir(parents=True, exist_ok=True)
    files = [_table(output / "strain.csv", table, found)]
    if slid:
        files.append(_slide_table(output / "slides.csv", found, slid))
    images, told = _images(folder, rig, camera, {one.frame for one in found})
    files += list(_pictures(output, found, camera, images, progress))
    return Strained(int(table.frames[reference]), 1000 * spacing, 1000 * reach, tuple(found), slid, tuple(files), told)


def told_strains(found: Strained) -> list[tuple[str, ...]]:
    """For each frame its number, gauges, larger and smaller strain in %, shear in degrees, and sigma in %, as text."""
    rows = []
    for one in found.frames:
        known = np.isfinite(one.strains.stretches[:, 0])
        cells = [""] * 4
        if known.any():
            values = (*(100 * one.strains.stretches[known]).T, np.degrees(one.strains.shear[known]))
            cells = [*map(_spread, values), f"{100 * np.median(one.strains.sigmas[known]):.2f}"]
        rows.append((str(one.frame), str(int(known.sum())), *cells))
    return rows


def _spread(values: Array) -> str:
    """The median, and the range of 90 %."""
    middle, low, high = np.percentile(values, (50, 5, 95))
    return f"{middle:.1f} ({low:.1f} to {high:.1f})"


def told_slides(found: Strained) -> list[tuple[str, ...]]:
    """For each segment in the last frame its name, points, and lengths in mm, as text."""
    return [
        (one.segment.replace("_", " "), str(one.n_points), *(_mm(value)[:-2] for value in _lengths(one)))
        for one in found.slides[max(found.slides)]
    ]


def _opened(folder: Path) -> tuple[PointTable, Rig, int]:
    """The points, the cameras, and the width of the patches that followed points, px."""
    summary = folder / "follow.json"
    if not summary.is_file():
        raise SequenceError(f"{folder}: no follow.json in it: expected the result folder of `bodytrack follow`")
    try:
        patch_px = int(json_of(summary, SequenceError)["config"]["following"]["matching"]["patch_px"])
    except (KeyError, TypeError, ValueError) as error:
        raise SequenceError(f"{summary}: damaged: no width of the patches, following.matching.patch_px") from error
    table = read_trajectories(folder)
    if table.flat:
        raise SequenceError(f"{folder}: points followed in the image of one view: strain needs points in space")
    return table, load_rig(folder / "rig.toml"), patch_px


def _rows(table: PointTable, asked: Asked, folder: Path) -> tuple[list[int], int]:
    """Rows of the chosen frames, and of the frame of reference."""
    numbers = table.frames.tolist()
    reference = numbers[0] if asked.reference is None else asked.reference
    if reference not in numbers:
        raise ConfigError(f"{folder}: no frame {reference}; its frames are {numbers[0]} to {numbers[-1]}")
    behind = numbers[-1] + 1 if asked.behind is None else asked.behind
    wanted = [k for k, number in enumerate(numbers) if asked.first <= number < behind]
    some = sorted({*wanted[:: asked.every], *wanted[-1:]} - {numbers.index(reference)})
    if not some:
        raise ConfigError(f"{folder}: no frame to compare; its frames are {numbers[0]} to {numbers[-1]}")
    return some, numbers.index(reference)


def _camera(rig: Rig, view: str | None) -> Camera:
    if view is None:
        return rig.cameras[len(rig) // 2]
    if view not in rig.names:
        raise ConfigError(f'--view: no view is called "{view}"; {nearest(view, rig.names)}')
    return rig.cameras[rig.names.index(view)]


@dataclass(frozen=True)
class _Begun:
    """The frame of reference, prepared."""

    gauges: Gauges
    around: Near
    patch_m: float

    def strained(self, table: PointTable, t: int) -> StrainFrame:
        """The strains of a frame."""
        now = smoothed(table.positions[t], table.covariances[t], self.around)
        strains = strains_of(self.gauges, now, self.patch_m)
        return StrainFrame(int(table.frames[t]), float(table.times[t]), table.positions[t], strains)


def _slid(
    table: PointTable, rows: Sequence[int], reference: int, body: tuple[Result, str]
) -> dict[int, tuple[Slide, ...]]:
    """Frame -> sliding of the points over each segment; without frames in which the person is lost."""
    result, person = body
    track = result.person(person)
    known = {int(number): one for number, one in zip(track.frames, track.estimates, strict=True) if not one.lost}
    number = int(table.frames[reference])
    if number not in known:
        raise ConfigError(f"{result.folder}: {person} is not found in frame {number}, that of reference")
    begun = on_bones(track.body, known[number], table.positions[reference])
    frames = [(t, int(table.frames[t])) for t in rows]
    return {frame: slides(begun, known[frame], table.positions[t]) for t, frame in frames if frame in known}


def _table(path: Path, table: PointTable, found: Sequence[StrainFrame]) -> Path:
    file = GrowingFile(path)
    file.add(csv_lines([COLUMNS]))
    for one in found:
        file.add("".join(strain_lines(table.ids, one)))
    return file.take_place()


def _slide_table(path: Path, found: Sequence[StrainFrame], slid: Mapping[int, tuple[Slide, ...]]) -> Path:
    times = {one.frame: one.time_s for one in found}
    rows = [
        (frame, f"{times[frame]:.6f}", one.segment, one.n_points, *(_mm(value) for value in _lengths(one)))
        for frame, segments in slid.items()
        for one in segments
    ]
    write_whole(path, csv_lines([_SLIDE_COLUMNS, *rows]))
    return path


def _lengths(one: Slide) -> tuple[float, ...]:
    return one.slide_m, one.most_m, one.lift_m, one.sigma_m


def _mm(value: float) -> str:
    return f"{1000 * value:.3f}" if np.isfinite(value) else ""


def _images(folder: Path, rig: Rig, camera: Camera, numbers: set[int]) -> tuple[dict[int, Image], str]:
    """Images of a view, by their frames, if the recording is still there; and why there are none."""
    view, images = rig.names.index(camera.name), {}
    try:
        sequence = without_plates(load_job("follow", folder / CONFIG).reading)
        view = sequence.rig.names.index(camera.name)
        for frame in sequence.frames():
            image = frame.images[view]
            if frame.index in numbers and image is not None:
                images[frame.index] = image
            if len(images) == len(numbers):
                break
    except TrackerError as error:
        return {}, f"pictures without images: {error}"
    return images, ""


def _pictures(
    output: Path, found: Sequence[StrainFrame], camera: Camera, images: Mapping[int, Image], progress: Progress
) -> Iterator[Path]:
    every = np.concatenate([np.abs(one.strains.stretches).ravel() for one in found])
    shears = np.concatenate([one.strains.shear for one in found])
    ends = tuple(
        float(np.percentile(values[np.isfinite(values)], _ENDS)) if np.isfinite(values).any() else 0.01
        for values in (every, shears)
    )
    for n, one in enumerate(found, start=1):
        path = output / f"strain_{one.frame:06d}.png"
        figure = strain_figure(one, camera, images.get(one.frame), (ends[0], ends[1]))
        with replacing(path) as unfinished:
            figure.savefig(unfinished, dpi=90, format="png")
        progress("drawing", n, len(found))
        yield path
