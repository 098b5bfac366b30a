"""Kernels of the bundle adjustment: what they cannot take is refused by name, before anything is written."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tracker._native as native

CAMERAS, POINTS = np.ones((2, 26)), np.ones((3, 3))
OBSERVED = np.zeros(4, np.int64), np.zeros(4, np.int64), np.zeros((4, 2)), np.zeros((4, 2)), np.ones(4)
OBJECTS = POINTS, np.zeros((3, 3, 6)), np.array([0, 4]), np.zeros((1, 6, 6)), np.zeros((1, 6))
REDUCED = np.zeros((34, 34)), np.zeros(34), np.zeros((1, 6, 6)), np.zeros((1, 6)), np.zeros((1, 2, 6, 17))
MEETING = (
    np.zeros((3, 29)),
    np.zeros((3, 2, 2)),
    np.zeros((3, 2, 3)),
    np.zeros((2, 3)),
    np.zeros((2, 3, 3)),
    np.zeros(2),
)


def changed(values: tuple[Any, ...], k: int, value: Any) -> tuple[Any, ...]:
    return (*values[:k], value, *values[k + 1 :])


REFUSED = {
    "camera: .*26": ("project_with_slopes", np.ones(29), POINTS[0], POINTS[0, :2], np.ones((2, 17)), np.ones((2, 3))),
    "by_camera: .*2, 17": ("project_with_slopes", CAMERAS[0], POINTS[0], np.ones(2), np.ones((2, 16)), np.ones((2, 3))),
    "views: .*0 to 1, found 2": (
        "bundle_residuals",
        CAMERAS,
        POINTS,
        changed(OBSERVED, 0, 2 + OBSERVED[0]),
        np.ones((4, 2)),
    ),
    "numbers: .*0 to 2, found 3": (
        "bundle_residuals",
        CAMERAS,
        POINTS,
        changed(OBSERVED, 1, 3 + OBSERVED[1]),
        np.ones((4, 2)),
    ),
    "residuals: .*4, 2": ("bundle_residuals", CAMERAS, POINTS, OBSERVED, np.ones((3, 2))),
    "firsts: .*rise from 0 to 4": (
        "reduce_normal",
        CAMERAS,
        changed(OBJECTS, 2, np.array([0, 5])),
        OBSERVED,
        0.0,
        REDUCED,
    ),
    "slopes: .*3, 3, 6": ("reduce_normal", CAMERAS, changed(OBJECTS, 1, np.zeros((3, 6, 3))), OBSERVED, 0.0, REDUCED),
    "normal: .*34, 34": ("reduce_normal", CAMERAS, OBJECTS, OBSERVED, 0.0, changed(REDUCED, 0, np.zeros((17, 17)))),
    "couplings: .*1, 2, 6, 17": (
        "reduce_normal",
        CAMERAS,
        OBJECTS,
        OBSERVED,
        0.0,
        changed(REDUCED, 4, np.zeros((1, 1, 6, 17))),
    ),
    "cameras: .*29": ("intersect_rays", *changed(MEETING, 0, CAMERAS)),
    "pixels: .*3, 2, 2": ("intersect_rays", *changed(MEETING, 1, np.zeros((2, 2, 2)))),
    "covariances: .*2, 3, 3": ("intersect_rays", *changed(MEETING, 4, np.zeros((3, 3, 3)))),
}


@pytest.mark.parametrize("told", REFUSED)
def test_what_a_kernel_cannot_take_is_refused_by_name(told: str) -> None:
    name, *arguments = REFUSED[told]
    with pytest.raises(ValueError, match=f"^{told}"):
        getattr(native, str(name))(*arguments)
