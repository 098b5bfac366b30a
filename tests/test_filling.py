"""Filled parts against all lines of their grids."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from observations import four_views
from scipy.spatial.transform import Rotation

from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.kernels.pictures import fill_parts
from tracker.synthesis.cpu import CpuSynthesis, _grids

LAYOUT = (13, 24)


def outermost(points: Array, size: tuple[int, int]) -> Mask:
    """Between the outermost lines of a grid (R, C, 2) px, closed around its columns."""
    extents = np.stack([np.full(size[1], np.inf), np.full(size[1], -np.inf)])
    around = np.stack([points, np.roll(points, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    up = np.stack([points[:-1], points[1:]], axis=2).reshape(-1, 2, 2)
    lines = np.concatenate([around, up])
    lines = np.where(lines[:, 1:, 1:] < lines[:, :1, 1:], lines[:, ::-1], lines)  # downwards
    first = np.maximum(np.ceil(lines[:, 0, 1]), 0).astype(int)
    counts = np.maximum(np.minimum(np.floor(lines[:, 1, 1]), size[1] - 1).astype(int) + 1 - first, 0)
    rows = np.arange(counts.sum()) + np.repeat(first - (np.cumsum(counts) - counts), counts)
    (u0, v0), (u1, v1) = np.repeat(lines, counts, axis=0).transpose(1, 2, 0)
    us = u0 + (u1 - u0) / np.where(v1 > v0, v1 - v0, 1.0) * (rows - v0)
    np.minimum.at(extents[0], rows, us)
    np.maximum.at(extents[1], rows, us)
    columns = np.arange(size[0])
    filled: Mask = (columns >= extents[0][:, None] - 1e-9) & (columns <= extents[1][:, None] + 1e-9)
    return filled


def bent_lenses(rig: Rig) -> Rig:
    """The rig with lenses that bend straight lines by up to 20 px."""
    lens = np.array([-0.12, 0.03, 0.002, -0.001, 0.0])
    return Rig(tuple(replace(camera, distortion=lens) for camera in rig.cameras))


def scattered_parts(n: int) -> tuple[Array, Array]:
    """Round, boxy, thin and tapered superquadrics (n, 7), and where they are (n, 4, 4), before every camera."""
    rng = np.random.default_rng(3)
    shapes = np.concatenate(
        [rng.uniform(0.02, 0.35, (n, 3)), rng.uniform(0.08, 1.0, (n, 2)), rng.uniform(-0.6, 0.6, (n, 2))], axis=1
    )
    placements = np.tile(np.eye(4), (n, 1, 1))
    placements[:, :3, :3] = Rotation.random(n, random_state=3).as_matrix()
    placements[:, :3, 3] = np.array([0.0, 0.0, 1.0]) + rng.normal(scale=0.3, size=(n, 3))
    return shapes, placements


@pytest.mark.parametrize("bent", [False, True])
def test_parts_are_filled_to_their_outermost_lines(bent: bool) -> None:
    rig = bent_lenses(four_views()) if bent else four_views()
    shapes, placements = scattered_parts(60)
    grids = _grids(shapes, *LAYOUT)[0]
    for p, placement in enumerate(placements):
        world = grids[p, :, :3].astype(np.float64) @ placement[:3, :3].T + placement[:3, 3]
        for camera, row in zip(rig.cameras, rig.packed, strict=True):
            mask = np.zeros(camera.size[::-1], dtype=np.bool_)
            fill_parts(placements[p : p + 1], grids[p : p + 1], LAYOUT, row, mask)
            wanted = outermost(camera.project(world).reshape(25, 48, 2), camera.size)
            assert wanted.any()
            np.testing.assert_array_equal(mask, wanted)


def test_what_is_not_wholly_before_a_camera_is_left_out(truth: Scene) -> None:
    camera, row = truth.rig.cameras[0], truth.rig.packed[0]
    grids = _grids(truth.shapes, *LAYOUT)[0]
    placements = np.tile(np.eye(4), (len(grids), 1, 1))
    placements[:, :3, 3] = camera.centre
    mask = np.zeros(camera.size[::-1], dtype=np.bool_)
    fill_parts(placements, grids, LAYOUT, row, mask)
    assert not mask.any()
    assert CpuSynthesis().silhouettes(truth)[0].any()
