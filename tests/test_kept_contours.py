"""Contours that are asked for again: the same ones, not traced anew, and only where nothing else was asked."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from observations import off
from rounding import assert_alike

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.synthesis import cpu
from tracker.synthesis.cpu import CpuSynthesis


@pytest.fixture
def asked(truth: Scene) -> tuple[Scene, np.ndarray]:
    """A scene, and three poses of its person."""
    body, q = truth.persons[0].body, truth.persons[0].q
    return truth, body.clamped(q + np.array([off(body, 10.0, 0.1, seed) for seed in range(3)]))


def assert_same(found: Contours, wanted: Contours) -> None:
    """But for rounding: some are traced alone, some beside others."""
    for v in range(wanted.n_views):
        for field in fields(wanted.of(v)):
            assert_alike(getattr(found.of(v), field.name), getattr(wanted.of(v), field.name))


def anew(scene: Scene, synthesis: CpuSynthesis | None = None) -> Contours:
    cpu._TRACED.clear()
    return (synthesis or CpuSynthesis()).contours(scene)


def test_what_was_expected_is_not_traced_again(asked, monkeypatch):
    scene, poses = asked
    together = Scene._placed

    def one_by_one(self: Scene, person: int | None, several: Array | None) -> Array:
        """Placements that are kept are looked for by their bits, which rounding changes with the number of poses."""
        each = [several] if several is None else [q[None] for q in several]
        return np.concatenate([together(self, person, one) for one in each])

    monkeypatch.setattr(Scene, "_placed", one_by_one)
    wanted = [anew(scene.with_pose(0, q)) for q in poses]
    batch = CpuSynthesis().contours(scene, 0, poses)
    monkeypatch.setattr(CpuSynthesis, "_drawn", None)
    for b, q in enumerate(poses):
        assert_same(CpuSynthesis().contours(scene, 0, q[None]), wanted[b])
        assert_same(CpuSynthesis().contours(scene.with_pose(0, q)), batch.pose(b))


def test_another_question_has_another_answer(asked):
    scene, poses = asked
    turned = Rig(scene.rig.cameras[::-1])
    others = [
        (scene.with_pose(0, poses[0]), CpuSynthesis()),
        (Scene(scene.persons, turned), CpuSynthesis()),
        (scene, CpuSynthesis(step_px=4.0)),
        (scene, CpuSynthesis(contact_m=0.0)),
        (scene, CpuSynthesis(n_eta=7)),
    ]
    wanted = [anew(*other) for other in others]
    for (other, synthesis), right in zip(others, wanted, strict=True):
        CpuSynthesis().contours(scene)
        assert_same(synthesis.contours(other), right)


def test_few_are_kept(asked):
    scene, poses = asked
    for k in range(20):
        CpuSynthesis().contours(scene.with_pose(0, poses[0] + 1e-3 * k))
    assert len(cpu._TRACED) == cpu._MOST_TRACED
