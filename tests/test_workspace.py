"""Rows of the kernels' workspace: as many samples as fit."""

from __future__ import annotations

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.kernels.rows import WORKSPACE_ROW
from tracker.synthesis.cpu import CpuSynthesis


def test_samples_as_dense_as_half_a_pixel(body: BodyModel) -> None:
    """Contours of large parts then fill a row, and their samples stand for longer pieces; parts of them are hidden."""
    camera = Camera.looking_at("near", (1920, 1080), 1500, (0, -2, 1), np.array([0, 0, 1.0]))
    q = body.rest().copy()
    q[2] = 0.9
    scene = Scene((Person("one", body, q),), Rig((camera,)))
    dense, usual = (CpuSynthesis(step_px=step).contours(scene) for step in (0.5, 4.0))
    assert np.bincount(dense.parts[0, 0, : dense.counts[0, 0]]).max() > WORKSPACE_ROW // 2
    long, same = (found.positions[0, 0, : found.counts[0, 0], 4].sum() for found in (dense, usual))
    np.testing.assert_allclose(long, same, rtol=0.02)
