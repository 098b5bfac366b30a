"""A clean plate: a view without persons, and its comparison with an image in the image's light."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Image, Mask, Region, frozen
from tracker.images.operations.appearance import SAMPLING, Light, light_of, sparse
from tracker.kernels.changes import MARGIN, ShadowRule, large_regions, mark_changes, median_level, without_shadows

# px: features of larger pictures are noise, and cost time.
_FEATURES_WIDTH = 960
# Stricter than the 0.8 of Lowe 2004, section 7.1: one wrong plate is worse than one refused.
_RATIO = 0.75
# Of the small picture: a choice.
_OFF_PX = 2.0
LEAST_INLIERS = 40
"""Least number of common features of a plate and an image of one view."""

# Every ninth pixel is enough for 24 levels of grey.
_THIN, _LEVELS = 3, 24


def aligned(plate: Image, image: Image) -> tuple[Image, int]:
    """The plate as the image's camera sees it, in the image's light.

    A camera that only turned or zoomed maps one picture to the other by a homography, whatever the scene. It is found
    from features (Lowe, IJCV 2004) of which most agree (MAGSAC, Barath et al., CVPR 2020), so that moved things do not
    matter. Each channel then gets the image's brightness, by a curve of its own.

    Args:
        plate: (h', w', 3) BGR, of any size.
        image: (h, w, 3) BGR.

    Returns:
        (h, w, 3) the plate, with the image itself beyond its border; and the number of features that agree. Below
        `LEAST_INLIERS` it is not reliable.
    """
    points, others = _matches(plate, image)
    if len(points) < LEAST_INLIERS:
        return image.copy(), len(points)
    homography, agree = cv2.findHomography(points, others, cv2.USAC_MAGSAC, _OFF_PX, maxIters=5000)
    n_agree = 0 if homography is None else int(agree.sum())
    if n_agree < LEAST_INLIERS:
        return image.copy(), n_agree
    size = image.shape[1], image.shape[0]
    warped = cv2.warpPerspective(plate, homography, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    inner = np.full(plate.shape[:2], 255, dtype=np.uint8)
    covered = cv2.warpPerspective(cv2.erode(inner, np.ones((5, 5)), borderValue=0), homography, size) > 250
    lit = _in_light_of(warped, image, covered)
    fitted: Image = np.where(covered[..., None], lit, image)
    return fitted, n_agree


def _matches(plate: Image, image: Image) -> tuple[Array, Array]:
    """Positions (N, 2) of equal features, px in each picture."""
    found = []
    for picture in (plate, image):
        scale = min(1.0, _FEATURES_WIDTH / max(picture.shape[:2]))
        small = cv2.resize(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), None, fx=scale, fy=scale)
        marks, looks = cv2.SIFT.create(6000).detectAndCompute(small, None)
        # pixel centres are integers: the picture begins at -0.5
        places = (np.array([mark.pt for mark in marks]).reshape(-1, 2) + 0.5) / scale - 0.5
        found.append((places, looks))
    (places, looks), (others, their_looks) = found
    if looks is None or their_looks is None or len(their_looks) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    pairs = [
        pair[0]
        for pair in cv2.BFMatcher().knnMatch(looks, their_looks, k=2)
        if len(pair) == 2 and pair[0].distance < _RATIO * pair[1].distance
    ]
    return places[[pair.queryIdx for pair in pairs]], others[[pair.trainIdx for pair in pairs]]


def _in_light_of(plate: Image, image: Image, covered: Array) -> Image:
    """The plate with the grey levels of each channel mapped to the image's usual ones."""
    lit = np.empty_like(plate)
    thin = (slice(None, None, _THIN),) * 2
    for c in range(3):
        old, new = plate[..., c][thin][covered[thin]], image[..., c][thin][covered[thin]]
        edges = np.unique(np.quantile(old, np.linspace(0, 1, _LEVELS + 1))) if len(old) else np.zeros(0)
        if len(edges) < 3:
            lit[..., c] = plate[..., c]
            continue
        bins = np.clip(np.searchsorted(edges, old, side="right") - 1, 0, len(edges) - 2)
        used = np.unique(bins)
        levels = [float(np.median(old[bins == b])) for b in used]
        shown = np.maximum.accumulate([float(np.median(new[bins == b])) for b in used])
        lit[..., c] = np.round(np.interp(np.arange(256), levels, shown)).astype(np.uint8)[plate[..., c]]
    return lit


MOST_LEVEL = 80.0
"""Threshold (6 sigmas of the noise, grey levels) above which a plate is useless. Noise and a soft lens before a wall
full of sharp lines make it 44; in changing light without correction it rose to 145 and hid 1415 of a view's 1542
edges: their geometric mean."""


@dataclass(frozen=True, eq=False)
class Plate:
    """A view without persons; derived pictures for the frames are made once."""

    picture: Image
    """(h, w, 3) BGR, read-only."""

    unknown: Mask | None = None
    """(h, w) pixels where the picture may show a person: neither foreground nor background there is sure. None for
    none."""

    occluder: Mask | None = None
    """(h, w) pixels of a thing before the persons: it hides them, so nothing is known there either. None for none."""

    recorded: bool = False
    """Whether it was made from a recording with persons."""

    stays: bool = False
    """Whether a person stays before it, so that it is unknown behind: it only shows the background of moving limbs."""

    def __post_init__(self) -> None:
        if self.picture.flags.writeable or self.picture.base is not None:
            object.__setattr__(self, "picture", frozen(self.picture, np.uint8))
        if self.occluder is not None:
            object.__setattr__(self, "occluder", frozen(self.occluder, np.bool_))
            unknown = self.occluder if self.unknown is None else self.unknown | self.occluder
            object.__setattr__(self, "unknown", unknown)
        if self.unknown is not None:
            object.__setattr__(self, "unknown", frozen(self.unknown, np.bool_) if self.unknown.any() else None)

    def hidden_by(self, occluder: Mask) -> Plate:
        """The same with more pixels (h, w) before the persons."""
        hidden = replace(self, occluder=occluder if self.occluder is None else self.occluder | occluder)
        hidden.__dict__.update(
            {name: self.__dict__[name] for name in ("fine", "coarse", "sparse") if name in self.__dict__}
        )
        return hidden

    @cached_property
    def fine(self) -> Image:
        """(h, w, 3) as lightly smoothed as the image that is compared with it."""
        smooth: Image = cv2.GaussianBlur(self.picture, (3, 3), 0)
        return smooth

    @cached_property
    def coarse(self) -> Image:
        """(h + 2 m, w + 2 m, 3) as smooth as the image whose light is compared with it, mirrored at the border.

        m is `MARGIN`.
        """
        whole = 0, 0, self.picture.shape[1], self.picture.shape[0]
        return cut(cv2.GaussianBlur(self.picture, (5, 5), 0), whole, MARGIN)

    @cached_property
    def sparse(self) -> Image:
        """(h / 4, w / 4, 3) every fourth pixel: enough to find light and noise."""
        return sparse(self.picture)


def in_light_of(image: Image, plate: Plate) -> Image:
    """The plate's picture (h, w, 3) in the light of an image."""
    light = light_of(sparse(image), plate.sparse)
    return plate.picture if light is None else light.on(plate.picture)


def threshold_level(image: Image, plate: Plate, sigmas: float = 6.0, least: float = 14.0) -> float:
    """Threshold of a difference image from its own noise, grey levels; see `lit_by`."""
    return lit_by(image, plate, sigmas, least).level


class Lit(NamedTuple):
    """Comparison of an image with its plate."""

    light: Light | None
    """Light of the image against that of the plate; None for very small pictures."""

    level: float
    """Threshold of their difference from the noise of the whole image, grey levels."""

    differences: Image
    """(h / 4, w / 4) their largest channel difference in every fourth pixel, grey levels."""


def lit_by(image: Image, plate: Plate, sigmas: float = 6.0, least: float = 14.0) -> Lit:
    """The light of an image (h, w, 3) against its plate's, and the threshold of their difference.

    The median of the differences to the plate in the image's light is the noise of the background, which covers most of
    the image; a sixteenth of the pixels is enough.
    """
    now = sparse(image)
    light = light_of(now, plate.sparse)
    expected = plate.sparse if light is None else light.on(plate.sparse, spacing=SAMPLING)
    differences = largest_difference(now, expected)
    return Lit(light, max(least, sigmas * median_level(differences) / 0.954), differences)


def largest_difference(image: Image, other: Image) -> Image:
    """(h, w) the largest channel difference of two pictures (h, w, 3), grey levels."""
    blue, green, red = cv2.split(cv2.absdiff(image, other))
    largest: Image = cv2.max(cv2.max(blue, green), red)
    return largest


def cut(picture: Image, region: Region, margin: int) -> Image:
    """A region with a margin, mirrored at the border of the picture."""
    x, y, width, height = region
    left, top = max(x - margin, 0), max(y - margin, 0)
    right, bottom = min(x + width + margin, picture.shape[1]), min(y + height + margin, picture.shape[0])
    part = picture[top:bottom, left:right]
    lacking = top - y + margin, y + height + margin - bottom, left - x + margin, x + width + margin - right
    return cv2.copyMakeBorder(part, *lacking, cv2.BORDER_REFLECT_101) if any(lacking) else part


# Differences of an image from a clean plate: all of them, and without shadows and specks the moving foreground.

# A shadow keeps the colour to 8 grey levels and loses up to 55 % of the light. Grey trousers before a grey floor keep
# the colour too: where the texture does not show (correlation 0.7), only a loss of up to 20 % is always a shadow, and a
# region that loses more is one if its outline is wider than 8 px. An object's is as wide as the camera and the
# smoothing make it, 4 px; with 6 to 12 px the results on four rendered recordings are the same, and the precision in
# the demonstration, whose floor is smooth, rises from 0.84 to 0.96 at the same recall.
_SHADOW: ShadowRule = (0.45, 0.8, 0.97, 8.0, 0.7, 8.0)

# Opening with the square removes single pixels, closing with the disc fills holes of 6 px.
_SQUARE = np.ones((3, 3), np.uint8)
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
# Opening with the square and closing with the disc carry a pixel this far at most.
_CARRIED = 8
_LEAST_SHARE = 0.02


def difference(image: Image, plate: Plate) -> Image:
    """Largest channel difference (h, w) uint8 of an image (h, w, 3) to a plate in its light, lightly smoothed."""
    light = light_of(sparse(image), plate.sparse)
    expected = plate.fine if light is None else light.on(plate.fine)
    return largest_difference(cv2.GaussianBlur(image, (3, 3), 0), expected)


def departing(image: Image, plate: Plate, sigmas: float) -> Mask | None:
    """Pixels (h, w) that differ from the plate, shadows included; None if everything does: see `MOST_LEVEL`."""
    level = threshold_level(image, plate, sigmas)
    return None if level > MOST_LEVEL * sigmas / 6.0 else difference(image, plate) > level


def sparse_changes(lit: Lit) -> Mask | None:
    """Every fourth pixel (h / 4, w / 4) that differs from the plate, shadows included; None if everything does."""
    if lit.level > MOST_LEVEL:
        return None
    opened: Mask = cv2.morphologyEx((lit.differences > lit.level).view(np.uint8), cv2.MORPH_OPEN, _SQUARE) > 0
    return opened


class Changed(NamedTuple):
    """Differences from a plate; false outside the examined region."""

    moving: Mask
    """(h, w) all changed pixels, shadows included, and those unknown to the plate."""

    foreground: Mask
    """(h, w) surely changed pixels without shadows, cleaned of specks and small holes."""

    level: float
    """Threshold from the noise of the whole image, grey levels."""


def changed(image: Image, plate: Plate, region: Region | None = None, lit: Lit | None = None) -> Changed:
    """Pixels (h, w) that differ from the plate, and those of them that are not its shadow: the moving foreground.

    The plate is compared in the light of the image, where it differs slowly over the picture.

    Args:
        image: BGR (h, w, 3), of the plate's size.
        plate: the view without persons.
        region: x, y, width, height to examine, px; None for the whole image.
        lit: of the image, if known.
    """
    region = region or (0, 0, image.shape[1], image.shape[0])
    lit = lit or lit_by(image, plate)
    light, level = lit.light, lit.level
    moving = _moving(image, _lit(plate.fine, light, region), region, level)
    anything, mask = np.zeros(image.shape[:2], dtype=np.bool_), np.zeros(image.shape[:2], dtype=np.bool_)
    anything[_slices(region)] = moving
    x, y, width, height = cv2.boundingRect(moving)
    if width == 0:
        return _known(anything, mask, level, plate, region)
    active = _grown(x, y, width, height, region)
    objects = np.empty((active[3], active[2]), dtype=np.uint8)
    smooth = cv2.GaussianBlur(cut(image, active, MARGIN), (5, 5), 0)
    seen = np.array(anything[_slices(active)]).view(np.uint8)
    without_shadows(smooth, _lit(plate.coarse, light, active, MARGIN), (0, 0), seen, _SHADOW, objects)
    cleaned = cv2.morphologyEx(cv2.morphologyEx(objects, cv2.MORPH_OPEN, _SQUARE), cv2.MORPH_CLOSE, _DISC)
    mask[_slices(active)] = _without_specks(cleaned)
    return _known(anything, mask, level, plate, region)


def _known(moving: Mask, mask: Mask, level: float, plate: Plate, region: Region) -> Changed:
    """Changes in a region, where the plate knows."""
    if plate.unknown is not None:
        inside = _slices(region)
        moving[inside] |= plate.unknown[inside]
        mask &= ~plate.unknown
    return Changed(moving, mask, level)


def _lit(picture: Image, light: Light | None, region: Region, margin: int = 0) -> Image:
    """A region of a plate's picture, both with a margin, in the light of an image."""
    x, y, width, height = region
    part = picture[y : y + height + 2 * margin, x : x + width + 2 * margin]
    return np.ascontiguousarray(part) if light is None else light.on(part, (x - margin, y - margin))


def foreground(image: Image, plate: Plate, region: Region | None = None) -> Mask:
    """The moving foreground (h, w) of `changed`."""
    return changed(image, plate, region).foreground


def _moving(image: Image, plate: Image, region: Region, level: float) -> Image:
    """Non-zero in a region where a channel differs by more than a level from the plate of the region."""
    moving = np.empty((region[3], region[2]), dtype=np.uint8)
    mark_changes(cv2.GaussianBlur(cut(image, region, 1), (3, 3), 0), plate, (0, 0), level, moving)
    return moving


def _slices(region: Region) -> tuple[slice, slice]:
    x, y, width, height = region
    return slice(y, y + height), slice(x, x + width)


def _grown(x: int, y: int, width: int, height: int, region: Region) -> Region:
    """A box in a region, with the reach of the cleaning, inside the region; in px of the image."""
    left, top = max(x - _CARRIED, 0), max(y - _CARRIED, 0)
    right, bottom = min(x + width + _CARRIED, region[2]), min(y + height + _CARRIED, region[3])
    return region[0] + left, region[1] + top, right - left, bottom - top


def _without_specks(mask: Image) -> Mask:
    """Regions of at least a fiftieth of the largest one."""
    count, labels = cv2.connectedComponents(mask)
    kept = np.empty(mask.shape, dtype=np.bool_)
    large_regions(labels, count, _LEAST_SHARE, kept)
    return kept
