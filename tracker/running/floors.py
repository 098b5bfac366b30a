"""The floor of a rig, from a result, keypoints, or pictures of boards and markers on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.feet import footfalls, heights_over_sole, sole_parts, soles
from tracker.bodies.keypoint_layouts.views import KeypointFiles
from tracker.cameras.calibration import Mark, floor_marks
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import CalibrationError
from tracker.results.result import Result, Track, load_result
from tracker.running.jobs import load_job
from tracker.running.jobs.track import TrackJob
from tracker.running.viewing.images import without_plates

_FIT_ROUNDS = 6
"""Fits in turn. The first one turns a world that is tilted by up to 60 degrees; the others leave out points beside the
plane, and converge."""

_GROSS = 3.5
"""Distance from the plane, over the usual scatter, from which on a point is not of the floor."""

_MOST_SCATTER_M = 0.03
"""RMS distance from a plane beyond which points are not on one floor. Resting feet of eight recordings scattered by 0
to 17 mm, those of a person who lies on the floor by 35."""

_SURE = 3.0
"""Standard deviations from which on a tilt is corrected."""

_TILT_DEG = 1.0
"""Largest standard deviation of a tilt that is used: 17 mm per metre. Points on a line do not show the tilt across
it."""

_FEWEST = 6
"""Least number of points for a plane. Feet of a lying person, four times at rest, showed a tilt of 7 degrees."""

_HOW = ("as before: they do not tell the tilt", "as they lie, along one direction alone", "as they lie")
"""Source of the upward direction, by the number of directions along which points show the tilt."""


@dataclass(frozen=True)
class Floor:
    """A floor in the world of a rig."""

    up: Array
    """(3,) upward unit vector."""

    height_m: float
    """Height of the floor along it."""

    scatter_m: float
    """RMS distance of its points from it; 0 of one point."""

    n_points: int
    beside_m: tuple[float, ...]
    """Heights above it of points that lie elsewhere."""

    n_directions: int
    """Number of directions along which the points show the tilt, 0 to 2; without them `up` is from the cameras or the
    world."""

    source: str
    """Name of the points."""

    def laid(self, rig: Rig) -> Rig:
        """The rig in a world in which z is up and the floor is z = 0."""
        return rig.standing(self.up, self.height_m)

    def told(self) -> Iterator[str]:
        """The findings, in one line each."""
        off_deg = float(np.degrees(np.arccos(np.clip(self.up[2], -1, 1))))
        axis = ", ".join(f"{value + 0.0:.4f}" for value in np.round(self.up, 4))
        yield f"floor: told by {self.n_points} {self.source}, {1000 * self.scatter_m:.0f} mm off it (RMS)"
        yield f"up: ({axis}), {off_deg:.1f} degrees off z, {_HOW[self.n_directions]}"
        yield f"the floor is at {self.height_m:+.3f} m along it"
        if self.beside_m:
            beside = ", ".join(f"{1000 * height:+.0f} mm" for height in self.beside_m[:_MOST_TOLD])
            yield f"{len(self.beside_m)} more lie elsewhere ({beside}): on a step, or is one of them the floor?"


_MOST_TOLD = 6
"""Largest number of points listed one by one."""


def fitted_floor(points: Array, rig: Rig, source: str, sigma_m: float) -> Floor:
    """The floor on which points lie, without those that lie beside the plane of most.

    Args:
        points: (N, 3) of the rig's world, metres.
        rig: the cameras. They are above the floor, and show roughly the upward direction.
        source: name of the points.
        sigma_m: their usual standard deviation, metres.

    Raises:
        CalibrationError: there are no points, they are not on one plane, or most cameras come out below it.
    """
    if not len(points):
        raise CalibrationError(f"floor: no {source}, expected at least one")
    up = usual_up(rig)
    kept, n_directions = np.ones(len(points), dtype=bool), 0
    for _ in range(_FIT_ROUNDS):
        upwards, n_directions = _tilt(points[kept], up, sigma_m)
        up = upwards / np.linalg.norm(upwards)
        heights = points @ up
        off = np.abs(heights - np.median(heights[kept]))
        kept = off <= _GROSS * max(sigma_m, 1.4826 * float(np.median(off[kept])))
    floor_m, scatter_m = float(heights[kept].mean()), float(heights[kept].std())
    if scatter_m > _MOST_SCATTER_M:
        raise CalibrationError(
            f"floor: {kept.sum()} {source} are {1000 * scatter_m:.0f} mm off one plane (RMS), expected at most "
            f"{1000 * _MOST_SCATTER_M:.0f}: are they on one floor?"
        )
    if np.median([camera.centre @ up for camera in rig.cameras]) < floor_m:
        raise CalibrationError(f"floor: most cameras would be below the {source}, expected above: are these on it?")
    beside = tuple((heights[~kept] - floor_m).tolist())
    return Floor(up, floor_m, scatter_m, int(kept.sum()), beside, n_directions, source)


def usual_up(rig: Rig) -> Array:
    """(3,) z if the cameras do not contradict it, else the upward direction of the cameras."""
    z = np.array([0.0, 0.0, 1.0])
    held = rig.probable_up
    return z if held @ z > np.cos(np.radians(_NEAR_DEG)) else held


_NEAR_DEG = 15.0
"""Least cosine between z and the cameras' upward direction for which z is up; see `tracker.cameras.rig`."""


def _tilt(points: Array, up: Array, sigma_m: float) -> tuple[Array, int]:
    """An upward vector normal to the plane through points, and the number of directions along which they show it.

    The fit has a slope along each of the two main directions of the points; a slope within its uncertainty stays 0.
    """
    if len(points) < _FEWEST:
        return up, 0
    offsets = points - points.mean(axis=0)
    level = offsets - np.outer(offsets @ up, up)
    _, spreads, axes = np.linalg.svd(level, full_matrices=False)
    heights, upwards, n_directions = offsets @ up, up.copy(), 0
    slopes = (heights @ (level @ axes[:2].T)) / np.maximum(spreads[:2], 1e-9) ** 2
    left = heights - level @ axes[:2].T @ slopes
    scatter = max(sigma_m, float(np.sqrt((left**2).sum() / max(len(points) - 3, 1))))
    for slope, spread, axis in zip(slopes, spreads[:2], axes[:2], strict=True):
        sigma = scatter / max(float(spread), 1e-9)
        usable = bool(sigma < np.radians(_TILT_DEG))
        n_directions += usable
        if usable and abs(slope) > _SURE * sigma:
            upwards -= slope * axis
    return upwards, n_directions


_FOOT_M = 0.01
"""Standard deviation of a tracked sole where it rests: in ten results it lay 15 mm below to 6 mm above the floor."""

_KEYPOINT_M = 0.02
"""The same of detected keypoints. These lie on the foot, not below it."""

_ROUGH = (
    "detected ankles lie above those of a body that stands, and heels may be raised: of six recordings this floor was "
    "2 to 10 cm too high; track with it, then let the result tell the floor to 1 or 2 cm"
)
"""Height of an ankle above the sole by BlazePose, of five rendered persons and a real one."""

_MARK_M = 0.001
"""Standard deviation of corners on the floor, including the thickness of a board."""

_MOST_FRAMES = 600
"""Frames of a recording that are searched for keypoints."""

_MOST_OFF_PX = 15.0
"""Largest distance of a keypoint's images from its projected place, px of an image 1000 px wide; beyond, the views show
different persons."""

_ROUNDS = 3
"""The search for resting feet repeats with the better direction of down."""


@dataclass(frozen=True)
class FoundFloor:
    """A floor, and the marks on it that measure the scale of the rig."""

    floor: Floor
    sides: tuple[tuple[str, float], ...] = ()
    """Names of the boards and markers on the floor, and the sides of their squares, metres."""

    remark: str = ""
    """Warnings about it."""

    def told(self) -> Iterator[str]:
        """The findings, in one line each."""
        yield from self.floor.told()
        for name, side_m in self.sides:
            yield f"scale: a side of the {name} measures {1000 * side_m:.1f} mm with this rig; compare it with a ruler"
        if self.remark:
            yield self.remark


def found_floor(rig: Rig, seen: str, pictures: Callable[[str], tuple[Image | None, ...]]) -> FoundFloor:
    """Finds the floor and the upward axis by what the cameras have seen.

    Args:
        rig: the cameras, in any world.
        seen: a result folder, whose persons' feet rest on the floor; a run's configuration with keypoints; or pictures
            of a board or markers on the floor, for instance `floor/{view}.png`.
        pictures: reads the views' pictures.

    Raises:
        TrackerError: it cannot be read, or shows no floor.
    """
    path = Path(seen)
    if path.suffix == ".toml" and path.is_file():
        return FoundFloor(_of_keypoints(rig, path), remark=_ROUGH)
    if path.is_dir():
        return FoundFloor(_of_result(rig, load_result(path)))
    marks = floor_marks(rig, pictures(seen))
    points = np.concatenate([mark.corners for mark in marks])
    floor = fitted_floor(points[np.isfinite(points).all(axis=1)], rig, f"corners of {_listed(marks)}", _MARK_M)
    return FoundFloor(floor, tuple((mark.name, mark.side_m) for mark in marks))


def _of_result(rig: Rig, result: Result) -> Floor:
    _check_world(rig, result)
    with_feet = [track for track in result.persons if len(sole_parts(track.body))]
    if not with_feet:
        raise CalibrationError(f"{result.folder}: floor: no person there has feet, expected a model with feet")

    def resting(up: Array) -> Array:
        return np.concatenate([_footfalls_of(track, up) for track in with_feet])

    return _stood_on(rig, resting, "footfalls", _FOOT_M)


def _stood_on(rig: Rig, resting: Callable[[Array], Array], source: str, sigma_m: float) -> Floor:
    """The floor on which feet rest; the search for them repeats with the better direction of down."""
    floor = fitted_floor(resting(usual_up(rig)), rig, source, sigma_m)
    for _ in range(_ROUNDS - 1):
        floor = fitted_floor(resting(floor.up), rig, source, sigma_m)
    return floor


def _footfalls_of(track: Track, up: Array) -> Array:
    doubted = np.array([one.lost or one.doubtful for one in track.estimates])
    points, middles = soles(track.body, np.array([one.q for one in track.estimates]), up)
    points[doubted] = np.nan
    for k, p in enumerate(sole_parts(track.body)):
        unsure = [any(track.body.parts_of(limb)[p] for limb in limbs) for limbs in track.ambiguous]
        points[unsure, k] = np.nan
    return footfalls(points, middles, track.times_s, up)


def _check_world(rig: Rig, result: Result) -> None:
    """Refuses a result that was tracked in another world than the rig's.

    Raises:
        CalibrationError: names a camera that stands elsewhere there.
    """
    for camera in result.rig.cameras:
        own = rig.cameras[rig.index(camera.name)]
        if not np.allclose(own.camera_from_world, camera.camera_from_world, atol=1e-4):
            raise CalibrationError(
                f"{result.folder}: {camera.name} stands elsewhere there than in this rig, or its world is another one; "
                f"expected a result of this rig: that one was tracked with {result.folder / 'rig.toml'}"
            )


def _of_keypoints(rig: Rig, config: Path) -> Floor:
    job: TrackJob = load_job("track", config)
    if job.keypoints is None:
        raise CalibrationError(
            f"{config}: no keypoints there, expected keypoints = {{ path = ... }}; `bodytrack detect {config}` finds "
            "some; or name the folder of a result"
        )
    sequence = without_plates(job.reading)
    seen = rig.select(sequence.rig.names)
    frames = [replace(frame, images=(None,) * len(seen)) for frame in islice(sequence.frames(), _MOST_FRAMES)]
    times_s = np.array([frame.time_s for frame in frames])
    body = job.persons[0].description().build()
    places, heights = _placed(job.keypoints, frames, seen, body)

    def resting(up: Array) -> Array:
        return footfalls(places - heights[:, None] * up, places, times_s, up)

    return _stood_on(rig, resting, "resting keypoints of feet", _KEYPOINT_M)


def _placed(files: KeypointFiles, frames: list[Frame], rig: Rig, body: BodyModel) -> tuple[Array, Array]:
    """(T, F, 3) positions of the keypoints of feet, NaN if unknown, and (F,) their heights above the sole, metres."""
    views = files.checked(rig)
    heights = heights_over_sole(views.names, body)
    feet = np.flatnonzero(np.isfinite(heights))
    if not len(feet):
        raise CalibrationError(
            f"{files.path}: floor: no keypoint of a foot, expected ankles, heels or toes; they are called "
            f"{', '.join(views.names[:4])}, ..."
        )
    most_px = _MOST_OFF_PX * max(1.0, max(camera.size[0] for camera in rig.cameras) / 1000)
    places = np.full((len(frames), len(feet), 3), np.nan)
    for t, frame in enumerate(frames):
        pixels = np.stack([_surest(found)[feet, :2] for found in files.found(views, frame, rig)])
        points, _ = rig.triangulate(pixels)
        off_px = np.linalg.norm(rig.project(points) - pixels, axis=2)
        fits = np.where(np.isfinite(off_px), off_px, 0.0).max(axis=0) < most_px
        places[t, fits] = points[fits]
    return places, heights[feet]


def _surest(found: Array) -> Array:
    """(K, 3) keypoints of the surest of N persons (N, K, 3) in a view; NaN if it shows none."""
    if not len(found):
        return np.full(found.shape[1:], np.nan)
    best: Array = found[int(np.argmax(np.nan_to_num(found[..., 2]).sum(axis=1)))]
    return best


def _listed(marks: list[Mark]) -> str:
    return ", ".join(mark.name for mark in marks[:4]) + (", ..." if len(marks) > 4 else "")
