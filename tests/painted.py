"""Pictures of a scene whose parts and background have given colours, with noise."""

from __future__ import annotations

import numpy as np

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Image, Integers
from tracker.kernels.regions import EVEN, N_COLOURS, Looks, Picture, Rule, Samples, Tables, encode, tabulate_posteriors
from tracker.synthesis.cpu import CpuSynthesis

RULE = Rule(step_m=0.005, reach=7, slack=0.07, floor=2e-4, gate_px=8.0, widest=1.0)


def painted(scene: Scene, colours: Array, noise: float = 0.0, seed: int = 0) -> tuple[Image, ...]:
    """One BGR image (H, W, 3) a view: each part in its row of colours (P + 1, 3), the background in the last one."""
    rng = np.random.default_rng(seed)
    images = []
    for ids in CpuSynthesis().part_ids(scene):
        clean = colours[ids]
        images.append(np.clip(clean + noise * rng.normal(size=clean.shape), 0, 255).astype(np.uint8))
    return tuple(images)


def encoded(images: tuple[Image, ...]) -> Picture:
    """Whole images as colour numbers."""
    codes = np.zeros(sum(image.shape[0] * image.shape[1] for image in images), dtype=np.uint16)
    layout, start = [], 0
    for image in images:
        height, width = image.shape[:2]
        encode(image, codes[start : start + width * height])
        layout.append((start, 0, 0, width, height))
        start += width * height
    return Picture(codes, np.array(layout))


def samples_of(contours: Contours, b: int = 0) -> Samples:
    """The samples of one pose."""
    return Samples(contours.positions[b], contours.points[b], contours.parts[b], contours.counts[b])


def looks_of(tables: Tables, half_extents: Array) -> Looks:
    """What follows from tables, all of them learnt."""
    known = np.ones(tables.inside.shape[:2], dtype=np.bool_)
    posteriors = np.full(tables.inside.shape, EVEN, dtype=np.uint8)
    tabulate_posteriors(tables, (RULE.floor, 4.0), known, posteriors)
    return Looks(tables, posteriors, known, half_extents)


def scattered_tables(n_views: int, n_parts: int, seed: int = 0) -> Tables:
    """Tables in which some colours occur often, some never."""
    rng = np.random.default_rng(seed)
    shares = rng.gamma(0.2, size=(2, n_views, n_parts, N_COLOURS)) * (rng.uniform(size=(2, 1, 1, N_COLOURS)) < 0.5)
    shares /= shares.sum(axis=-1, keepdims=True)
    return Tables(*shares.astype(np.float32), np.zeros((n_views, N_COLOURS), dtype=np.float32))


def colour_numbers(image: Image, pixels: Array) -> Integers:
    """Colour numbers (...,) of the pixels nearest to positions (..., 2), -1 outside; the twin of `colour_at`."""
    nearest = np.floor(pixels + 0.5).astype(np.int64)
    height, width = image.shape[:2]
    inside = ((nearest >= 0) & (nearest < (width, height))).all(axis=-1)
    column, row = np.clip(nearest[..., 0], 0, width - 1), np.clip(nearest[..., 1], 0, height - 1)
    bins = image[row, column].astype(np.int64) // 16
    numbers: Integers = np.where(inside, bins @ np.array([256, 16, 1]), -1)
    return numbers
