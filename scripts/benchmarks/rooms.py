"""The empty rooms of recordings, filmed otherwise: from elsewhere, with longer lenses, furniture, turned cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera, rational_of
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError


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
