"""The empty rooms of recordings, filmed otherwise: from elsewhere, with longer lenses, furniture, turned cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tracker.arrays import Array, Image, Mask
from tracker.camera import Camera
from tracker.errors import SequenceError
from tracker.fisheye import rational_of
from tracker.rig import Rig

# From the nearest place of a person's middle to that of a cupboard, metres.
_BOX_AWAY_M = 1.0
# A corner's place in units of the box's half sides, and the corners around each of its faces.
_CORNERS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (0.0, 1.0)])
_FACES = (0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (1, 3, 7, 5)
_OUTWARD = np.array([(-1.0, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, 1)])
# BGR, and how light the faces are.
_WOOD, _SHADES = (70, 105, 140), (0.75, 0.9, 0.8, 0.95, 1.15)


@dataclass(frozen=True)
class _Box:
    """A cupboard on the floor."""

    place: tuple[float, float]
    """x and y of its middle, metres."""

    heading: float
    """Direction of its depth, rad from the x axis."""

    depth_m: float = 0.4
    width_m: float = 1.2
    height_m: float = 1.1

    @property
    def corners(self) -> Array:
        """(8, 3) in the world, metres."""
        return _CORNERS * (self.depth_m / 2, self.width_m / 2, self.height_m) @ self._turn.T + (*self.place, 0.0)

    @property
    def normals(self) -> Array:
        """(5, 3) of the faces that can be seen, unit, outwards."""
        turned: Array = _OUTWARD @ self._turn.T
        return turned

    @property
    def _turn(self) -> Array:
        c, s = np.cos(self.heading), np.sin(self.heading)
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _painted(picture: Image, camera: Camera, box: _Box) -> tuple[Image, Mask]:
    """A room's picture with the box in it, and where (h, w) the box is seen."""
    shown, mask = picture.copy(), np.zeros(picture.shape[:2], np.uint8)
    corners = box.corners
    pixels = camera.project(corners)
    for face, normal, shade in zip(_FACES, box.normals, _SHADES, strict=True):
        away = camera.centre - corners[list(face)].mean(axis=0)
        outline = pixels[list(face)]
        if away @ normal <= 0 or not np.isfinite(outline).all():
            continue
        around = np.round(outline * 16).astype(np.int32)
        colour = tuple(shade * one for one in _WOOD)
        cv2.fillConvexPoly(shown, around, colour, cv2.LINE_AA, 4)
        cv2.polylines(shown, [around], True, tuple(0.6 * one for one in colour), 2, cv2.LINE_AA, 4)
        cv2.fillConvexPoly(mask, around, 1, cv2.LINE_8, 4)
    return shown, mask > 0


def picture_of(path: Path, size: tuple[int, int]) -> Image:
    """An empty room's picture, of the size that its camera was calibrated at.

    Raises:
        SequenceError: it is not there.
    """
    found = cv2.imread(str(path))
    if found is None:
        raise SequenceError(f"{path}: no picture of the empty room")
    return np.asarray(cv2.resize(found, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def filmed_with(camera: Camera, picture: Image, downscale: int, zoom: float) -> tuple[Camera, Image]:
    """The camera and its picture of the empty room with a longer lens, and fewer pixels."""
    taken = replace(camera.downscaled(downscale), downscale=1)
    shown = np.asarray(cv2.resize(picture, taken.size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if zoom == 1:
        return taken, shown
    middle = (np.array(taken.size) - 1) / 2
    larger = np.array([[zoom, 0, 0], [0, zoom, 0], [0, 0, 1.0]])
    larger[:2, 2] = (1 - zoom) * middle
    near = cv2.warpAffine(shown, larger[:2], taken.size, flags=cv2.INTER_CUBIC)
    return replace(taken, matrix=larger @ taken.matrix), np.asarray(near, dtype=np.uint8)


@dataclass(frozen=True)
class Standpoint:
    """Where a camera stands, looking at the middle of the room 1 m above the floor."""

    azimuth_deg: float
    """Around the room's middle, from the first camera of the room on, anticlockwise from above."""

    height_m: float
    away_m: float = 5.0
    """From the room's middle, along the floor."""

    fisheye_px: float | None = None
    """Pixels to a radian of an equidistant fisheye lens; None for the room's lenses."""

    def taken_by(self, camera: Camera, room: Rig, name: str) -> Camera:
        """The room's camera there, upright."""
        way = room.cameras[0].centre[:2] - room.middle[:2]
        azimuth = np.arctan2(way[1], way[0]) + np.radians(self.azimuth_deg)
        centre = np.array([np.cos(azimuth) * self.away_m, np.sin(azimuth) * self.away_m, self.height_m])
        centre[:2] += room.middle[:2]
        ahead = np.array([*room.middle[:2], 1.0]) - centre
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, (0, 0, 1.0))
        right /= np.linalg.norm(right)
        motion = np.eye(4)
        motion[:3, :3] = right, np.cross(ahead, right), ahead
        motion[:3, 3] = -motion[:3, :3] @ centre
        moved = replace(camera, name=name, camera_from_world=motion)
        if self.fisheye_px is None:
            return moved
        matrix = np.diag([self.fisheye_px, self.fisheye_px, 1.0])
        matrix[:2, 2] = (np.array(camera.size) - 1) / 2
        return replace(moved, matrix=matrix, distortion=rational_of(name, camera.size, matrix, np.zeros(4)))


def placed(room: Rig, pictures: list[Image], standpoints: tuple[Standpoint, ...]) -> tuple[Rig, list[Image]]:
    """Cameras at these places, with the room's pictures (mirrored the second time) and, unless told, lenses in turn."""
    n = len(room)
    cameras = [one.taken_by(room.cameras[k % n], room, f"C{k + 1}") for k, one in enumerate(standpoints)]
    shown = [pictures[k % n] if k < n else np.fliplr(pictures[k % n]).copy() for k in range(len(cameras))]
    return Rig(tuple(cameras)), shown


def furnished(pictures: list[Image], rig: Rig, n_boxes: int, places: Array) -> tuple[list[Image], tuple[Mask, ...]]:
    """The pictures of the room with cupboards around a person who is at places (T, 2), and what stands before her."""
    fronts = [np.zeros(picture.shape[:2], dtype=np.bool_) for picture in pictures]
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    for camera in rig.cameras[:n_boxes]:
        way = camera.centre[:2] - middle
        way /= np.linalg.norm(way)
        place = middle + (((places - middle) @ way).max() + _BOX_AWAY_M) * way
        box = _Box((float(place[0]), float(place[1])), float(np.arctan2(way[1], way[0])))
        for v, seen_by in enumerate(rig.cameras):
            pictures[v], covered = _painted(pictures[v], seen_by, box)
            away = np.linalg.norm(seen_by.centre[:2] - places, axis=1)
            if np.linalg.norm(seen_by.centre[:2] - place) < away.min():
                fronts[v] |= covered
    return pictures, tuple(fronts) if n_boxes else ()


def turned_cameras(rig: Rig, degrees: float) -> Rig:
    """The rig as if each camera had been turned about an axis across its view since."""
    ways = np.random.default_rng(0).uniform(0, 2 * np.pi, len(rig))
    cameras = []
    for camera, way in zip(rig.cameras, ways, strict=True):
        motion = np.eye(4)
        motion[:3, :3] = Rotation.from_rotvec(
            degrees * np.array([np.cos(way), np.sin(way), 0]), degrees=True
        ).as_matrix()
        cameras.append(replace(camera, camera_from_world=motion @ camera.camera_from_world))
    return Rig(tuple(cameras))
