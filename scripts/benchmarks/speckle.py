"""Speckle images with exactly known affine deformation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array, Image

# What a patch and its search need at the border.
MARGIN_PX = 24


@dataclass(frozen=True)
class Speckle:
    """Gaussian dots of random place and sign, evaluated at every pixel's centre: exact at any deformation."""

    size: tuple[int, int] = (400, 300)
    """Width and height, px."""

    dot_px: float = 1.5
    """Standard deviation of a dot, px."""

    contrast_grey: float = 40.0
    """Standard deviation of the grey levels."""

    noise_grey: float = 1.0
    seed: int = 0

    def image(self, affine: Array, shift: Array, key: int) -> Image:
        """The pattern f, deformed: the image of ``A x + shift`` is f(x), with noise of its own for each key."""
        width, height = self.size
        rng = np.random.default_rng(self.seed)
        n = int(0.35 * (width + 60) * (height + 60) / self.dot_px**2)
        places = rng.uniform((-30, -30), (width + 30, height + 30), (n, 2))
        signs = rng.choice((-1.0, 1.0), n)
        # the power of Poisson-distributed dots: density * pi * sigma^2
        amplitude = self.contrast_grey / np.sqrt(0.35 * np.pi)
        picture = np.zeros((height, width))
        inverse, reach = np.linalg.inv(affine), int(np.ceil(6.5 * self.dot_px * 1.1))
        for centre, sign in zip(places @ affine.T + shift, signs, strict=True):
            x, y = np.round(centre).astype(int)
            x0, x1, y0, y1 = max(0, x - reach), min(width, x + reach + 1), max(0, y - reach), min(height, y + reach + 1)
            if x0 >= x1 or y0 >= y1:
                continue
            dx, dy = np.arange(x0, x1) - centre[0], np.arange(y0, y1)[:, None] - centre[1]
            u, v = inverse[0, 0] * dx + inverse[0, 1] * dy, inverse[1, 0] * dx + inverse[1, 1] * dy
            picture[y0:y1, x0:x1] += sign * np.exp((u * u + v * v) / (-2 * self.dot_px**2))
        noise = np.random.default_rng((self.seed, key)).normal(size=picture.shape)
        grey: Image = np.clip(np.round(128 + amplitude * picture + self.noise_grey * noise), 0, 255).astype(np.uint8)
        return grey

    def grid(self, step_px: int) -> Array:
        """(N, 2) whole pixels that patches of up to 31 px fit around."""
        columns = np.arange(MARGIN_PX, self.size[0] - MARGIN_PX, step_px)
        rows = np.arange(MARGIN_PX, self.size[1] - MARGIN_PX, step_px)
        return np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
