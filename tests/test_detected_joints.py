"""What the benchmark says of joints in space: exact for joints whose faults are known."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from benchmarks.detected_joints import JOINTS, measured

TRUTH = np.random.default_rng(0).uniform(-1, 1, (1, len(JOINTS), 3)).repeat(6, axis=0)
"""Somebody who stands still."""


def test_a_constant_offset_is_no_error_once_it_is_removed() -> None:
    found = measured(TRUTH + np.array([0.03, 0.0, 0.04]), TRUTH)
    assert found.mean_mm == pytest.approx(50.0)
    assert (found.removed_mm, found.bones_mm, found.slide_mm) == pytest.approx((0, 0, 0), abs=1e-6)
    assert (found.missing, found.frames_missing) == (0, 0)


def test_a_joint_that_swings_changes_its_bones_and_slides() -> None:
    joints = TRUTH.copy()
    ankle, knee = JOINTS.index("left_ankle"), JOINTS.index("left_knee")
    along = (joints[0, ankle] - joints[0, knee]) / np.linalg.norm(joints[0, ankle] - joints[0, knee])
    joints[:, ankle] += np.outer([0.01, -0.01] * 3, along)
    found = measured(joints, TRUTH)
    # one bone of eight, one ankle of two
    assert found.bones_mm == pytest.approx(10 / np.sqrt(8))
    assert found.bones_worst_mm == pytest.approx(10)
    assert found.slide_mm == pytest.approx(20 / np.sqrt(2))
    assert found.removed_mm == pytest.approx(10 / 12)


def test_an_ankle_that_walks_does_not_slide() -> None:
    walking = TRUTH + np.arange(6)[:, None, None] * np.array([0.05, 0.0, 0.0])
    assert np.isnan(measured(walking, walking).slide_mm)


def test_joints_and_frames_that_are_missing_are_told() -> None:
    joints = TRUTH.copy()
    joints[2] = np.nan
    joints[3, :3] = np.nan
    found = measured(joints, TRUTH)
    assert found.frames_missing == 1
    assert found.missing == pytest.approx(15 / 72)
    assert found.mean_mm == pytest.approx(0)
