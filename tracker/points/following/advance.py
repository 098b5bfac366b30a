"""One step of following: all points from a frame into the next (D'Apuzzo et al. 2000, figure 7)."""

from __future__ import annotations

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.points.following.attempts import look_again, look_for_keys, look_for_previous
from tracker.points.following.checks import accept_followed, look_where_projected
from tracker.points.following.following import Following
from tracker.points.following.points import Points
from tracker.points.following.sightings import Prepared, Sightings


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
