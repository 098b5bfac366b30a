"""Points followed on the moving back while a strip passes before them."""

from __future__ import annotations

import cv2
import numpy as np
from rich.table import Table

from benchmarks.followed_back import N_POINTS, WRONG_MM, add_row, errors_of, followed
from benchmarks.moving_back import CENTRE, Back
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Mask
from tracker.points.following.following import Following


def add_rows(table: Table, back: Back) -> None:
    """Rows for a narrow strip and for a wide one.

    Args:
        table: of four columns.
        back: the recording.
    """
    for width_m, distance_m in ((0.10, 1.9), (0.25, 1.5)):
        _behind(table, back, _Strip(back.rig, back.n_frames, width_m, distance_m))


def _behind(table: Table, back: Back, strip: _Strip) -> None:
    """Points that a strip passes before; the wide one hides all of them from one view or another at a time."""
    start = back.start(N_POINTS)
    frames, _ = followed(back, start, Following(), strip.painted)
    covered = np.stack([strip.covered(k, back.rig.project(start.positions[k])) for k in range(back.n_frames)])
    shown = start.visible & ~covered
    last = frames[-1]
    for_a_time = ~shown.all(axis=(0, 1)) & shown[-1].all(axis=0) & shown[0].all(axis=0)
    seen = np.stack([frame.alive for frame in frames])
    lost_for_it = for_a_time & ~seen.all(axis=0)
    errors = errors_of(start, last).distance_mm[lost_for_it]
    back_again = np.isfinite(errors)
    name = f"strip of {strip.width_m:g} m at {strip.distance_m:g} m"
    alive = 100 * seen.mean(axis=1).min()
    note = f"{lost_for_it.sum()} of {for_a_time.sum()} points that it hides for a time; {alive:.0f} % seen at the least"
    add_row(table, f"{name}: found again", 100 * float(back_again.mean()), "%", 85.0, True, note)
    add_row(table, f"{name}: wrong among them", int((errors[back_again] > WRONG_MM).sum()), "", 0.0, False)
    if back_again.any():
        add_row(table, f"{name}: median error of them", float(np.median(errors[back_again])), "mm")
    behind = np.array([(seen[k] & covered[k].all(axis=0)).sum() for k in range(back.n_frames)])
    off = [
        (1000 * np.linalg.norm(f.positions - start.positions[k], axis=1)[covered[k].all(axis=0)] > WRONG_MM).sum()
        for k, f in enumerate(frames)
    ]
    table.add_row(f"{name}: seen though hidden", str(int(behind.sum())), "", f"in all views; {sum(off)} wrong")


class _Strip:
    """A textured upright strip that passes between the cameras and the back."""

    def __init__(self, rig: Rig, n_frames: int, width_m: float, distance_m: float) -> None:
        self.width_m, self.distance_m = width_m, distance_m
        centre = rig.cameras[CENTRE]
        self._axes = centre.camera_from_world[:3, :3]
        self._origin = centre.centre + self.distance_m * self._axes[2]
        self._rig, self._n = rig, n_frames
        size = centre.size
        pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(np.float64)
        self._places = [self._place(view, pixels) for view in range(len(rig))]
        rng = np.random.default_rng(0)
        self._texture = cv2.GaussianBlur(rng.normal(size=(2048, 1024)).astype(np.float32), (0, 0), 3.0)
        self._texture *= 25 / self._texture.std()

    def _place(self, view: int, pixels: Array) -> Array:
        """Metres to the right and down (..., 2) where rays meet the strip's plane."""
        camera = self._rig.cameras[view]
        rays = camera.rays(pixels)
        depth = ((self._origin - camera.centre) @ self._axes[2]) / (rays @ self._axes[2])
        place: Array = (camera.centre + depth[..., None] * rays - self._origin) @ self._axes[:2].T
        return place

    def _left(self, index: int) -> float:
        """Its left edge, m: outside the images at first and at last."""
        return -0.75 + (1.5 - self.width_m) * index / max(self._n - 1, 1)

    def painted(self, index: int, images: tuple[Image, ...]) -> tuple[Image, ...]:
        """The images with the strip before the back."""
        painted = []
        for place, image in zip(self._places, images, strict=True):
            right = place[..., 0] - self._left(index)
            column, row = (right * 2000).astype(int) % 1024, ((place[..., 1] + 1) * 1000).astype(int) % 2048
            grey = np.clip(110 + self._texture[row, column], 0, 255).astype(np.uint8)
            painted.append(np.where((right >= 0) & (right <= self.width_m), grey, image))
        return tuple(painted)

    def covered(self, index: int, pixels: Array) -> Mask:
        """(V, N) pixels that show the strip."""
        right = np.stack([self._place(v, pixels[v])[:, 0] for v in range(len(pixels))]) - self._left(index)
        covered: Mask = (right >= 0) & (right <= self.width_m)
        return covered
