"""Points followed through the frames of a recording: a generator that holds two frames at a time."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import SequenceError
from tracker.foundation.files import replacing
from tracker.points.following.attempts import look_again, look_for_keys, look_for_previous
from tracker.points.following.births import Density
from tracker.points.following.following import Following
from tracker.points.following.points import NewPoints, Points, restored
from tracker.points.following.sightings import Prepared, Sightings, accept_followed, look_where_projected
from tracker.points.surfaces.surface import Preparation, field_camera
from tracker.points.trajectories import PointFrame


def advance(following: Following, rig: Rig, points: Points, previous: Prepared, present: Prepared) -> Array:
    """Follows all points into the next frame; they are changed in place.

    Args:
        following: how.
        rig: the cameras of the images; one for 2-D mode.
        points: as in the previous frame.
        previous, present: both frames.

    Returns:
        Covariances of the positions (N, 3, 3) m^2.
    """
    sightings = Sightings(following, rig, points, previous, present)
    look_for_keys(sightings)
    look_for_previous(sightings)
    accept_followed(sightings)
    look_where_projected(sightings)
    if following.find_again:
        look_again(sightings)
    if following.correct_curvature:
        sightings.correct_curvature()
    sightings.commit()
    return sightings.covariances


Births = Callable[[Frame], NewPoints]
"""Points to follow from a frame on."""


def prepared(following: Following, preparation: Preparation, frame: Frame) -> Prepared:
    """A frame made ready; views without an image stay empty."""
    greys = tuple(None if image is None else _grey(image, preparation.odd_lines_only) for image in frame.images)
    images = tuple(None if grey is None else following.matching.prepared(grey) for grey in greys)
    return Prepared(frame.index, images, greys)


def _grey(image: Image, odd_lines_only: bool) -> Image:
    lines = image[::2] if odd_lines_only else image
    grey = cv2.cvtColor(lines, cv2.COLOR_BGR2GRAY) if lines.ndim == 3 else lines
    return np.ascontiguousarray(grey)


def prepared_rig(preparation: Preparation, rig: Rig) -> Rig:
    """The cameras of what is followed: of fields, if only odd lines are used."""
    return Rig(tuple(map(field_camera, rig.cameras))) if preparation.odd_lines_only else rig


def follow(
    following: Following,
    preparation: Preparation,
    rig: Rig,
    frames: Iterable[Frame],
    births: Births,
    points: Points | None = None,
    density: Density | None = None,
) -> Iterator[tuple[PointFrame, Points]]:
    """Follows the points of the first frame through all others.

    Args:
        following, preparation: how.
        rig: the cameras, one for 2-D mode.
        frames: of a recording, in order.
        births: says what to follow.
        points: those of an interrupted run, as they were in the first of these frames, which is not yielded again.
        density: births and ends on the way; None for none.

    Yields:
        What is known of all points in each frame, and the points themselves, which the next frame changes.
    """
    rig, previous, following = prepared_rig(preparation, rig), None, following.for_views(len(rig))
    for frame in frames:
        present = prepared(following, preparation, frame)
        if points is not None and previous is None:
            previous = present
            continue
        if points is None or previous is None:
            _check_first(rig, frame)
            new = births(frame)
            points, covariances = following.begin(new, present.images, frame.index), new.covariances
        elif len(present.seen) < following.needed(points).max(initial=min(len(rig), 2)):
            # The points have moved further by the next frame; they have not vanished.
            yield points.unseen(frame.index, frame.time_s), points
            continue
        else:
            covariances = advance(following, rig, points, previous, present)
            if density is not None and frame.index % density.every_frames == 0:
                points, covariances = _renewed(following, density, points, covariances, present, births(frame))
        yield points.frame(frame.index, frame.time_s, covariances), points
        previous = present


def _renewed(
    following: Following, density: Density, points: Points, covariances: Array, present: Prepared, new: NewPoints
) -> tuple[Points, Array]:
    """Points after the check of their density, and the covariances of their positions."""
    kept = density.kept(points, new.spacing_px)
    points, covariances = points.select(kept), covariances[kept]
    new = new.select(density.new_places(points, new))
    if not len(new.positions):
        return points, covariances
    joined = points.joined(following.begin(new, present.images, present.index, points))
    return joined, np.concatenate([covariances, new.covariances])


def _check_first(rig: Rig, frame: Frame) -> None:
    for v in frame.missing:
        raise SequenceError(
            f'view "{rig.cameras[v].name}" has no image in frame {frame.index}, in which following begins: '
            "choose another reading.start"
        )


# State from which an interrupted following goes on.

STATE = "state.npz"
"""In the result folder."""


@dataclass
class Counts:
    """Frames and points so far."""

    frames: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    seconds: float = 0.0
    interrupted: bool = False
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class SavedState:
    """As it was after a frame."""

    frame: int
    n_bytes: int
    """Length of the record of sightings then."""

    frames: tuple[int, ...]
    times: tuple[float, ...]
    seconds: float
    """That the following has taken until then."""

    points: Points
    warnings: tuple[str, ...]


def save_state(folder: Path, points: Points, counts: Counts, n_bytes: int) -> None:
    """Writes the state of the present frame in place of an earlier one.

    Frames without enough images, which the points have passed over since, are left out: the next frame is compared with
    the one before these, and they have no sightings.
    """
    n_frames = counts.frames.index(points.latest) + 1
    told: dict[str, NDArray[Any]] = {
        "frames": np.array(counts.frames[:n_frames]),
        "times": np.array(counts.times[:n_frames]),
        "seconds": np.array(counts.seconds),
        "n_bytes": np.array(n_bytes),
        "warnings": np.array(counts.warnings, dtype=np.str_),
    }
    with replacing(folder / STATE) as unfinished:
        np.savez(unfinished, **{f"job_{name}": value for name, value in told.items()}, **points.arrays())  # type: ignore[arg-type]


def saved_state(folder: Path) -> SavedState:
    """The state that an interrupted following has left.

    Raises:
        SequenceError: there is none that can be read.
    """
    try:
        with np.load(folder / STATE) as saved:
            arrays = {name: saved[name] for name in saved.files}
        frames = tuple(int(frame) for frame in arrays["job_frames"])
        times = tuple(float(time_s) for time_s in arrays["job_times"])
        warnings, seconds = tuple(map(str, arrays["job_warnings"])), float(arrays["job_seconds"])
        n_bytes, points = int(arrays["job_n_bytes"]), restored(arrays)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        # a KeyError: of a version that knew less
        raise SequenceError(f"{folder / STATE}: no saved state to go on from; run without --resume") from error
    return SavedState(frames[-1], n_bytes, frames, times, seconds, points, warnings)
