"""Start values from scratch: essential matrix of two views, scale from the bar, resection of the others.

Focal lengths need to be known to about 10 %; the two-view solution is adjusted with them before it carries others.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.calibration._bundle import Noise, Observations, State, adjust, noise_of, residuals
from tracker.cameras.calibration._objects import GROUPS, Bars
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import CalibrationError
from tracker.kernels.rows import BundleCameraRow, BundleUnknowns

_EPIPOLAR_PX = 4.0
"""Errors that are taken for distortion and a wrong focal length."""

# Ten bars are 20 points, four times the five that an essential matrix needs; of many, 100 spread evenly do.
FEWEST_BARS, _SAMPLED_BARS = 10, 100


@dataclass(frozen=True)
class Pair:
    """Two views oriented to each other."""

    views: tuple[int, int]
    flipped: bool
    rotation: Array
    translation: Array
    n_fitting: int
    n_shared: int
    spread: float
    """Median deviation of the bar's length from its median, as a share of it."""

    @property
    def score(self) -> float:
        """Higher is better."""
        return self.n_fitting / (0.02 + self.spread)

    @property
    def good(self) -> bool:
        """Whether no other pair is needed."""
        return self.n_fitting > 0.6 * self.n_shared and self.spread < 0.05


def best_pair(plane: Array, nominal: Array, names: Sequence[str]) -> Pair:
    """The two views with most bars that agree with one relative orientation and one bar length.

    Raises:
        CalibrationError: there are not two views, they share too few bars, or none fit together.
    """
    if len(names) < 2:
        raise CalibrationError(
            f"the bar is seen by {', '.join(names) or 'no view'} alone, expected at least two views: record it with "
            "all cameras at once"
        )
    seen: Mask = np.asarray(np.isfinite(plane).all(axis=(2, 3)))
    shared = {(i, j): int((seen[i] & seen[j]).sum()) for i, j in itertools.combinations(range(len(seen)), 2)}
    chosen = sorted(shared, key=lambda pair: -shared[pair])[:12]
    if shared[chosen[0]] < FEWEST_BARS:
        i, j = chosen[0]
        raise CalibrationError(
            f"no two views show {FEWEST_BARS} common bar positions ({names[i]} and {names[j]} share {shared[i, j]}, "
            "the most): move the bar where two cameras see both its ends"
        )
    best: Pair | None = None
    for pair, flip in itertools.product(chosen, (False, True)):
        found = _relative(plane, nominal, pair, flip) if shared[pair] >= FEWEST_BARS else None
        if found is not None and (best is None or found.score > best.score):
            best = found
        if best is not None and best.good:
            break
    if best is None:
        raise CalibrationError(
            "no two views fit together: are they synchronized, are the focal lengths right to 10 %, and is the bar "
            "moved in all directions?"
        )
    return best


def _relative(plane: Array, nominal: Array, views: tuple[int, int], flip: bool) -> Pair | None:
    """Relative orientation by RANSAC over the five-point solution (Nister 2004)."""
    i, j = views
    first, second = plane[i], plane[j][:, ::-1] if flip else plane[j]
    both = np.asarray(np.isfinite(first).all(axis=(1, 2)) & np.isfinite(second).all(axis=(1, 2)))
    chosen = np.flatnonzero(both)
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), _SAMPLED_BARS)).astype(int)]
    a, b = first[chosen].reshape(-1, 2), second[chosen].reshape(-1, 2)
    threshold = _EPIPOLAR_PX / float(np.sqrt(nominal[i, 12] * nominal[j, 12]))
    essential, mask = cv2.findEssentialMat(a, b, np.eye(3), cv2.RANSAC, 0.999, threshold, 300)
    if essential is None or essential.shape != (3, 3):
        return None
    n, rotation, translation, mask = cv2.recoverPose(essential, a, b, np.eye(3), mask=mask)
    points = cv2.triangulatePoints(np.eye(3, 4), np.hstack([rotation, translation]), a.T, b.T)
    inside = mask.ravel().reshape(-1, 2).astype(bool).all(axis=1)
    if n < FEWEST_BARS or inside.sum() < FEWEST_BARS // 2:
        return None
    with np.errstate(all="ignore"):
        space = (points[:3] / points[3]).T.reshape(-1, 2, 3)[inside]
    lengths = np.linalg.norm(space[:, 1] - space[:, 0], axis=1)
    middle = float(np.median(lengths))
    spread = float(np.median(np.abs(lengths - middle))) / max(middle, 1e-9)
    if not np.isfinite(spread):
        return None
    return Pair(views, flip, rotation, translation.ravel(), int(n), len(a), spread)


_RESECTION_PX = 20.0
"""Errors that are taken for distortion and a wrong focal length."""


def bar_observations(pixels: Array, velocities: Array) -> Observations:
    """Observations of all seen ends: (V, B, 2, 2) px sorted by bar, end and view."""
    by_bar = np.ascontiguousarray(np.moveaxis(pixels, 0, 2))
    seen = np.isfinite(by_bar).all(axis=3)
    bars, ends, views = np.nonzero(seen)
    speeds = np.nan_to_num(np.moveaxis(velocities, 0, 2)[seen])
    return Observations(views, 2 * bars + ends, by_bar[seen], np.ascontiguousarray(speeds))


def start_values(pixels: Array, nominal: Array, bar: tuple[float, float], names: Sequence[str]) -> tuple[State, Mask]:
    """Cameras and bars near enough to the truth for an adjustment.

    Args:
        pixels: (V, B, 2, 2) px, NaN where not seen.
        nominal: (V, 26) cameras without exterior orientation.
        bar: length and its standard deviation, metres.
        names: of the cameras, for messages.

    Returns:
        The state, and (V,) which views call the ends the other way round; in the state's order they are exchanged.

    Raises:
        CalibrationError: two views share too few bars, or no two views fit together.
    """
    plane = (pixels - nominal[:, None, None, 13:15]) / nominal[:, None, None, 12:13]
    pair = best_pair(plane, nominal, names)
    flipped = np.zeros(len(nominal), dtype=np.bool_)
    flipped[pair.views[1]] = pair.flipped
    cameras = nominal.copy()
    _orient(cameras[pair.views[0]], np.eye(3), np.zeros(3))
    _orient(cameras[pair.views[1]], pair.rotation, pair.translation)
    known = list(pair.views)
    ends = _triangulated(cameras, plane, flipped, known)
    scale = bar[0] / np.nanmedian(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    cameras[:, BundleCameraRow.CENTRE] *= scale
    cameras, ends = _settled(cameras, scale * ends, pixels, flipped, known, bar)
    while len(known) < len(nominal):
        view = _resect_next(cameras, ends, plane, flipped, known, names)
        known.append(view)
        more = _triangulated(cameras, plane, flipped, known)
        ends = np.where(np.isfinite(ends), ends, more)
        cameras, ends = _settled(cameras, ends, pixels, flipped, known, bar)
    return State(cameras, Bars(ends, *bar)), flipped


def _orient(camera: Array, rotation: Array, translation: Array) -> None:
    camera[BundleCameraRow.ROTATION], camera[BundleCameraRow.CENTRE] = rotation.ravel(), -rotation.T @ translation


def _labelled(values: Array, flipped: Mask) -> Array:
    """(V, B, 2, 2) with the ends exchanged in flipped views."""
    return np.where(flipped[:, None, None, None], values[:, :, ::-1], values)


def _triangulated(cameras: Array, plane: Array, flipped: Mask, known: list[int]) -> Array:
    """Ends (B, 2, 3) nearest to the rays of the oriented views; NaN with fewer than two, or behind a camera."""
    labelled = _labelled(plane, flipped)[known].reshape(len(known), -1, 2)
    seen: Mask = np.asarray(np.isfinite(labelled).all(axis=2))
    matrix, vector = np.zeros((labelled.shape[1], 3, 3)), np.zeros((labelled.shape[1], 3))
    for view, images, visible in zip(known, labelled, seen, strict=True):
        local = np.column_stack([np.nan_to_num(images), np.ones(len(images))])
        local /= np.linalg.norm(local, axis=1, keepdims=True)
        rays = local @ cameras[view, BundleCameraRow.ROTATION].reshape(3, 3)
        across = (np.eye(3) - rays[:, :, None] * rays[:, None, :]) * visible[:, None, None]
        matrix += across
        vector += across @ cameras[view, BundleCameraRow.CENTRE]
    good = (seen.sum(axis=0) >= 2) & (np.linalg.det(matrix) > 1e-7)
    points = np.full((len(matrix), 3), np.nan)
    points[good] = np.linalg.solve(matrix[good], vector[good][..., None])[..., 0]
    for view, visible in zip(known, seen, strict=True):
        depth = (points - cameras[view, BundleCameraRow.CENTRE]) @ cameras[
            view, BundleCameraRow.R31 : BundleCameraRow.X
        ]
        points[visible & ~(depth > 1e-6)] = np.nan
    return points.reshape(-1, 2, 3)


def _resect_next(
    cameras: Array, ends: Array, plane: Array, flipped: Mask, known: list[int], names: Sequence[str]
) -> int:
    """Orients the view that shows most of the bars found so far."""
    found = np.isfinite(ends).all(axis=2)
    n_shown = np.array(
        [(np.isfinite(p).all(axis=2) & found).sum() if v not in known else -1 for v, p in enumerate(plane)]
    )
    view = int(n_shown.argmax())
    if n_shown[view] < 2 * FEWEST_BARS:
        raise CalibrationError(
            f'camera "{names[view]}" shows {max(0, n_shown[view]) // 2} of the bar positions that the others see, '
            f"expected {FEWEST_BARS}: move the bar where its view overlaps with another camera's"
        )
    best = _resection(ends, plane[view], cameras[view, BundleCameraRow.C])
    if best[0] < 0.6 * n_shown[view]:
        other = _resection(ends, plane[view][:, ::-1], cameras[view, BundleCameraRow.C])
        flipped[view] = other[0] > best[0]
        best = max(best, other, key=lambda resection: resection[0])
    if best[0] < FEWEST_BARS:
        raise CalibrationError(
            f'camera "{names[view]}" fits the others in {best[0]} of {n_shown[view]} images of targets: is it '
            "synchronized with them, and its focal length right to 10 %?"
        )
    _orient(cameras[view], best[1], best[2])
    return view


def _resection(ends: Array, plane: Array, focal_px: float) -> tuple[int, Array, Array]:
    """Number of fitting images, rotation and translation of a view of known points."""
    seen = np.isfinite(plane).all(axis=2) & np.isfinite(ends).all(axis=2)
    points, images = ends[seen], plane[seen]
    cv2.setRNGSeed(1)
    done, turn, shift, fitting = cv2.solvePnPRansac(
        points,
        images,
        np.eye(3),
        None,
        iterationsCount=300,
        reprojectionError=_RESECTION_PX / focal_px,
        confidence=0.999,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not done or fitting is None or len(fitting) < 6:
        return 0, np.eye(3), np.zeros(3)
    chosen = fitting.ravel()
    turn, shift = cv2.solvePnPRefineLM(points[chosen], images[chosen], np.eye(3), None, turn, shift)
    return len(chosen), Rotation.from_rotvec(turn.ravel()).as_matrix(), shift.ravel()


def _settled(
    cameras: Array, ends: Array, pixels: Array, flipped: Mask, known: list[int], bar: tuple[float, float]
) -> tuple[Array, Array]:
    """Adjusts the oriented views with their camera constants and first radial distortion, gross errors weighed down."""
    good = np.isfinite(ends).all(axis=(1, 2))
    labelled = np.full_like(pixels, np.nan)
    labelled[known] = _labelled(pixels, flipped)[known]
    labelled = labelled[:, good]
    observations = bar_observations(labelled, np.zeros_like(labelled))
    free = np.zeros((len(cameras), BundleUnknowns.N_UNKNOWNS), dtype=np.bool_)
    free[np.ix_(known, [*GROUPS["exterior"], *GROUPS["camera_constant"], 11])] = True
    # Weak until the noise is known: a bar that is certain to 0.1 mm would overrule the images.
    state = State(cameras, Bars(ends[good], bar[0], 0.005 * bar[0]))
    for _ in range(2):
        scale = max(noise_of(residuals(state, observations)), 0.02)
        state, _ = adjust(state, observations, free, Noise(scale, 3 * scale), tolerance=0.01)
    settled = np.full_like(ends, np.nan)
    settled[good] = state.objects.points.reshape(-1, 2, 3)
    return state.cameras, settled
