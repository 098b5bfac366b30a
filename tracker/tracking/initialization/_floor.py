"""The visible floor: places where a person may be."""

from __future__ import annotations

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask

# Poses at a time: bounds the memory.
_BATCH = 4096


def floor_places(rig: Rig, floor_m: float, step_m: float, most_m: float) -> Array:
    """Places (N, 2) on the floor in the views of at least two cameras (of one, if there is no other), metres.

    Args:
        rig: the cameras.
        floor_m: height of the floor, metres.
        step_m: distance of neighbouring places, metres.
        most_m: largest distance from a camera, metres.
    """
    corners = np.concatenate([_footprint(camera, floor_m, most_m) for camera in rig.cameras])
    if not len(corners):
        return np.zeros((0, 2))
    low, high = np.floor(corners.min(axis=0) / step_m), np.ceil(corners.max(axis=0) / step_m)
    axes = [step_m * np.arange(a, b + 1) for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.concatenate([places, np.full((len(places), 1), floor_m)], axis=1)
    seen = [_sees(camera, points) & (_away(camera, points) <= most_m) for camera in rig.cameras]
    views = np.sum(seen, axis=0)
    found: Array = places[views >= min(2, len(rig))]
    return found


def shown_share(body: BodyModel, poses: Array, rig: Rig) -> Array:
    """(N, V) share of the landmarks of poses (N, dof) that lie in the image of each view."""
    shown = np.empty((len(poses), len(rig)))
    for i in range(0, len(poses), _BATCH):
        points = body.landmarks_in_world(poses[i : i + _BATCH])
        for v, camera in enumerate(rig.cameras):
            shown[i : i + _BATCH, v] = _sees(camera, points).mean(axis=1)
    return shown


def _footprint(camera: Camera, floor_m: float, most_m: float) -> Array:
    """Points where rays through a grid of pixels (N, 2) meet the floor, or leave its neighbourhood, metres."""
    columns, rows = (np.linspace(0, size - 1, 24) for size in camera.size)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rays, height = camera.rays(pixels), camera.centre[2] - floor_m
    falls = rays[:, 2] * np.sign(height) < -1e-6
    reach = np.where(falls, height / np.where(falls, -rays[:, 2], 1.0), np.inf)
    across = np.linalg.norm(rays[:, :2], axis=1)
    reach = np.minimum(reach, most_m / np.maximum(across, 1e-6))
    met: Array = (camera.centre + reach[:, None] * rays)[falls, :2]
    return met


def _sees(camera: Camera, points: Array) -> Mask:
    """Which points (..., 3) are in the image."""
    # Near the plane of the lens the distortion runs away.
    before = camera.in_camera(points)[..., 2] > 0.1
    pixels = camera.project(np.where(before[..., None], points, np.nan))
    seen: Mask = np.all((pixels > 0) & (pixels < np.array(camera.size) - 1), axis=-1)
    return seen


def _away(camera: Camera, points: Array) -> Array:
    gaps: Array = np.linalg.norm(points - camera.centre, axis=-1)
    return gaps
