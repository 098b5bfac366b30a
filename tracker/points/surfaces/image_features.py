"""Image features of two views that look alike: approximate correspondences, and whether they agree."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.triangulation import triangulate
from tracker.foundation.arrays import Array, Image, Mask

# Lowe 2004, section 7.1.
_RATIO = 0.8


@dataclass(frozen=True)
class Candidates:
    """Approximate correspondences, before they are matched."""

    at: Array
    """(N, 2) px in the template."""

    start: Array
    """(N, 2) px in the search image."""

    affines: tuple[Array, ...]
    """Approximate affine transformations (N, 2, 2), one or more to be tried."""

    def select(self, which: Mask) -> Candidates:
        """The chosen ones."""
        return Candidates(self.at[which], self.start[which], tuple(affine[which] for affine in self.affines))


def features(grey: Image, largest_px: int, n_features: int) -> tuple[list[cv2.KeyPoint], Array]:
    """SIFT features in pixels of the whole image, and their descriptors (N, 128)."""
    scale = min(1.0, largest_px / max(grey.shape))
    smaller = grey if scale == 1.0 else cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    points, descriptors = cv2.SIFT.create(n_features).detectAndCompute(smaller, None)
    for point in points:
        x, y = point.pt
        point.pt = (x + 0.5) / scale - 0.5, (y + 0.5) / scale - 0.5
        point.size /= scale
    return list(points), np.zeros((0, 128), np.float32) if descriptors is None else descriptors


def paired(one: Array, two: Array) -> list[tuple[int, int]]:
    """Features that are each other's nearest, and much nearer than the second nearest."""
    if len(one) < 2 or len(two) < 2:
        return []
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(two, one)}
    pairs = matcher.knnMatch(one, two, k=2)
    best = [first for first, second in pairs if first.distance < _RATIO * second.distance]
    return [(m.queryIdx, m.trainIdx) for m in best if back[m.trainIdx] == m.queryIdx]


def correspondences(one: list[cv2.KeyPoint], two: list[cv2.KeyPoint]) -> Candidates:
    """Positions, and the similarity transformations of sizes and directions."""
    at, start = (np.array([point.pt for point in points]) for points in (one, two))
    scale = np.array([b.size / a.size for a, b in zip(one, two, strict=True)])
    turn = np.radians([b.angle - a.angle for a, b in zip(one, two, strict=True)])
    rotation = np.stack([np.cos(turn), -np.sin(turn), np.sin(turn), np.cos(turn)], axis=1).reshape(-1, 2, 2)
    return Candidates(at, start, (scale[:, None, None] * rotation,))


def reprojection(cameras: tuple[Camera, Camera], found: Candidates) -> Array:
    """Reprojection errors (N,) of the best common points, px; infinite behind a camera."""
    points, _ = triangulate(cameras, np.stack([found.at, found.start]))
    errors = [camera.project(points) - pixels for camera, pixels in zip(cameras, (found.at, found.start), strict=True)]
    distances = np.linalg.norm(np.stack(errors), axis=-1).max(axis=0)
    return np.where(np.isfinite(distances), distances, np.inf)


def n_consistent(found: Candidates, limit: float) -> int:
    """Correspondences that agree with some epipolar geometry, whichever it is."""
    if len(found.at) < 8:
        return 0
    _, inliers = cv2.findFundamentalMat(found.at, found.start, cv2.FM_RANSAC, limit, 0.999)
    return 0 if inliers is None else int(inliers.sum())


def disagreement(names: tuple[str, str], distances: Array, limit: float, consistent: int) -> str:
    """Why features that look alike do not agree with the calibration."""
    n, n_agreeing = len(distances), int((distances < limit).sum())
    start = f'views "{names[0]}" and "{names[1]}": {n} image features look alike'
    if consistent > max(20, 0.4 * n):
        return (
            f"{start} and {consistent} agree with one another, but only {n_agreeing} with the calibration "
            f"(median distance {np.median(distances):.0f} px): is this the rig of these images?"
        )
    return (
        f"{start}, but only {n_agreeing} agree with the calibration and {consistent} with one another: the views do "
        "not overlap or have too little texture; give seeds by hand ([seeds] given) if they show one surface"
    )
