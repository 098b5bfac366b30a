"""Textures known exactly everywhere: sums of waves, on images and on planes before cameras."""

from __future__ import annotations

import numpy as np

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image


class Waves:
    """A band-limited random texture: cosine waves of 0.6 to `widest` wavelengths, as strong in every octave."""

    def __init__(
        self, wavelength: float, contrast: float = 40.0, seed: int = 0, n: int = 60, widest: float = 2.5
    ) -> None:
        rng = np.random.default_rng(seed)
        lengths = wavelength * np.exp(rng.uniform(np.log(0.6), np.log(widest), n))
        directions = rng.uniform(0, 2 * np.pi, n)
        self._waves = 2 * np.pi / lengths * np.stack([np.cos(directions), np.sin(directions)])
        self._phases = rng.uniform(0, 2 * np.pi, n)
        self._amplitude = contrast * np.sqrt(2 / n)

    def __call__(self, places: Array) -> Array:
        """Grey levels (...) at places (..., 2)."""
        return 128 + self._amplitude * np.cos(places @ self._waves + self._phases).sum(axis=-1)


def sensed(grey: Array, noise: float, key: int) -> Image:
    """What a camera delivers: noisy whole numbers."""
    noisy = grey + noise * np.random.default_rng(key).normal(size=grey.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def pixels_of(size: tuple[int, int]) -> Array:
    """(h, w, 2) pixel positions."""
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(np.float64)


def deformed(texture: Waves, size: tuple[int, int], affine: Array, shift: Array, noise: float, key: int) -> Image:
    """The image of `affine x + shift` is the texture's at x."""
    places = (pixels_of(size) - shift) @ np.linalg.inv(affine).T
    return sensed(texture(places), noise, key)


def plane_seen(texture: Waves, camera: Camera, noise: float, key: int) -> Image:
    """The plane z = 0 of the world, the texture in metres on it."""
    rays = camera.rays(pixels_of(camera.size))
    places = camera.centre[:2] - rays[..., :2] / rays[..., 2:] * camera.centre[2]
    return sensed(texture(places), noise, key)
