"""Points followed through the frames of a recording: a generator that holds two frames at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import cv2
import numpy as np

from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import SequenceError
from tracker.points.following.advance import advance
from tracker.points.following.density import Density
from tracker.points.following.following import Following
from tracker.points.following.newborn import NewPoints
from tracker.points.following.points import Points
from tracker.points.following.sightings import Prepared
from tracker.points.surfaces.views import Preparation, field_camera
from tracker.points.trajectories import PointFrame

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
