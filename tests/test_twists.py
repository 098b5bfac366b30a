"""The benchmark of twists measures turns about the long axis of a segment alone."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).parents[1]


def test_twists_are_errors_about_the_long_axis_whatever_the_frames(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A body and a truth whose segments have other axes differ by a constant turn; what swings is not counted."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    twists = importlib.import_module("benchmarks.twists")
    rng, frames = np.random.default_rng(0), np.arange(30)
    true = Rotation.from_rotvec(0.8 * rng.normal(size=3) + 0.3 * rng.normal(size=(30, 3)))
    axis = true.apply(np.array([0.0, 0.6, 0.8]))
    joints = np.stack([np.zeros((30, 3)), 0.3 * axis], axis=1)[None]
    rotations = true.as_matrix()[None, :, None]
    path = tmp_path / twists.TRUTH
    np.savez(path, segment_names=["head"], joint_names=["a", "b"], segment_rotations=rotations, joints=joints)
    wrong = np.radians(10) * np.sin(np.arange(30))
    offset = Rotation.from_euler("xyz", [30, -70, 110], degrees=True)
    found = Rotation.from_rotvec(wrong[:, None] * axis) * true * offset
    errors = twists._twist_deg(found.as_matrix(), path, ["head", "a", "b"], frames)
    np.testing.assert_allclose(errors, -np.degrees(wrong - wrong.mean()), atol=0.1)
    across = np.cross(axis, (1.0, 0.0, 0.0))
    across *= np.radians(10) * rng.choice([-1, 1], (30, 1)) / np.linalg.norm(across, axis=1, keepdims=True)
    swung = Rotation.from_rotvec(across) * true * offset
    assert np.abs(twists._twist_deg(swung.as_matrix(), path, ["head", "a", "b"], frames)).max() < 2
