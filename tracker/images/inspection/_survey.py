"""The first frames of a recording, small: foregrounds of all views, and the tracks of their middles, tops and ends."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import cv2
import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Mask, frozen
from tracker.images.inspection._delays import Delays, delays_of, tangents
from tracker.images.operations.masks import opened
from tracker.images.plate import Plate, changed


def misses(rig: Rig, pixels: Array) -> Array:
    """Distances (V, T) of images from where the point that all views agree on most is seen, px.

    Args:
        rig: V cameras.
        pixels: (V, T, 2), NaN where a view does not show the point.

    Returns:
        NaN for such views; infinite where rays meet behind a camera.
    """
    points, _ = rig.triangulate(pixels)
    gaps = np.linalg.norm(rig.project(points) - pixels, axis=-1)
    lonely = np.isfinite(pixels[..., 0]).sum(axis=0) < 2
    told: Array = np.where(np.isfinite(pixels[..., 0]) & ~lonely, np.where(np.isfinite(gaps), gaps, np.inf), np.nan)
    return told


def usual_share(rig: Rig, gaps: Array) -> float:
    """The median of distances (V, T) as a share of the width of their images; NaN where nothing is known."""
    shares = gaps / np.array([camera.size[0] for camera in rig.cameras])[:, None]
    known = shares[~np.isnan(shares)]
    return float(np.median(known)) if len(known) else float("nan")


FACTOR = 4
"""Pixels of an image to one of a survey: a person 400 px high is 100 px high there, its middle good to a pixel."""

N_FRAMES = 100
"""Number of frames: four seconds of a usual recording, a second of decoding."""

LEAST_SHARE = 0.002
"""A smaller share of an image is noise."""

# Regions of less than this beside the largest one are no person's: shadows, cables.
_BESIDE = 0.2
# Grey levels by which neighbouring frames differ where something moves.
_MOVED = 20
# Images that the usual look of a view is taken from.
_N_KEPT = 9


@dataclass(frozen=True)
class Survey:
    """Data of T frames of V views."""

    scene: Scene
    """The persons to follow, and the rig."""

    plates: tuple[Plate | None, ...]
    """Small clean plates."""

    stride: int
    """Images between two frames."""

    pictures: tuple[Image | None, ...]
    """Small pictures: the most frequent colours of each view; None for a missing view."""

    foregrounds: tuple[tuple[Mask | None, ...], ...]
    """T x V small foregrounds; without plate or mask moving pixels; None if unknown."""

    first: int = 0
    """Number of the first frame."""

    masked: tuple[bool, ...] = ()
    """Whether the user's masks are the foregrounds of a view in all frames; empty for no view."""

    @property
    def rig(self) -> Rig:
        """The cameras of the whole images."""
        return self.scene.rig

    def stands_out(self, view: int) -> bool:
        """Whether a view has a plate, or masks: standing persons are then in its foregrounds, too."""
        return self.plates[view] is not None or (bool(self.masked) and self.masked[view])

    @cached_property
    def delays(self) -> Delays:
        """Delays of the views, by their movements."""
        regions = [[_person(mask) for mask in row] for row in self.foregrounds]
        return delays_of(tangents(self.rig, regions, FACTOR), len(self.rig))

    @cached_property
    def middles(self) -> Array:
        """(V, T, 2) middles of the foregrounds, px of the whole image; NaN where there is none."""
        return self._marks(_middle)

    @cached_property
    def cut(self) -> Mask:
        """(V, T) whether the border of the image cuts off most of a foreground: a person enters, or leaves."""
        found = np.zeros((len(self.rig), len(self.foregrounds)), dtype=np.bool_)
        for t, masks in enumerate(self.foregrounds):
            for v, mask in enumerate(masks):
                found[v, t] = mask is not None and mask.any() and _cut_off(_counted(mask)[0])
        return found

    @cached_property
    def tops(self) -> Array:
        """(V, T, 2) upper ends of the foregrounds; NaN where there is none or the border cuts it."""
        return self._marks(_top)

    @cached_property
    def ends(self) -> Array:
        """(V, T, 2) lower ends of the foregrounds; NaN where there is none or the border cuts it."""
        return self._marks(_end)

    def _marks(self, mark: Callable[[Mask], Array]) -> Array:
        marks = np.full((len(self.rig), len(self.foregrounds), 2), np.nan)
        for t, masks in enumerate(self.foregrounds):
            for v, mask in enumerate(masks):
                if mask is not None and np.count_nonzero(mask) > LEAST_SHARE * mask.size:
                    marks[v, t] = mark(mask)
        return frozen(FACTOR * marks + (FACTOR - 1) / 2)


def survey(
    frames: Iterable[Frame],
    scene: Scene,
    plates: tuple[Plate | None, ...],
    stride: int = 1,
    n_frames: int = N_FRAMES,
) -> Survey:
    """Examines the first frames.

    Args:
        frames: of the recording, from the first one on.
        scene: persons and rig.
        plates: the clean plates of the views.
        stride: images between two frames.
        n_frames: number of frames.
    """
    backgrounds = small_plates(plates)
    before: list[Image | None] = [None] * len(plates)
    masks, kept, brought, first = [], [], [], 0
    for t, frame in enumerate(islice(frames, n_frames)):
        first = frame.index if t == 0 else first
        images = [None if image is None else small(image) for image in frame.images]
        masks.append(tuple(_foreground(frame, v, images[v], backgrounds[v], before[v]) for v in range(len(plates))))
        brought.append([None if image is None else frame.mask(v) is not None for v, image in enumerate(images)])
        if t % (N_FRAMES // _N_KEPT) == 0 and t < N_FRAMES:
            kept.append(images)
        before = images
    pictures = tuple(_usual([images[v] for images in kept]) for v in range(len(plates)))
    masked = tuple(True in row and False not in row for row in zip(*brought, strict=True))
    return Survey(scene, backgrounds, stride, pictures, tuple(masks), first, masked)


def small(image: Image) -> Image:
    """An image as small as it is looked at."""
    size = image.shape[1] // FACTOR, image.shape[0] // FACTOR
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def small_plates(plates: tuple[Plate | None, ...]) -> tuple[Plate | None, ...]:
    """Plates as small as images are looked at."""
    return tuple(None if plate is None else _small_plate(plate) for plate in plates)


def _small_plate(plate: Plate) -> Plate:
    unknown = None if plate.unknown is None else small(plate.unknown.astype(np.float32)) > 0
    return Plate(small(plate.picture), unknown)


def _foreground(frame: Frame, v: int, image: Image | None, plate: Plate | None, before: Image | None) -> Mask | None:
    given = frame.mask(v)
    if given is not None:
        return small(given.astype(np.uint8)) > 0
    if image is None or (plate is None and before is None):
        return None
    if plate is not None:
        return changed(image, plate).foreground
    assert before is not None
    return opened(cv2.absdiff(image, before).max(axis=2) > _MOVED)


def _person(mask: Mask | None) -> Mask | None:
    """What counts of a foreground; None where it is noise, or not known."""
    return None if mask is None or np.count_nonzero(mask) <= LEAST_SHARE * mask.size else _counted(mask)[0]


def _usual(images: list[Image | None]) -> Image | None:
    there = [image for image in images if image is not None]
    return None if not there else np.median(np.stack(there), axis=0).astype(np.uint8)


def is_cut(region: Mask) -> bool:
    """Whether the border of the image cuts a region (H, W)."""
    return _n_cut(region) > 0


def _cut_off(region: Mask) -> bool:
    """Whether the border cuts more than feet from a region: along more of it than a square of its area is wide."""
    return bool(_n_cut(region) > np.sqrt(np.count_nonzero(region)))


def _n_cut(region: Mask) -> int:
    """Pixels of a region (H, W) at the border of the image."""
    return sum(map(np.count_nonzero, (region[0], region[-1], region[:, 0], region[:, -1])))


def _middle(mask: Mask) -> Array:
    return _counted(mask)[1]


def _counted(mask: Mask) -> tuple[Mask, Array]:
    """A mask without regions that are small beside its largest one, as shadows, cables, screens; and its middle."""
    _, labels, stats, middles = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    counted = areas >= _BESIDE * areas.max()
    middle: Array = np.average(middles[1:][counted], axis=0, weights=areas[counted])
    return np.append(False, counted)[labels], middle


def _top(mask: Mask) -> Array:
    return _outermost(mask, np.nonzero(mask)[0].min())


def _end(mask: Mask) -> Array:
    return _outermost(mask, np.nonzero(mask)[0].max())


def _outermost(mask: Mask, row: int) -> Array:
    """The middle of an outermost row of a mask; NaN at the border of the image."""
    if row in (0, len(mask) - 1):
        return np.full(2, np.nan)
    return np.array([np.flatnonzero(mask[row]).mean(), float(row)])


# Of grey images, as their codec has rounded them, 4; of rooms in colour 14 to 151, of most 80 and more.
_GREY, _COLOUR = 8.0, 25.0


def other_colours(seen: Survey) -> str:
    """Refuses grey images with coloured plates, or the other way round: everything differs then, or nothing."""
    views = zip(seen.rig.names, seen.plates, seen.pictures, strict=True)
    shown = [(name, plate.picture, image) for name, plate, image in views if plate is not None and image is not None]
    grey = [name for name, plate, image in shown if _is_grey(image) and _is_coloured(plate)]
    coloured = [name for name, plate, image in shown if _is_grey(plate) and _is_coloured(image)]
    if not grey and not coloured:
        return ""
    kinds = "in colour, the images of the recording grey" if grey else "grey, the images of the recording in colour"
    return (
        f"the plates of {', '.join(grey or coloured)} are {kinds}: take plates with the cameras set as they recorded, "
        "or leave `background` out"
    )


def _is_grey(picture: Image) -> bool:
    return _most_colour(picture) < _GREY


def _is_coloured(picture: Image) -> bool:
    return _most_colour(picture) > _COLOUR


def _most_colour(picture: Image) -> float:
    """By how much the channels differ in the most colourful hundredth of a picture, grey levels."""
    return float(np.percentile(np.ptp(picture, axis=2), 99))
