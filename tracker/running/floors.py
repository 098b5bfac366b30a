"""The floor of a rig, as a result, keypoints, or pictures of what lies on it tell it."""

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
from tracker.cameras.floor import Floor, fitted_floor, usual_up
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import CalibrationError
from tracker.results.person_track import Track
from tracker.results.result import Result, load_result
from tracker.running.jobs import load_job
from tracker.running.jobs.track import TrackJob
from tracker.running.viewing.images import without_plates

_FOOT_M = 0.01
"""Standard deviation of a tracked sole where it rests: of ten results it lay 15 mm below to 6 mm above the floor."""

_KEYPOINT_M = 0.02
"""The same of detected keypoints, which lie on the foot and not below it."""

_ROUGH = (
    "detected ankles lie above those of a body that stands, and heels may be raised: of six recordings this floor was "
    "2 to 10 cm too high; track with it, then let the result tell the floor to 1 or 2 cm"
)
"""By BlazePose, of five rendered persons and a real one."""

_MARK_M = 0.001
"""Of the corners of what lies on the floor, the thickness of a board included."""

_MOST_FRAMES = 600
"""Of a recording whose keypoints are looked at."""

_MOST_OFF_PX = 15.0
"""Of a keypoint's images from that of its place, px of an image 1000 px wide: beyond, views have other persons."""

_ROUNDS = 3
"""Feet are looked for again as soon as it is known better which way is down."""


@dataclass(frozen=True)
class FoundFloor:
    """A floor, and the marks on it that measure the scale of the rig."""

    floor: Floor
    sides: tuple[tuple[str, float], ...] = ()
    """Names of what lies on the floor, and the sides of its squares, metres."""

    remark: str = ""
    """What to know of it besides."""

    def told(self) -> Iterator[str]:
        """What was found, in one line each."""
        yield from self.floor.told()
        for name, side_m in self.sides:
            yield f"scale: the {name} measures {1000 * side_m:.1f} mm a side with this rig; compare it with a ruler"
        if self.remark:
            yield self.remark


def found_floor(rig: Rig, seen: str, pictures: Callable[[str], tuple[Image | None, ...]]) -> FoundFloor:
    """The floor and the axis that is up, as what the cameras have seen tells them.

    Args:
        rig: the cameras, in any world.
        seen: a result folder, whose persons' feet rest on the floor; a run's configuration with keypoints; or pictures
            of a board or markers on the floor, for instance `floor/{view}.png`.
        pictures: reads those of the views.

    Raises:
        TrackerError: it cannot be read, or tells no floor.
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
        raise CalibrationError(f"{result.folder}: floor: nobody there has feet, expected a model that has some")

    def resting(up: Array) -> Array:
        return np.concatenate([_footfalls_of(track, up) for track in with_feet])

    return _stood_on(rig, resting, "footfalls", _FOOT_M)


def _stood_on(rig: Rig, resting: Callable[[Array], Array], source: str, sigma_m: float) -> Floor:
    """The floor on which feet rest, which are found anew as soon as it is known better which way is down."""
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
    """Refuses a result that was tracked in another world than that of the rig.

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
    """(T, F, 3) places of the keypoints of feet, NaN where unknown, and (F,) their heights over the sole, metres."""
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
    """(K, 3) keypoints of that of N persons (N, K, 3) that a view is surest of; NaN where it shows nobody."""
    if not len(found):
        return np.full(found.shape[1:], np.nan)
    best: Array = found[int(np.argmax(np.nan_to_num(found[..., 2]).sum(axis=1)))]
    return best


def _listed(marks: list[Mark]) -> str:
    return ", ".join(mark.name for mark in marks[:4]) + (", ..." if len(marks) > 4 else "")
