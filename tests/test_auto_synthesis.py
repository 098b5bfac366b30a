"""The choice between the graphics card and the CPU."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tracker.bodies.scene import Scene
from tracker.foundation.errors import RenderError
from tracker.images.sight import Observation
from tracker.synthesis import auto
from tracker.synthesis.auto import AutoSynthesis
from tracker.synthesis.cpu import CpuSynthesis


def chosen(renderer: str | RenderError, monkeypatch: pytest.MonkeyPatch) -> AutoSynthesis:
    """`auto` on a machine where OpenGL is drawn by that, or not at all."""

    def atlas_on(device: int) -> Any:
        if isinstance(renderer, RenderError):
            raise renderer
        return SimpleNamespace(renderer=renderer)

    auto.look_again()
    monkeypatch.setattr(auto, "atlas_on", atlas_on)
    return AutoSynthesis()


@pytest.fixture
def _look_again() -> Iterator[None]:
    yield
    auto.look_again()


@pytest.mark.usefixtures("_look_again")
@pytest.mark.parametrize(
    ("renderer", "sentence"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", "cpu, because OpenGL is software here (llvmpipe (LLVM 15.0.6, 256 bits))"),
        ("softpipe", "cpu, because OpenGL is software here (softpipe)"),
        ("Mesa Software Rasterizer", "cpu, because OpenGL is software here"),
        (RenderError("no OpenGL: apt-get install libegl1"), "cpu, because no OpenGL: apt-get install libegl1"),
        ("NVIDIA H200/PCIe/SSE2", "egl, because there is a graphics card (NVIDIA H200/PCIe/SSE2)"),
    ],
)
def test_the_choice_is_explained(renderer: Any, sentence: str, monkeypatch: pytest.MonkeyPatch) -> None:
    choice = chosen(renderer, monkeypatch).choice
    assert choice.startswith(sentence)
    assert "\n" not in choice


@pytest.mark.usefixtures("_look_again")
@pytest.mark.parametrize("name", ["llvmpipe", "NVIDIA"])
def test_a_card_scores_large_batches_and_the_tracer_the_rest(
    name: str, truth: Scene, observation: Observation, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Card:
        def __init__(self, **settings: Any) -> None:
            pass

        def directed_distances(self, scene: Scene, person: int, poses: np.ndarray, *rest: Any) -> np.ndarray:
            return np.full((len(poses), 4, 2), -1.0)

    monkeypatch.setattr(auto, "EglSynthesis", Card)
    synthesis, cpu = chosen(name, monkeypatch), CpuSynthesis()
    for v in range(len(truth.rig)):
        np.testing.assert_array_equal(synthesis.contours(truth).of(v).pixels, cpu.contours(truth).of(v).pixels)
    np.testing.assert_array_equal(synthesis.silhouettes(truth), cpu.silhouettes(truth))
    np.testing.assert_array_equal(synthesis.part_ids(truth), cpu.part_ids(truth))
    for n, card in ((1, False), (64, name == "NVIDIA")):
        poses = np.tile(truth.persons[0].q, (n, 1))
        found = synthesis.directed_distances(truth, 0, poses, observation, 40.0, False)
        expected = cpu.directed_distances(truth, 0, poses, observation, 40.0, False)
        np.testing.assert_array_equal(found, np.full_like(expected, -1.0) if card else expected)
