"""Start values from boards: each camera's own calibration, then the cameras by the boards they see together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.calibration._board_looks import FEWEST_CORNERS, shown_share, sighting, told_of
from tracker.cameras.calibration._boards import (
    Link,
    Pattern,
    SeenCorners,
    check_ends,
    find_board,
    goes_on,
    links_of,
    odd_pairs,
    one_way_round,
    plain_grey,
    refuse,
)
from tracker.cameras.calibration._bundle import Observations, State
from tracker.cameras.calibration._objects import Boards, camera_of, nominal_state, pinhole_of, state_of
from tracker.cameras.camera import Camera, rational_of
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.errors import CalibrationError
from tracker.kernels.rows import BundleCameraRow

LensKind = Literal["pinhole", "fisheye"]

FEWEST_BOARDS = 3
"""Zhang 2000, section 3.1: three views of a plane determine the interior."""

_OPEN_FOCAL, _LEAST_TILT_DEG, _FOCALS = 0.1, 4.0, (0.25, 5.0)
"""A view's own boards leave its camera constant open with a larger standard error, as a share of it, where nine of ten
are less tilted, or where it comes out as no lens's, in longer sides of the image: of boards that are not tilted at all,
OpenCV finds any, with a standard error of 0."""

_FISHEYE_FOCALS, _FISHEYE_TRIES = (0.2, 1.0), 24
"""Pixels to a radian that are tried, as shares of the longer side (which then sees 57 to 286 degrees): 7 % apart."""


def board_start(
    seen: SeenCorners,
    names: Sequence[str],
    sizes: Sequence[tuple[int, int]],
    lens: LensKind = "pinhole",
    turns: Sequence[Array] = (np.eye(4),),
) -> tuple[State, Observations]:
    """Cameras, board poses and observations.

    Args:
        seen: detected boards, six corners each at least.
        names: of the cameras, for messages.
        sizes: of their images, px.
        lens: kind of the lenses.
        turns: (4, 4) motions of the board after which it looks as before; see `_board_order`.

    Raises:
        CalibrationError: a camera saw too few boards, or none together with the others, or boards that do not show its
            focal length, or not the board of the others.
    """
    cameras = _cameras(seen, names, sizes, lens)
    camera_from_board = {key: _pose(cameras[key[0]], *found) for key, found in seen.items()}
    links = links_of(camera_from_board, len(names), turns)
    motions = _chained(links, names)
    if odd := odd_pairs(links):
        refuse(odd, names, _mirror_images(seen, cameras, sizes), camera_from_board, turns)
    if len(turns) > 1:
        check_ends(links, names)
    seen, camera_from_board = one_way_round(seen, camera_from_board, motions, turns)
    for v, motion in enumerate(motions):
        cameras[v, BundleCameraRow.ROTATION] = motion[:3, :3].ravel()
        cameras[v, BundleCameraRow.CENTRE] = -motion[:3, :3].T @ motion[:3, 3]
    frames = sorted({frame for _, frame in seen})
    world_from_board = []
    for frame in frames:
        guesses = [(len(seen[key][0]), key) for key in seen if key[1] == frame]
        _, best = max(guesses)
        world_from_board.append(np.linalg.inv(motions[best[0]]) @ camera_from_board[best])
    return _assembled(seen, frames, cameras, np.stack(world_from_board))


def _cameras(seen: SeenCorners, names: Sequence[str], sizes: Sequence[tuple[int, int]], lens: LensKind) -> Array:
    """(V, 26) cameras at the origin; those whose boards leave the focal length open have that of the others."""
    views = list(enumerate(zip(names, sizes, strict=True)))
    found = [_camera(seen, v, name, size, lens) for v, (name, size) in views]
    told = [v for v, (_, determined) in enumerate(found) if determined]
    if not told:
        raise CalibrationError(
            f"{', '.join(names)}: the board is tilted too little before every camera, which leaves focal lengths and "
            "distances open: hold it turned by 20 to 45 degrees, to all sides, and near"
        )
    usual = float(np.median([found[v][0][BundleCameraRow.C] / max(sizes[v]) for v in told]))
    return np.stack(
        [camera if v in told else nominal_state(sizes[v], usual * max(sizes[v])) for v, (camera, _) in enumerate(found)]
    )


def _camera(seen: SeenCorners, view: int, name: str, size: tuple[int, int], lens: LensKind) -> tuple[Array, bool]:
    """(26,) camera constant and first distortion from some boards, principal point in the middle.

    The second is whether the boards determine its camera constant.
    """
    mine = [found for (v, _), found in sorted(seen.items()) if v == view]
    if len(mine) < FEWEST_BOARDS:
        raise CalibrationError(
            f'view "{name}": the board is seen in {len(mine)} frames, expected at least {FEWEST_BOARDS}; are the '
            "images blank or blurred, or columns, rows and dictionary not those of the board?"
        )
    chosen = [mine[k] for k in np.linspace(0, len(mine) - 1, min(len(mine), 30)).astype(int)]
    if lens == "fisheye":
        return _fisheye_camera(chosen, name, size), True
    points = [np.ascontiguousarray(shape, dtype=np.float32) for shape, _ in chosen]
    pixels = [np.ascontiguousarray(found, dtype=np.float32) for _, found in chosen]
    flags = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    guess = nominal_state(size, 1.1 * max(size))
    matrix = np.array([[guess[12], 0, guess[13]], [0, guess[12], guess[14]], [0, 0, 1.0]])
    _, matrix, terms, turns, _, sigmas, _, _ = cv2.calibrateCameraExtended(
        points, pixels, size, matrix, np.zeros(5), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS
    )
    guess[12] = matrix[1, 1]
    guess[17:19] = terms.ravel()[:2]
    tilts = np.arccos(Rotation.from_rotvec(np.stack(turns).reshape(-1, 3)).as_matrix()[:, 2, 2].clip(0, 1))
    sigma, focal = sigmas.ravel()[1] / matrix[1, 1], matrix[1, 1] / max(size)
    tilted = np.degrees(np.percentile(tilts, 90)) > _LEAST_TILT_DEG
    return guess, bool(sigma < _OPEN_FOCAL and tilted and _FOCALS[0] < focal < _FOCALS[1])


def _fisheye_camera(chosen: Sequence[tuple[Array, Array]], name: str, size: tuple[int, int]) -> Array:
    """(26,) the equidistant lens by which the boards are most nearly flat; its numerator is adjusted later."""
    focals_px = np.geomspace(*_FISHEYE_FOCALS, _FISHEYE_TRIES) * max(size)
    cameras = [_equidistant(name, size, focal_px) for focal_px in focals_px]
    best = min(cameras, key=lambda camera: sum(_bent_px(camera, *one) for one in chosen))
    return state_of(best)


def _equidistant(name: str, size: tuple[int, int], focal_px: float) -> Camera:
    """A camera that images in proportion to the angle from its axis."""
    plain = camera_of(nominal_state(size, focal_px), name, size)
    return replace(plain, distortion=rational_of(name, size, plain.matrix, np.zeros(4)))


def _bent_px(camera: Camera, shape: Array, pixels: Array) -> float:
    """RMS of a board's corners beside the best homography of its plan, px; that of the image where there is none."""
    plane = camera.undistort(pixels)
    matrix = cv2.findHomography(shape[:, :2], plane)[0] if np.isfinite(plane).all() else None
    if matrix is None:
        return float(max(camera.size))
    flat = cv2.perspectiveTransform(shape[None, :, :2], matrix)[0]
    found = camera.project(np.column_stack([flat, np.ones(len(flat))]))
    gaps = np.where(np.isfinite(found), found - pixels, max(camera.size))
    return float(np.sqrt((gaps**2).sum(axis=1).mean()))


def _pose(camera: Array, shape: Array, pixels: Array) -> Array:
    """(4, 4) camera_from_board."""
    matrix = pinhole_of(camera)
    _, turn, shift = cv2.solvePnP(shape, pixels, matrix, camera[BundleCameraRow.DISTORTION], flags=cv2.SOLVEPNP_IPPE)
    turn, shift = cv2.solvePnPRefineLM(shape, pixels, matrix, camera[BundleCameraRow.DISTORTION], turn, shift)
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(turn.ravel()).as_matrix()
    motion[:3, 3] = shift.ravel()
    return motion


def _mirror_images(
    seen: SeenCorners, cameras: Array, sizes: Sequence[tuple[int, int]]
) -> list[dict[tuple[int, int], Array]]:
    """(4, 4) camera_from_board of all boards, were the pictures mirrored back: in three ways a board may seem then."""
    ends = np.stack([shape for shapes, _ in seen.values() for shape in (shapes.min(axis=0), shapes.max(axis=0))])
    both = ends.min(axis=0) + ends.max(axis=0)
    ways: list[dict[tuple[int, int], Array]] = []
    for signs in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0)):
        sign = np.array([*signs, 1.0])
        poses = {}
        for (view, frame), (shape, pixels) in seen.items():
            shown = np.column_stack([sizes[view][0] - 1 - pixels[:, 0], pixels[:, 1]])
            poses[view, frame] = _pose(cameras[view], np.where(sign > 0, shape, both - shape), shown)
        ways.append(poses)
    return ways


def _chained(links: dict[tuple[int, int], Link], names: Sequence[str]) -> list[Array]:
    """(4, 4) camera_from_world of every camera; the world is the first camera's frame."""
    known: dict[int, Array] = {0: np.eye(4)}
    while len(known) < len(names):
        n_frames, view, other = max(
            (links[pair].n_frames if pair in links else 0, *pair) for pair in _open_links(names, known)
        )
        if n_frames == 0:
            lacking = [name for v, name in enumerate(names) if v not in known]
            raise CalibrationError(
                f"{', '.join(lacking)}: no frame shows the board together with {', '.join(names[v] for v in known)}; "
                "hold it where both see it"
            )
        known[view] = links[view, other].motion @ known[other]
    return [known[v] for v in range(len(names))]


def _open_links(names: Sequence[str], known: dict[int, Array]) -> list[tuple[int, int]]:
    unknown = [v for v in range(len(names)) if v not in known]
    return list(itertools.product(unknown, known))


def _assembled(seen: SeenCorners, frames: list[int], cameras: Array, poses: Array) -> tuple[State, Observations]:
    """One point for every corner of every pose that a view shows; the observations sorted by pose."""
    shapes: list[Array] = []
    pixels: list[Array] = []
    owners: list[int] = []
    views: list[int] = []
    points: list[int] = []
    for g, frame in enumerate(frames):
        numbers: dict[tuple[float, ...], int] = {}
        for view in range(len(cameras)):
            for corner, pixel in zip(*seen.get((view, frame), (np.zeros((0, 3)), np.zeros((0, 2)))), strict=True):
                key = tuple(np.round(corner, 6))
                if key not in numbers:
                    numbers[key] = len(shapes)
                    shapes.append(corner)
                    owners.append(g)
                views.append(view)
                points.append(numbers[key])
                pixels.append(pixel)
    boards = Boards(np.stack(shapes), np.array(owners, dtype=np.int64), poses)
    images = np.stack(pixels)
    observations = Observations(np.array(views), np.array(points), images, np.zeros_like(images))
    return State(cameras, boards), observations


# Looking for a board in the images of views; where it is not seen, it is soon told which board is.

_LOOKED_AGAIN = (16, 128, 1024)
"""Frames in which no view shows the board, after which it is looked what else they show."""
_KEPT, _LOOKED_AT = 6, 2
"""Pictures of a view that are kept, spread over the recording; those of each view that are looked at on the way."""
_SHARES, _AT_ODDS = 5, 0.1
"""Boards with measured markers, and the largest share by which the given size may differ: pictures show it to 3 %."""


class BoardSearch:
    """Observations of a board so far.

    Raises:
        CalibrationError: as soon as the pictures show another board than the configured one.
    """

    def __init__(self, names: Sequence[str], patterns: Sequence[Pattern], square_m: float, both_sides: bool) -> None:
        self.seen: SeenCorners = {}
        """Corners in the board's frame, metres, and their pixels, by view and frame."""

        self.patterns = tuple(patterns)
        """Possible patterns of the board: one, as soon as a picture has decided."""

        self._names, self._square_m, self._both_sides = names, square_m, both_sides
        self._kept: list[list[Image]] = [[] for _ in names]
        self._strides, self._counts = [1] * len(names), [0] * len(names)
        self._shares: list[float] = []

    def look(self, view: int, frame: int, image: Image) -> None:
        """Looks for the board in an image of a view."""
        numbers, pixels = self._found(image)
        shape = self._square_m * self.patterns[0].plan[numbers]
        if len(pixels) < FEWEST_CORNERS or _in_a_line(shape):
            self._keep(view, image)
            return
        if self._is_whole(view, image, pixels):
            self._measure_markers(image)
            self.seen[view, frame] = shape, pixels

    def after(self, n_frames: int) -> None:
        """Looks, after some frames in which no view has shown the board, which board they show."""
        if self.seen or n_frames not in _LOOKED_AGAIN:
            return
        found = sighting([picture for kept in self._kept for picture in kept[-_LOOKED_AT:]], self.patterns[0])
        if found is not None and found.is_meant(self.patterns[0]):
            raise CalibrationError(f"no view shows the board in {n_frames} frames; {found.told(self.patterns[0])}")

    def finish(self) -> None:
        """Looks, where a view has shown too few boards, what it shows instead."""
        counts = [sum(v == view for v, _ in self.seen) for view in range(len(self._names))]
        for view, name in enumerate(self._names):
            if counts[view] >= FEWEST_BOARDS:
                continue
            question = "are its images blank or blurred, or was the board never whole before this camera?"
            if max(counts) < FEWEST_BOARDS:
                question = "are the images blank or blurred, or columns, rows and dictionary not those of the board?"
            raise CalibrationError(
                f'view "{name}": the board is seen in {counts[view]} frames, expected at least {FEWEST_BOARDS}; '
                f"{told_of(self._kept[view], self.patterns[0]) or question}"
            )

    def _found(self, image: Image) -> tuple[Integers, Array]:
        """Numbers and pixels of the corners by the pattern that sees most; its rivals are left out from then on."""
        found = [self._both(image, pattern) for pattern in self.patterns]
        best = max(range(len(found)), key=lambda k: len(found[k][0]))
        if len(found[best][0]) >= FEWEST_CORNERS:
            self.patterns = (self.patterns[best],)
        return found[best]

    def _both(self, image: Image, pattern: Pattern) -> tuple[Integers, Array]:
        """As `find_board`, also for the back of the board if it has one."""
        numbers, pixels = find_board(image, pattern)
        if self._both_sides and len(numbers) < FEWEST_CORNERS:
            numbers, pixels = find_board(np.ascontiguousarray(image[:, ::-1]), pattern)
            pixels = np.column_stack([image.shape[1] - 1 - pixels[:, 0], pixels[:, 1]])
        return numbers, pixels

    def _is_whole(self, view: int, image: Image, pixels: Array) -> bool:
        """Whether a chessboard is not a part of a larger one, whose corners would be taken for others."""
        pattern = self.patterns[0]
        if pattern.marker is not None or not goes_on(image, pixels, pattern.size):
            return True
        found = sighting([image], pattern)
        if found is not None and found.n_corners > len(pixels):
            raise CalibrationError(
                f'view "{self._names[view]}": more inner corners than {pattern.columns} x {pattern.rows}: '
                f"{found.told(pattern)}"
            )
        return False

    def _measure_markers(self, image: Image) -> None:
        """Compares the given size of the markers with the first pictures."""
        told = self.patterns[0].marker
        share = None if told is None or len(self._shares) >= _SHARES else shown_share(image, self.patterns[0])
        if share is None or told is None:
            return
        self._shares.append(share)
        middle = float(np.median(self._shares))
        if len(self._shares) == _SHARES and abs(middle / told - 1) > _AT_ODDS:
            raise CalibrationError(
                f"marker_m is {told:.2f} of square_m, and in the pictures {middle:.2f}: measure both again; if "
                f"square_m = {self._square_m:g} is right, marker_m is about {middle * self._square_m:.2g}"
            )

    def _keep(self, view: int, image: Image) -> None:
        """Keeps a picture without a board now and then, never many."""
        kept, self._counts[view] = self._kept[view], self._counts[view] + 1
        if self._counts[view] % self._strides[view]:
            return
        kept.append(plain_grey(image))
        if len(kept) > _KEPT:
            del kept[::2]
            self._strides[view] *= 2


def patterns_of(pattern: Pattern, legacy: bool | None) -> tuple[Pattern, ...]:
    """The patterns that a board may have: where its rows are even, ChArUco boards of old begin with a white square."""
    if legacy is None and pattern.marker is not None and pattern.rows % 2 == 0:
        return replace(pattern, legacy=False), replace(pattern, legacy=True)
    return (replace(pattern, legacy=bool(legacy)),)


def _in_a_line(shape: Array) -> bool:
    spread = np.linalg.svd(shape - shape.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 0.1 * spread[0])
