"""Seed points of a surface measurement: given by hand, or found automatically."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pydantic

from tracker.cameras.camera import Camera
from tracker.cameras.triangulation import triangulate
from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import MatchingError
from tracker.points.surfaces import LeastSquaresMatching, Matches, PatchImage
from tracker.points.surfaces.growth import Growth

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


@component
class Seeds:
    """Start of growth."""

    given: tuple[dict[str, tuple[float, float]], ...] = ()
    """Points measured by hand, each a table of view = [x, y] px, to some pixels; empty to find them automatically."""

    search_px: int = pydantic.Field(default=8, ge=0, le=100)
    """Given points are searched by cross-correlation this far around, px."""

    n_features: int = pydantic.Field(default=6000, ge=100, le=20000)
    """Most image features that are compared for automatic seeds."""

    epipolar_px: float = pydantic.Field(default=3.0, gt=0)
    """Automatic seeds lie no farther from their epipolar lines than this, px."""

    largest_px: int = pydantic.Field(default=1300, ge=100)
    """Images are reduced to this length for the search for features, px."""

    @pydantic.field_validator("given", mode="before")
    @classmethod
    def _whole_numbers_are_positions(cls, given: object) -> object:
        if not isinstance(given, tuple | list):
            return given
        return tuple(_as_floats(point) for point in given)

    def candidates(self, greys: tuple[Image, Image], cameras: tuple[Camera, Camera]) -> Candidates:
        """Approximate correspondences of two views.

        Args:
            greys: template and search image (h, w).
            cameras: of both views.

        Raises:
            MatchingError: too few of them, with what seems to be the reason.
        """
        if self.given:
            return self._searched(greys, cameras)
        names = cameras[0].name, cameras[1].name
        one, two = (features(grey, self.largest_px, self.n_features) for grey in greys)
        pairs = paired(one[1], two[1])
        if len(pairs) < _FEW:
            raise MatchingError(
                f'views "{names[0]}" and "{names[1]}": {len(pairs)} of {len(one[0])} image features look alike, '
                f"expected {_FEW} or more: the views do not overlap, or have too little texture; "
                "give seeds by hand ([seeds] given) if they show the same surface"
            )
        found = correspondences([one[0][i] for i, _ in pairs], [two[0][j] for _, j in pairs])
        distances = reprojection(cameras, found)
        agreeing = distances < self.epipolar_px
        consistent = n_consistent(found, self.epipolar_px)
        if agreeing.sum() < max(_FEW, _LEAST_AGREEING * consistent):
            raise MatchingError(disagreement(names, distances, self.epipolar_px, consistent))
        found = found.select(agreeing)
        return Candidates(found.at, found.start, (*found.affines, facing_affine(cameras, found.at, found.start)))

    def _searched(self, greys: tuple[Image, Image], cameras: tuple[Camera, Camera]) -> Candidates:
        """Given points, moved to the best cross-correlation around."""
        names = cameras[0].name, cameras[1].name
        pairs = [(point[names[0]], point[names[1]]) for point in self.given if names[0] in point and names[1] in point]
        if not pairs:
            raise MatchingError(
                f'[seeds] given: no point for both "{names[0]}" and "{names[1]}"; expected tables like '
                f"{{ {names[0]} = [320, 240], {names[1]} = [301, 240] }}"
            )
        at, start = (np.array([pair[k] for pair in pairs]) for k in range(2))
        affine = facing_affine(cameras, at, start)
        places = zip(at, start, affine, strict=True)
        start = np.array([_best_correlation(greys, *place, self.search_px) for place in places])
        return Candidates(at, start, (affine,))


# The fundamental matrix has seven degrees of freedom; where it is known, six matches still show a wrong one.
_FEW = 6
# Matches that agree with their neighbours: below a third, the rest agrees by chance.
_LEAST_AGREEING = 0.3


def _as_floats(point: object) -> object:
    if not isinstance(point, dict):
        return point
    return {view: tuple(float(x) for x in position) for view, position in point.items()}


def facing_affine(cameras: tuple[Camera, Camera], at: Array, start: Array) -> Array:
    """Affine transformations (N, 2, 2) of patches that face the template's camera, from the rig alone.

    Args:
        cameras: of the template and the search image.
        at, start: (N, 2) approximate correspondences, px.

    Returns:
        The unit matrix where the rays do not meet before the cameras.
    """
    points, _ = triangulate(cameras, np.stack([at, start]))
    depths = cameras[0].in_camera(points)[:, 2]
    forward = cameras[0].camera_from_world[2, :3]
    places = []
    for offset in (np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0])):
        rays = cameras[0].rays(at + offset)
        places.append(cameras[1].project(cameras[0].centre + rays * (depths / (rays @ forward))[:, None]))
    affine = np.stack([places[1] - places[0], places[2] - places[0]], axis=-1)
    usable = np.isfinite(affine).all(axis=(1, 2)) & (depths > 0)
    return np.where(usable[:, None, None], affine, np.eye(2))


def _best_correlation(
    greys: tuple[Image, Image], at: Array, start: Array, affine: Array, reach: int, half: int = 10
) -> Array:
    """Position of the best cross-correlation in a search box (paper, section 2.3, step 2), px."""
    size = 2 * half + 1
    inverse = np.linalg.inv(affine)
    to_template = np.c_[inverse, at - inverse @ (half, half)]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    patch = cv2.warpAffine(greys[0], to_template, (size, size), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    u, v = np.round(start).astype(int)
    box = greys[1][max(0, v - half - reach) : v + half + reach + 1, max(0, u - half - reach) : u + half + reach + 1]
    if box.shape != (size + 2 * reach, size + 2 * reach):
        return start
    row, column = np.unravel_index(np.argmax(cv2.matchTemplate(box, patch, cv2.TM_CCOEFF_NORMED)), (2 * reach + 1,) * 2)
    return np.array([u - reach + column, v - reach + row], dtype=np.float64)


@dataclass(frozen=True)
class MatchedSeeds:
    """Result of the candidates."""

    matches: Matches
    """Good ones, at cells of the growth grid."""

    failed: Candidates
    """The others."""

    faults: tuple[str, ...]
    """Why they failed, a text for each."""


def matched_seeds(
    candidates: Candidates, matching: LeastSquaresMatching, growth: Growth, images: tuple[PatchImage, PatchImage]
) -> MatchedSeeds:
    """Candidates moved to the growth grid and matched.

    Each is tried with all its affine transformations; the best one counts.
    """
    at = np.round(candidates.at / growth.step_px) * growth.step_px
    patient = replace(matching, max_shift_px=max(6.0, matching.max_shift_px), prior_sd=None)
    rounds = []
    for affine in candidates.affines:
        start = candidates.start + np.einsum("nij,nj->ni", affine, at - candidates.at)
        rounds.append(patient.match(*images, at, start, affine))
    good = np.stack([growth.good(matches) for matches in rounds])
    correlation = np.where(good, [matches.correlation for matches in rounds], -1.0)
    best = correlation.argmax(axis=0), np.arange(len(at))
    found = np.stack([matches.found for matches in rounds])[best]
    ended = np.stack([matches.ended for matches in rounds])[best]
    kept = correlation.max(axis=0) >= 0
    faults = growth.faults(Matches(at[~kept], found[~kept], ended[~kept]))
    _, first = np.unique(at[kept], axis=0, return_index=True)
    chosen = np.flatnonzero(kept)[first]
    return MatchedSeeds(Matches(at[chosen], found[chosen], ended[chosen]), candidates.select(~kept), tuple(faults))
