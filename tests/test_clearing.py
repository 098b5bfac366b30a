"""What is left of the images in which a person is looked for: who is known stays, wherever in the scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from observations import four_views

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.evidence.contours import ContourEvidence
from tracker.foundation.errors import BackdropError
from tracker.images.plate import Plate
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._drafts import Draft
from tracker.tracking.initialization._persons import Found
from tracker.tracking.initialization._stance_search import on_floor
from tracker.tracking.initialization.pca import _stand_out
from tracker.tracking.start import Hypothesis


class _Looked(Exception):  # noqa: N818 - what is looked at is all that is asked
    """A frame was looked at."""


@dataclass(frozen=True)
class _Keeping(ContourEvidence):
    """Keeps what it is asked to look at."""

    frames: list[Frame] = field(default_factory=list)

    def observe(self, sight: Any, *_: Any) -> Any:
        self.frames.append(sight.frame)
        raise _Looked


def two_persons(body: BodyModel) -> Scene:
    poses = on_floor(body, np.array([body.rest()] * 2), np.array([[0.0, -0.8], [0.0, 0.8]]), 0.0)
    return Scene(tuple(Person(name, body, q) for name, q in zip("ab", poses, strict=True)), four_views())


def test_who_is_known_does_not_stand_out_for_who_is_sought(body: BodyModel) -> None:
    scene = two_persons(body)
    plates = tuple(Plate(np.full((288, 360, 3), 60, np.uint8)) for _ in scene.rig.names)
    masks = CpuSynthesis().silhouettes(Scene(scene.persons[:1], scene.rig))
    frame = Frame(0, 0.0, tuple(np.where(mask[..., None], (200, 200, 200), 60).astype(np.uint8) for mask in masks))
    stages = Stages(CpuSynthesis(), ContourEvidence(), HybridEstimation(), plates, held=(0,))
    with pytest.raises(BackdropError, match="of b would stand out"):
        _stand_out(frame, scene, stages, [scene.persons[1].q])


@pytest.mark.parametrize("held", [0, 1])
def test_who_is_known_stays_in_the_images_wherever_in_the_scene(body: BodyModel, held: int) -> None:
    scene, sought = two_persons(body), 1 - held
    rig, poses = scene.rig, [person.q for person in scene.persons]
    rng = np.random.default_rng(0)
    plates = tuple(Plate(rng.integers(0, 90, (288, 360, 3), dtype=np.uint8)) for _ in rig.names)
    silhouettes = CpuSynthesis().silhouettes(scene)
    images = tuple(
        np.where(mask[..., None], np.uint8(200), plate.picture) for mask, plate in zip(silhouettes, plates, strict=True)
    )
    # what was found of the person sought is the legs alone: the rest is cleared away, and nothing of the other
    legs = body.landmarks_in_world(poses[sought])
    found = Found(legs[legs[:, 2] < 0.6], (None,) * 4)
    hypotheses = tuple((Hypothesis(q, 1.0, 1.0, 0.0, 0.0),) if k == sought else () for k, q in enumerate(poses))
    evidence = _Keeping()
    with pytest.raises(_Looked):
        Draft(Frame(0, 0.0, images), scene, (found,), ((), ()), hypotheses).settled(
            Stages(CpuSynthesis(), evidence, HybridEstimation(), plates, held=(held,)), 1
        )
    (looked_at,) = evidence.frames
    shown = [_shown(looked_at, body, rig, q) for q in poses]
    assert shown[held] > 0.95 > 0.7 > shown[sought]


def _shown(frame: Frame, body: BodyModel, rig: Any, q: Any) -> float:
    """Share of a person's landmarks where the first view shows somebody."""
    x, y = np.rint(rig.cameras[0].project(body.landmarks_in_world(q))).astype(int).T
    image = frame.images[0]
    assert image is not None
    return float((image[y, x] == 200).all(axis=1).mean())
