"""The followed points and all that is known of them: the state that a following carries from frame to frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.points.following.keys import Keys
from tracker.points.trajectories import PointFrame, PointStatus


@dataclass
class Points:
    """N points. Mutable: it is the one thing that changes while points are followed.

    All arrays are about the latest frame unless they are called after birth.
    """

    ids: Integers
    """(N,)"""

    status: Integers
    """(N,) see `PointStatus`."""

    pixels: Array
    """(V, N, 2) px, NaN where not seen."""

    before: Array
    """(V, N, 2) px in the frame before, NaN where not seen."""

    last_pixels: Array
    """(V, N, 2) px where they were seen last."""

    affine: Array
    """(V, N, 2, 2) from the key's image; the latest known one."""

    variances: Array
    """(V, N, 3) xx, yy, xy px^2 of the match with the key."""

    drift: Array
    """(V, N, 3) xx, yy, xy px^2 that the key's place is uncertain by, in its own image."""

    positions: Array
    """(N, 3) metres; the latest known ones."""

    birth_pixels: Array
    """(V, N, 2) px; NaN where a view did not show the point."""

    key_from_birth: Array
    """(V, N, 2, 2) from the image of the birth to the key's."""

    across: Array
    """(V, N, 2, 2) from the template's image to each view, at birth."""

    birth_drift: Array
    """(V, N, 3) the drift of the keys cut at birth."""

    neighbours: Integers
    """(N, K) ids of points near at birth; -1 for none."""

    neighbour_pixels: Array
    """(V, N, K, 2) px that these had then."""

    since: Integers
    """(N,) frames since the point was seen last."""

    born: Integers
    """(N,) frame numbers of the births."""

    keys_in: Integers
    """(V, N) frame numbers of the images that the key patches were cut from."""

    bending: Array
    """(V, N, 2) px from the point to the mean of a patch of its birth, see `bending_shifts`; NaN where neighbours
    cannot tell."""

    key_bending: Array
    """(V, N, 2) px: the same in the key's image, in which the key lies around the point itself."""

    keys: tuple[Keys, ...]
    birth_keys: tuple[Keys, ...]
    next_id: int

    latest: int
    """Number of the frame; those without enough images are passed over."""

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def n_views(self) -> int:
        """Number of views."""
        return len(self.pixels)

    @property
    def alive(self) -> Mask:
        """(N,) points that were seen in the latest frame."""
        alive: Mask = self.status != PointStatus.HIDDEN
        return alive

    @property
    def needed(self) -> Integers:
        """(N,) views that showed each point at birth; one for those that none has a patch of."""
        count: Integers = np.maximum(np.isfinite(self.birth_pixels[..., 0]).sum(axis=0), 1)
        return count

    @property
    def total_variances(self) -> Array:
        """(V, N, 3) px^2 of the pixels against the material point of the birth: match and drift."""
        return carried(self.drift, self.affine) + self.variances

    def rows_of(self, ids: Integers) -> Integers:
        """Rows of ids of any shape; -1 for unknown ones."""
        if not len(self.ids):
            return np.full(ids.shape, -1)
        place = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        rows: Integers = np.where(self.ids[place] == ids, place, -1)
        return rows

    def frame(self, index: int, time_s: float, covariances: Array) -> PointFrame:
        """What is known in this frame, as a value of its own."""
        drift = np.sqrt(np.nan_to_num(carried(self.drift, self.affine)[..., :2]).max(axis=(0, 2), initial=0.0))
        alive = self.alive
        positions = np.where(alive[:, None], self.positions, np.nan)
        covariances = np.where(alive[:, None, None], covariances, np.nan)
        sigmas = np.where(np.isfinite(self.pixels), np.sqrt(self.total_variances[..., :2]), np.nan)
        known = self.ids.copy(), self.pixels.copy(), sigmas
        origin = self.status.copy(), self.born.copy(), self.keys_in.copy()
        return PointFrame(index, time_s, *known, positions, covariances, drift, *origin)

    def unseen(self, index: int, time_s: float) -> PointFrame:
        """A frame that shows none of them."""
        n, hidden = len(self), np.full(len(self), int(PointStatus.HIDDEN))
        pixels, places = np.full((self.n_views, n, 2), np.nan), np.full((n, 3), np.nan)
        nothing = pixels, pixels.copy(), places, np.full((n, 3, 3), np.nan), np.full(n, np.nan)
        origin = hidden, self.born.copy(), self.keys_in.copy()
        return PointFrame(index, time_s, self.ids.copy(), *nothing, *origin)

    def select(self, kept: Mask) -> Points:
        """The chosen ones alone."""
        chosen = {name: getattr(self, name)[kept] for name in _FIRST_AXIS}
        chosen |= {name: getattr(self, name)[:, kept] for name in _SECOND_AXIS}
        keys = tuple(k.select(kept) for k in self.keys), tuple(k.select(kept) for k in self.birth_keys)
        return Points(**chosen, keys=keys[0], birth_keys=keys[1], next_id=self.next_id, latest=self.latest)

    def joined(self, more: Points) -> Points:
        """Both, the newer ones last."""
        chosen = {name: np.concatenate([getattr(self, name), getattr(more, name)]) for name in _FIRST_AXIS}
        chosen |= {name: np.concatenate([getattr(self, name), getattr(more, name)], axis=1) for name in _SECOND_AXIS}
        keys = tuple(a.joined(b) for a, b in zip(self.keys, more.keys, strict=True))
        births = tuple(a.joined(b) for a, b in zip(self.birth_keys, more.birth_keys, strict=True))
        return Points(**chosen, keys=keys, birth_keys=births, next_id=more.next_id, latest=self.latest)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it under flat names, to be saved; see `restored`."""
        saved: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in (*_FIRST_AXIS, *_SECOND_AXIS)}
        for kind, all_keys in (("keys", self.keys), ("birth_keys", self.birth_keys)):
            for v, keys in enumerate(all_keys):
                saved |= {f"{kind}_{v}_{field.name}": getattr(keys, field.name) for field in fields(Keys)}
        return saved | {"next_id": np.array(self.next_id), "latest": np.array(self.latest)}


_FIRST_AXIS = ("ids", "status", "positions", "neighbours", "since", "born")
_SECOND_AXIS = (
    *("pixels", "before", "last_pixels", "affine", "variances", "drift", "birth_pixels", "key_from_birth"),
    *("across", "birth_drift", "neighbour_pixels", "keys_in", "bending", "key_bending"),
)


def restored(saved: Mapping[str, NDArray[Any]]) -> Points:
    """Points from their `arrays`."""
    chosen: dict[str, Any] = {name: saved[name] for name in (*_FIRST_AXIS, *_SECOND_AXIS)}

    def keys(kind: str) -> tuple[Keys, ...]:
        n_views = len(saved["pixels"])
        return tuple(Keys(*(saved[f"{kind}_{v}_{field.name}"] for field in fields(Keys))) for v in range(n_views))

    chosen |= {"next_id": int(saved["next_id"]), "latest": int(saved["latest"])}
    return Points(**chosen, keys=keys("keys"), birth_keys=keys("birth_keys"))


def carried(variances: Array, affine: Array) -> Array:
    """Covariances xx, yy, xy (..., 3) under affine transformations (..., 2, 2)."""
    xx, yy, xy = np.moveaxis(variances, -1, 0)
    a, b, c, d = affine[..., 0, 0], affine[..., 0, 1], affine[..., 1, 0], affine[..., 1, 1]
    return np.stack(
        [
            a * a * xx + 2 * a * b * xy + b * b * yy,
            c * c * xx + 2 * c * d * xy + d * d * yy,
            a * c * xx + (a * d + b * c) * xy + b * d * yy,
        ],
        axis=-1,
    )
