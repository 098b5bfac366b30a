"""What Gruen's linearized equations of a patch are told: how patches are matched, and what noise there is."""

from __future__ import annotations

from tracker.foundation.arrays import Array32

Rule = tuple[int, int, float, float, float, bool]
"""Half patch px, most iterations, tolerance px, farthest shift px, prior's weight, classical form."""

Noise = tuple[float, float, Array32]
"""Powers that white noise keeps in residuals and in gradients; taps of the smoothing that the images went through."""
