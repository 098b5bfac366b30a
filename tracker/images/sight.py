"""One frame's images beside the views without persons, with all results found in them so far."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Array32, Integers, Mask, Region, frozen
from tracker.images.plate import MOST_LEVEL, Lit, Plate, changed, lit_by, sparse_changes

HIDDEN = -1e6
"""Value in a chamfer image: the place is hidden. So far below any distance that interpolating it leaves it negative."""


@dataclass(frozen=True)
class ViewObservation:
    """Findings of one view; positions are in pixels of the whole image."""

    edges: Array32
    """(N, 2) edge points, px; of segments that may be accepted."""

    directions: Array32
    """(N, 2) unit image gradient at the edge points: across the edge, towards the brighter side."""

    segments: Integers
    """(N,) constant-curvature segment of each edge point."""

    accepted: Mask
    """(N,) whether the point's segment was accepted into the filtered scene edge map; single points of an accepted
    segment that the background explains are left out."""

    scene: Integers
    """(S,) indices of the edge points that represent the accepted contours, evenly thinned."""

    scene_weights: Array32
    """(S,) contour length of each of them, px; less for less important edges."""

    origin: tuple[int, int]
    """Pixel (x, y) of the chamfer image's upper left corner."""

    distance: Array32
    """(h, w) chamfer image: distance to the nearest accepted edge point, px; clamped at its reach. `HIDDEN` where
    something is before the persons."""

    reach: float
    """Value of the chamfer image outside its region, px."""

    silhouette: Mask | None = None
    """(H, W) the region whose outline the edges are, if there is one."""

    def hidden_by(self, occluder: Mask) -> ViewObservation:
        """(H, W) things before the persons: contours there count for nothing."""
        (x, y), (height, width) = self.origin, self.distance.shape
        part = occluder[y : y + height, x : x + width]
        return replace(self, distance=frozen(np.where(part, np.float32(HIDDEN), self.distance), np.float32))


class PackedEdges(NamedTuple):
    """All views end to end, for compiled kernels."""

    images: Array32
    """Chamfer images, px."""

    regions: Integers
    """(V, 5) the place of each in `images`; `tracker.kernels.rows.RegionRow` names the columns."""

    points: Array32
    """(S, 5) scene points, each view's sorted by y; `tracker.kernels.rows.ScenePointRow` names the columns."""

    first: Integers
    """(V + 1,) first point of each view."""

    reach: Array32
    """(V,) reach of the chamfer images, px."""


@dataclass(frozen=True)
class Observation:
    """Findings of all V views; None for a view that is missing in this frame."""

    views: tuple[ViewObservation | None, ...]

    @cached_property
    def packed(self) -> PackedEdges:
        """The observation as flat arrays for compiled kernels."""
        images, layout, points, first, reach = [], [], [], [0], []
        start = 0
        for view in self.views:
            if view is None:
                layout.append((start, 0, 0, 0, 0))
                first.append(first[-1])
                reach.append(0.0)
                continue
            height, width = view.distance.shape
            images.append(view.distance.ravel())
            layout.append((start, *view.origin, width, height))
            start += width * height
            columns = view.edges[view.scene], view.directions[view.scene], view.scene_weights[:, None]
            rows = np.concatenate(columns, axis=1)
            points.append(rows[np.argsort(rows[:, 1], kind="stable")])
            first.append(first[-1] + len(rows))
            reach.append(view.reach)
        empty = np.zeros(0, dtype=np.float32)
        flat = np.concatenate([empty, *images])  # its own already: megabytes, not to be copied once more
        flat.setflags(write=False)
        scene = np.concatenate(points) if points else empty.reshape(0, 5)
        return PackedEdges(
            flat,
            frozen(layout, np.int64),
            frozen(scene, np.float32),
            frozen(first, np.int64),
            frozen(reach, np.float32),
        )

    @cached_property
    def packed_segments(self) -> Integers:
        """(S,) the segment of each row of `packed.points`; of other views they have other numbers."""
        segments, start = [np.zeros(0, dtype=np.int64)], 0
        for view in self.views:
            if view is not None and len(view.scene):
                order = np.argsort(view.edges[view.scene][:, 1], kind="stable")
                numbers = view.segments[view.scene][order]
                segments.append(numbers + start)
                start += int(numbers.max()) + 1
        found: Integers = frozen(np.concatenate(segments), np.int64)
        return found


_Found = TypeVar("_Found")
_Part = TypeVar("_Part")


# Foregrounds of 0.6 to 1.6 times the model's pixels were of use on ten recordings of persons scaled by their stature.
_LEAST_SHARE, _MOST_SHARE = 0.6, 1.6
# A model that covers less of a view than this is hardly in it.
_LEAST_MODEL = 0.002


LEAST_COVERED = 0.75
"""Least share of the models' silhouettes on changed or unknown pixels with plates that show no persons, see
`Sight.covered`: 0.89 to 1 in every view of 14 right starts on recordings. Of a woman who sits while another person
passes by 0.47, of a man of whom only the arms move 0.71 at most."""


@dataclass(frozen=True)
class Changes:
    """Differences from the clean plate of a view; false outside the examined region."""

    moving: Mask
    """(H, W) all changed pixels, shadows included."""

    silhouette: Mask
    """(H, W) the moving foreground."""

    fault: str = ""
    """Why it is not to be used; empty if it is."""

    in_its_light: bool = True
    """Whether the plate shows the view without persons; otherwise everything differs from it."""


class Sight:
    """The images of one frame with the clean plates. Every result in a region of a view is computed once.

    Several kinds of evidence share it, and a thread may prepare it during the estimation of the frame before.
    """

    def __init__(self, frame: Frame, plates: tuple[Plate | None, ...] = (), model_px: Array | None = None) -> None:
        """The images, and their comparison.

        Args:
            frame: the images.
            plates: a clean plate for each view that has one; none for no plates at all.
            model_px: (V,) pixels that the persons covered shortly before: a foreground of another size is not theirs.
                None if unknown.
        """
        self.frame = frame.unpacked()
        self.held = frame  # steps keep this one: a window of them has thousands of images
        self.plates = plates or (None,) * len(frame.images)
        self._model_px = model_px
        self.strangers = False  # whether somebody who is none of the persons is hidden, see `hide`
        self._lit: dict[int, Lit] = {}
        self._found: dict[tuple[Hashable, int], tuple[Region, Any]] = {}
        self._joined: dict[Hashable, tuple[Sequence[Any], Any]] = {}

    def model_px(self, view: int) -> float | None:
        """Pixels of a view that the persons covered shortly before; None if unknown."""
        return None if self._model_px is None else float(self._model_px[view])

    def hide(self, strangers: Mapping[int, Mask]) -> None:
        """From now on a stranger is before the persons; earlier results are forgotten.

        Args:
            strangers: view with a plate -> pixels (H, W).
        """
        self.strangers = True
        self.plates = tuple(
            plate if plate is None or v not in strangers else plate.hidden_by(strangers[v])
            for v, plate in enumerate(self.plates)
        )
        self._found.clear()
        self._joined.clear()

    def once(self, key: Hashable, view: int, region: Region, find: Callable[[Region], _Found]) -> _Found:
        """Earlier result in a region of a view, or in a larger one; otherwise computed now.

        Args:
            key: kind of result and its settings: equal keys have equal results.
            view: number of the view.
            region: x, y, width, height, px.
            find: computes it in the region.
        """
        kept = self._found.get((key, view))
        if kept is not None and _covers(kept[0], region):
            found: _Found = kept[1]
            return found
        found = find(region)
        self._found[key, view] = region, found
        return found

    def joined(self, key: Hashable, views: Sequence[_Part], join: Callable[[Sequence[_Part]], _Found]) -> _Found:
        """Earlier result made from those of all views; made anew if one of them changed.

        Args:
            key: kind of result and its settings: equal keys have equal results.
            views: for each view the result of `once`.
            join: makes it.
        """
        kept = self._joined.get(key)
        if kept is None or any(one is not other for one, other in zip(kept[0], views, strict=True)):
            kept = self._joined[key] = views, join(views)
        made: _Found = kept[1]
        return made

    def has(self, key: Hashable, view: int, region: Region) -> bool:
        """Whether there is a result in a region of a view already."""
        kept = self._found.get((key, view))
        return kept is not None and _covers(kept[0], region)

    def changes(self, view: int, region: Region) -> Changes | None:
        """Differences from the plate in a region, or the user's mask there; None if unknown.

        It is unknown if image or plate is missing, or the foreground is not reliable. A mask always counts.
        """
        image, plate = self.frame.images[view], self.plates[view]
        mask = self.frame.mask(view)
        if mask is not None:
            return self.once(Changes, view, region, lambda where: _given(mask, where))
        if image is None or plate is None:
            return None

        def find(where: Region) -> Changes:
            found = changed(image, plate, where, self.lit(view))
            sure_px = int(np.count_nonzero(found.foreground))
            most_px = sure_px if plate.unknown is None else sure_px + int(np.count_nonzero(plate.unknown))
            fault = _fault(found.level, (sure_px, most_px), self.model_px(view), image.shape)
            return Changes(found.moving, found.foreground, fault, found.level <= MOST_LEVEL)

        found = self.once(Changes, view, region, find)
        return None if found.fault else found

    def lit(self, view: int) -> Lit | None:
        """Comparison of a view's image with its plate; None if one is missing."""
        image, plate = self.frame.images[view], self.plates[view]
        if image is None or plate is None:
            return None
        if view not in self._lit:
            self._lit[view] = lit_by(image, plate)
        return self._lit[view]

    def sparse_changes(self, view: int) -> Mask | None:
        """Every fourth pixel (h / 4, w / 4) of a view that differs from the plate; None if unknown."""
        lit = self.lit(view)
        return None if lit is None else sparse_changes(lit)

    def covered(self, models: Sequence[Mask]) -> float:
        """Share of models' silhouettes (H, W) on changed or unknown pixels, mean of the views."""
        shares = []
        for v, model in enumerate(models):
            changes = self.changes(v, (0, 0, model.shape[1], model.shape[0]))
            if changes is not None and model.any():
                shares.append(_share_of(model, changes.moving))
        return float(np.mean(shares)) if shares else 0.0

    def changed_behind(self, view: int, model: Mask) -> float | None:
        """Share of a model's silhouette (H, W) on changed, unknown or hidden pixels.

        None if unknown: nothing was compared with a plate, or everything differs from it, or a person stays before it,
        or the silhouette is empty.
        """
        kept, plate = self._found.get((Changes, view)), self.plates[view]
        if kept is None or not kept[1].in_its_light or (plate is not None and plate.stays) or not model.any():
            return None
        moving, occluder = kept[1].moving, self.occluder(view)
        return _share_of(model, moving if occluder is None else moving | occluder)

    def unknown(self, view: int) -> Mask | None:
        """Pixels (H, W) unknown to the plate of a view; None for none."""
        plate = self.plates[view]
        return None if plate is None or self.frame.mask(view) is not None else plate.unknown

    def occluder(self, view: int) -> Mask | None:
        """Pixels (H, W) of things before the persons in a view; None for none."""
        plate = self.plates[view]
        return None if plate is None else plate.occluder

    def silhouette(self, view: int) -> Mask | None:
        """The moving foreground (H, W) as far as it was computed; None if it was not, or is not reliable."""
        kept = self._found.get((Changes, view))
        return None if kept is None or kept[1].fault else kept[1].silhouette

    @property
    def untrusted(self) -> dict[int, str]:
        """View -> why its foreground was not used."""
        found = {view: kept[1].fault for (key, view), kept in self._found.items() if key is Changes}
        return {view: fault for view, fault in sorted(found.items()) if fault}


def _share_of(model: Mask, shown: Mask) -> float:
    return float(np.count_nonzero(model & shown) / np.count_nonzero(model))


def _given(mask: Mask, region: Region) -> Changes:
    """A mask (H, W) in a region."""
    inside = np.zeros(mask.shape, dtype=np.bool_)
    x, y, width, height = region
    inside[y : y + height, x : x + width] = mask[y : y + height, x : x + width]
    return Changes(inside, inside)


def _fault(level: float, n_px: tuple[int, int], model_px: float | None, shape: tuple[int, ...]) -> str:
    """Why a foreground with a number of pixels, at least and at most, is not to be used; empty if it is."""
    if level > MOST_LEVEL:
        return f"everything differs from the plate, by {level:.0f} grey levels: other light, or the camera was moved"
    if model_px is None or model_px < _LEAST_MODEL * shape[0] * shape[1]:
        return ""
    least, most = (pixels / model_px for pixels in n_px)
    if most < _LEAST_SHARE or least > _MOST_SHARE:
        return f"the foreground has {least:.1f} times the pixels of the model"
    return ""


def _covers(region: Region, other: Region) -> bool:
    """Whether a region contains another one."""
    x, y, width, height = other
    return (
        region[0] <= x and region[1] <= y and x + width <= region[0] + region[2] and y + height <= region[1] + region[3]
    )
