"""Points that a following begins with: clicked, of a measured surface or of an image; later those of new surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import MatchingError, SequenceError
from tracker.points.following.births import (
    check_room,
    given_points,
    no_points,
    points_of_image,
    points_of_surface,
    textured_places,
    with_room,
)
from tracker.points.following.following import Following
from tracker.points.following.points import NewPoints
from tracker.points.surfaces.points import one_a_voxel
from tracker.points.surfaces.surface import Surface, SurfaceMeasurement, measure_surface

Places = tuple[tuple[float, float], ...] | dict[str, tuple[float, float]]

_NO_NEW = "no new surface could be measured"


def position(place: object) -> object:
    """What was clicked, whole numbers as fractions; anything else as it is."""
    return tuple(map(float, place)) if isinstance(place, tuple | list) and len(place) == 2 else place


@dataclass(frozen=True)
class Born:
    """What is followed from a frame on."""

    surface: SurfaceMeasurement
    """How the surface is measured that points are born on."""

    following: Following
    """How they are followed."""

    rig: Rig
    """The cameras, one for 2-D mode."""

    places: Places
    """Clicked in the first frame, px; empty for all that it shows."""

    warnings: list[str]
    """What is doubtful of a surface is added."""

    def first(self, frame: Frame, greys: tuple[Image | None, ...]) -> NewPoints:
        """Points of the first frame.

        Args:
            frame: as recorded.
            greys: its images as they are matched.

        Raises:
            TrackerError: there is no surface, or no room for what is clicked.
        """
        names = list(self.places) if isinstance(self.places, dict) else [str(k) for k in range(len(self.places))]
        places = list(self.places.values()) if isinstance(self.places, dict) else list(self.places)
        at = np.array(places, dtype=np.float64).reshape(-1, 2)
        if len(self.rig) == 1:
            assert greys[0] is not None
            return self._in_image(greys[0], at, names)
        surface = self._measured(frame)
        self.warnings.extend(surface.warnings)
        return given_points(surface, self.surface, at, names) if len(at) else points_of_surface(surface)

    def _measured(self, frame: Frame) -> Surface:
        """A surface of which each point is where its pixels are: no centre of gravity of several can be followed."""
        surface = measure_surface(replace(self.surface, voxel_mm=None), frame, self.rig)
        if self.surface.voxel_mm is None:
            return surface
        return replace(surface, points=one_a_voxel(surface.points, self.surface.voxel_mm / 1000))

    def _in_image(self, grey: Image, at: Array, names: list[str]) -> NewPoints:
        patch_px = self.following.for_views(1).matching.patch_px
        if len(at):
            check_room(at, names, grey, patch_px)
            return points_of_image(at)
        places = textured_places(grey, self.surface.growth.step_px)
        room = with_room(places, grey, patch_px)
        if not room.any():
            raise MatchingError(
                f"the first image has texture only so near its border that no patch of {patch_px} px around it is "
                "within the image: lower following.alone_patch_px, or choose another reading.start"
            )
        return points_of_image(places[room])

    def later(self, frame: Frame) -> NewPoints:
        """Points of new surface; none where it cannot be measured, which is no reason to end."""
        try:
            return points_of_surface(self._measured(frame))
        except (MatchingError, SequenceError) as error:
            if not any(warning.startswith(_NO_NEW) for warning in self.warnings):
                self.warnings.append(f"{_NO_NEW} in frame {frame.index}, perhaps in later ones neither: {error}")
            return no_points(len(self.rig), float(self.surface.growth.step_px))
