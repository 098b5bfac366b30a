"""Separates light and content of a picture: gains, local contrast, lightness, chroma and texture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.foundation.arrays import Array32, Image, Integers, Mask, Region, frozen
from tracker.kernels.changes import (
    block_ratios,
    connected_blocks,
    count_coloured,
    mark_appearance,
    relight,
    smooth_surface,
)

SAMPLING = 4
"""Pixels from one to the next of the sparse pictures from which light and noise are found."""

# Blocks across the longer side of a large picture; sparse pixels along the side of a block, at least (24 px).
_ACROSS, _SIDE = 30, 6
# Samples along the side of a block: the median filter takes their noise away.
_SAMPLES = 3
# Smallest departure from the surface that weighs a half, log ratio; iterations.
_LEAST, _STEPS = 0.03, 8
# Of so many rows of blocks and more every second one is enough for the surface.
_MANY = 16
# Largest step of the light from one block to the next: half a lamp's light falls off by 0.07 a block over 150 px.
# 0.08 gives the same silhouettes.
_STEP = 0.12
# Window of the median, blocks, and reach of the smoothing where other things hide the plate, blocks. On four rendered
# recordings relit in five ways, as they are and cut to the person (a sixth of the picture is he), 5 blocks are better
# than 7 wherever the two differ (a lamp's spot: IoU 0.81 to 0.93 and 0.76 to 0.92). Without the test for steps 9
# blocks take a large person for light in part: 0.84 to 0.81 at worst in unchanged light.
_MEDIAN_WINDOW, _REACH, _FAR = 5, 2.0, np.float32(0.02)


@dataclass(frozen=True, eq=False)
class Light:
    """Ratio of an image's light to its plate's."""

    gains: Array32
    """(n, m, 3) in blocks."""

    block_px: int

    def on(self, picture: Image, origin: tuple[int, int] = (0, 0), spacing: int = 1) -> Image:
        """A part of the plate in this light.

        Args:
            picture: (h, w, 3) the part.
            origin: pixel (x, y) of the plate of the part's upper left corner; may lie outside.
            spacing: pixels of the plate from one pixel of the part to the next.
        """
        lit = np.empty(picture.shape, dtype=np.uint8)
        relight(np.ascontiguousarray(picture), self.gains, float(self.block_px), (*origin, spacing), lit)
        return lit


def sparse(picture: Image) -> Image:
    """Every fourth pixel (h / 4, w / 4, 3): enough to find light and noise."""
    return np.array(picture[::SAMPLING, ::SAMPLING])


def light_of(image: Image, plate: Image) -> Light | None:
    """Light of an image against that of its plate, in spite of persons.

    Blocks tell the ratio by their medians. A quadratic surface that most of them agree with shows where the plate is
    visible; from there on, blocks that a step separates from all others belong to persons or things, and are bridged. A
    median filter removes the rest of them. Persons may cover up to half of the picture.

    Args:
        image: (h, w, 3) `sparse` image.
        plate: (h, w, 3) `sparse` plate.

    Returns:
        None for pictures of less than three blocks on a side.
    """
    size = max(_SIDE, round(max(image.shape[:2]) / _ACROSS))
    if min(image.shape[:2]) < 3 * size:
        return None
    ratios = block_ratios(image, plate, size, size // _SAMPLES)
    surface = smooth_surface(ratios, _LEAST, _STEPS, 1 if ratios.shape[0] < _MANY else 2)
    departures = (ratios - surface).astype(np.float32)
    local = cv2.medianBlur(_bridged(departures, connected_blocks(ratios - surface, _STEP)), _MEDIAN_WINDOW)
    return Light(np.exp(surface + cv2.GaussianBlur(local, (3, 3), 0)).astype(np.float32), size * SAMPLING)


def _bridged(departures: Array32, known: Mask) -> Array32:
    """Departures (n, m, 3) with the unknown ones from the known ones (n, m) about them, none far from any."""
    about = cv2.GaussianBlur(known.astype(np.float32), (0, 0), _REACH) + _FAR
    filled = cv2.GaussianBlur(departures * known[..., None], (0, 0), _REACH) / about[..., None]
    bridged: Array32 = np.where(known[..., None], departures, filled)
    return bridged


def wallis_filter(grey: Image | Array32, window_px: int, contrast: float, expansion: float) -> Array32:
    """Wallis filter: brings the local mean and the local contrast of an image near given values.

    Args:
        grey: image (h, w).
        window_px: side of the square window of the local statistics, odd, px.
        contrast: standard deviation aimed at, grey levels.
        expansion: constant e, below 1: contrast is raised e / (1 - e) times at most, in plain areas; the nearer to 1,
            the more equal the contrast is everywhere, that of noise included.

    Returns:
        (h, w), around 127 grey levels, not cut off to 0 to 255.
    """
    values = grey.astype(np.float32)
    window = window_px, window_px
    mean = cv2.blur(values, window, borderType=cv2.BORDER_REFLECT_101)
    squares = cv2.sqrBoxFilter(values, cv2.CV_32F, window, borderType=cv2.BORDER_REFLECT_101)
    deviation = np.sqrt(np.maximum(squares - mean * mean, 0))
    gain = expansion * contrast / (expansion * deviation + (1 - expansion) * contrast)
    enhanced: Array32 = (values - mean) * gain + expansion * 127 + (1 - expansion) * mean
    return enhanced


# Noise of a camera that stands still, and images smoothed against it.

# A sixteenth of the pixels is enough.
_NOISE_SAMPLING = 4
# Median of the absolute values of a normal distribution of standard deviation 1.
_MEDIAN = 0.6745


def noise_grey(before: Image, after: Image) -> float:
    """Standard deviation of the noise in two images (h, w, 3) one after the other, grey levels of its worst channel.

    Most of the images must be still; flicker of the whole light does not count. Noise that a codec removes does not
    count either.
    """
    now, then = (image[::_NOISE_SAMPLING, ::_NOISE_SAMPLING].astype(np.int16) for image in (after, before))
    change = (now - then).reshape(-1, before.shape[-1])
    middle = max(_median(np.abs(one - int(np.median(one)))) for one in change.T)
    return middle / _MEDIAN / float(np.sqrt(2))


def _median(values: Integers) -> float:
    """Median of magnitudes (N,) that were rounded, as finely as if they had not been: each has a width of one."""
    counts = np.bincount(values)
    counts = np.insert(counts, 0, 0).astype(np.float64)
    # of 0 there is but the half that is positive
    edges = np.insert(np.arange(len(counts) - 1) + 0.5, 0, 0.0)
    return float(np.interp(counts.sum() / 2, np.cumsum(counts), edges))


def smoothed(image: Image, sigma_px: float) -> Image:
    """The image (h, w, 3) smoothed by a Gaussian; as it is for 0."""
    if sigma_px == 0:
        return image
    smooth: Image = cv2.GaussianBlur(image, (0, 0), sigma_px)
    return smooth


# Chroma of a pixel in quarters of a level from Cr and Cb (ITU-R BT.601): a fourth of it is 1.05 red - 0.39 green - 0.66
# blue, so that none of the primary and secondary colours has that of grey.
_RED, _BLUE = 7, -4

_PALE = 40.0
"""Chroma, levels, up to which pale colours are told apart: 3 of 128 to a level near grey, less and less beyond. In
straight steps a person before grey walls was 30 mm (18) off, with a joint off in 10 of 80 frames."""

# See docs/lab/colours.md.
_SLOPES = 0.7, 1.4, 2.8
"""Mean slopes between the four steps of either direction, grey levels a px: of noise, skin, walls and floors."""

_ALIKE_GREY = 8
"""Channels that differ by less are of one grey: a codec makes up to 3 of none."""

_COLOURED_SHARE = 1e-3
"""Images of more colours than this are of a colour camera: of the least colourful one of `BODYTRACK_DATA`, grey walls
around a person, 3 % differ by more."""

# Every eighth pixel in both directions is enough for it.
_SAMPLING = 8


def _chroma() -> Image:
    """Chroma of quarters of a level, from the least on."""
    quarters = np.arange(255 * _BLUE, 255 * _RED + 1) - 128 * (_RED + _BLUE)
    return frozen(np.round(128 + 127 * np.tanh(np.clip(np.rint(quarters / 4), -128, 127) / _PALE)), np.uint8)


_CHROMA = _chroma()


def appearance(image: Image, region: Region) -> Image:
    """A region of an image whose channels are lightness, chroma and texture.

    Of 16 levels each, they tell more than 16 levels of blue, green and red, which are lightness for the most part, and
    skin and a floor often have the same. Texture are mean slopes across and along (Rosenhahn et al. 2006, section 2.1,
    have the structure tensor), four steps of each; where there are no colours each has a channel of its own. Whole
    numbers, so that a region is the same whatever is looked at beside it.

    Args:
        image: BGR (h, w, 3).
        region: x, y, width and height, px.

    Returns:
        (height, width, 3).
    """
    x, y, width, height = region
    looks = np.empty((height, width, 3), dtype=np.uint8)
    weights, (first, second, third) = (_RED, _BLUE, -255 * _BLUE), (round(10 * slope) for slope in _SLOPES)
    mark_appearance(image, (x, y), weights, _CHROMA, (first, second, third), is_monochrome(image), looks)
    return looks


def is_monochrome(image: Image) -> bool:
    """Whether an image (h, w, 3) has no colours."""
    n_looked_at = -(-image.shape[0] // _SAMPLING) * -(-image.shape[1] // _SAMPLING)
    return bool(count_coloured(image, _SAMPLING, _ALIKE_GREY) < _COLOURED_SHARE * n_looked_at)
