"""Parameters that swing, and what is seen of them."""

from __future__ import annotations

import numpy as np

from tracker.results.smoothing import Stretch

FPS = 50.0


def swinging(n=200, dof=3, seed=0):
    """Times, true values, velocities and accelerations of sines of up to 1.2 Hz, amplitudes about 0.5."""
    rng, times = np.random.default_rng(seed), np.arange(n) / FPS
    rate, phase, size = 2 * np.pi * rng.uniform(0.4, 1.2, dof), rng.uniform(0, 6, dof), rng.uniform(0.3, 0.7, dof)
    angle = rate * times[:, None] + phase
    return times, size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)


def observed(truth, sigma=0.02, seed=1, known=None):
    """A stretch of noisy poses, whose noise is what its covariances say."""
    noise = sigma * np.random.default_rng(seed).normal(size=truth.shape)
    covariances = np.broadcast_to(sigma**2 * np.eye(truth.shape[1]), (len(truth), *2 * truth.shape[1:]))
    known = np.ones(len(truth), bool) if known is None else known
    poses = np.where(known[:, None], truth + noise, np.nan)
    return Stretch(np.arange(len(truth)) / FPS, poses, covariances, known)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))
