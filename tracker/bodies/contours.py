"""Expected contours: visible occluding-contour samples of the model in every view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.arrays import Array32, Integers, Mask, Region

# A contour sample and its neighbours share one edge and one interpolation: 8 px of contour count as one
# observation, and each is used about twice, from the model to the scene and back.
PX_PER_OBSERVATION = 16.0


@dataclass(frozen=True)
class ViewContours:
    """Samples of one pose in one view."""

    pixels: Array32
    """(N, 2) image positions, px."""

    normals: Array32
    """(N, 2) unit image normals, pointing away from the part."""

    weights: Array32
    """(N,) contour length of a sample, px."""

    parts: Integers
    """(N,) scene-wide part number."""

    points: Array32
    """(N, 3) the sample on the surface, world, metres."""

    between: Mask
    """(N,) edge between touching parts: drawn, not matched (paper, section 5)."""

    def chosen(self, rows: Mask) -> ViewContours:
        """Some of the samples (N,)."""
        return ViewContours(*(getattr(self, field.name)[rows] for field in fields(self)))


@dataclass(frozen=True)
class Contours:
    """Samples for B poses and V views, padded to M samples; only the first `counts[b, v]` are valid."""

    positions: Array32
    """(B, V, M, 5) pixel x, y; unit image normal x, y, pointing away from the part; contour length of the sample, px, 0
    for samples between parts."""

    points: Array32
    """(B, V, M, 3) the sample on the surface, world, metres."""

    parts: Integers
    """(B, V, M) scene-wide part number."""

    between: Mask
    """(B, V, M) edge between touching parts: drawn, not matched (paper, section 5)."""

    counts: Integers
    """(B, V) valid samples."""

    def of(self, view: int, b: int = 0) -> ViewContours:
        """The valid samples of one view and pose."""
        n = int(self.counts[b, view])
        positions = self.positions[b, view, :n]
        return ViewContours(
            positions[:, :2],
            positions[:, 2:4],
            positions[:, 4],
            self.parts[b, view, :n],
            self.points[b, view, :n],
            self.between[b, view, :n],
        )

    def pose(self, b: int) -> Contours:
        """The samples of one pose."""
        one = slice(b, b + 1)
        return Contours(self.positions[one], self.points[one], self.parts[one], self.between[one], self.counts[one])

    def without(self, hidden: Mask) -> Contours:
        """The same with samples of length 0 if their parts (V, P) do not count in a view."""
        positions, there = self.positions.copy(), np.arange(self.parts.shape[2]) < self.counts[..., None]
        views = np.arange(len(hidden))[:, None]
        positions[there & hidden[views, np.where(there, self.parts, 0)], 4] = 0.0
        return replace(self, positions=positions)

    @cached_property
    def matched(self) -> tuple[Array32, ...]:
        """For each view pixel and normal (N, 4) of the matched samples, of all poses."""
        found = []
        for view in range(self.n_views):
            rows = [self.positions[b, view, : self.counts[b, view]] for b in range(self.n_poses)]
            found.append(np.ascontiguousarray(np.concatenate([one[one[:, 4] > 0, :4] for one in rows])))
        return tuple(found)

    @cached_property
    def boxes(self) -> tuple[Array32 | None, ...]:
        """For each view the `bounding_box` of the matched samples, of all poses."""
        return tuple(map(bounding_box, self.matched))

    @property
    def valid(self) -> Mask:
        """(B, V, M) valid samples."""
        mask: Mask = np.arange(self.parts.shape[2]) < self.counts[..., None]
        return mask

    @property
    def n_poses(self) -> int:
        """B, the number of poses."""
        return int(self.counts.shape[0])

    @property
    def n_views(self) -> int:
        """V, the number of views."""
        return int(self.counts.shape[1])


def bounding_box(samples: Array32) -> Array32 | None:
    """Least and largest x and y (2, 2) of samples (N, 2 or more), px; None without any."""
    if len(samples) == 0:
        return None
    x, y = samples[:, 0], samples[:, 1]
    return np.array([[x.min(), y.min()], [x.max(), y.max()]], dtype=np.float32)


def joined(sets: Sequence[Contours]) -> Contours:
    """The poses of several sets of the same views, one after the other, padded to the longest."""
    longest = max(int(one.counts.max(initial=1)) for one in sets)

    def padded(samples: NDArray[Any]) -> NDArray[Any]:
        missing = longest - samples.shape[2]
        if missing <= 0:
            return samples[:, :, :longest]
        return np.pad(samples, [(0, 0), (0, 0), (0, missing), *[(0, 0)] * (samples.ndim - 3)])

    names = ("positions", "points", "parts", "between")
    samples = {name: np.concatenate([padded(getattr(one, name)) for one in sets]) for name in names}
    return Contours(**samples, counts=np.concatenate([one.counts for one in sets]))


def gathered(sets: Sequence[Contours], kept: Sequence[Mask]) -> Contours:
    """Some samples of several sets of the same poses and views as one set.

    Args:
        sets: contours.
        kept: (B, V, M) for each of them, its samples to keep.
    """
    mask = np.concatenate([which & one.valid for one, which in zip(sets, kept, strict=True)], axis=2)
    counts = mask.sum(axis=2)
    order = np.argsort(~mask, axis=2, kind="stable")[:, :, : max(int(counts.max(initial=0)), 1)]

    def chosen(name: str) -> NDArray[Any]:
        samples = np.concatenate([getattr(one, name) for one in sets], axis=2)
        return np.take_along_axis(samples, order.reshape(*order.shape, *[1] * (samples.ndim - 3)), axis=2)

    names = ("positions", "points", "parts", "between")
    return Contours(**{name: chosen(name) for name in names}, counts=counts)


# Where in the images a scene is expected, from its contours.


def expected_samples(contours: Contours, view: int) -> Array32:
    """Pixel and normal (M, 4) of the matched samples, of all poses, in one view."""
    return contours.matched[view]


def expected_region(contours: Contours, view: int, size: tuple[int, int], margin_px: float) -> Region:
    """The region around the matched samples, of all poses, in one view; see `region_around`."""
    return _region(contours.boxes[view], size, margin_px)


def region_around(samples: Array32, size: tuple[int, int], margin_px: float) -> Region:
    """Bounding box of the samples with a margin, inside the image; at least 8 px wide and high."""
    return _region(bounding_box(samples), size, margin_px)


def _region(box: Array32 | None, size: tuple[int, int], margin_px: float) -> Region:
    if box is None:
        return 0, 0, *size
    left, top = np.floor(box[0] - margin_px).astype(int).tolist()
    right, bottom = np.ceil(box[1] + margin_px).astype(int).tolist()
    x, y = min(max(left, 0), size[0] - 8), min(max(top, 0), size[1] - 8)
    return x, y, min(max(right, x + 8), size[0]) - x, min(max(bottom, y + 8), size[1]) - y
