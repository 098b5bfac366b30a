"""Points on Pluecker lines: zero where a point is on its ray, and the Jacobian of finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from solids import RIGS, posed

from tests.recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation
from tracker.bodies.scene import Scene
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.correspondences import Correspondences
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.similarity import pluecker
from tracker.evidence.similarity.pluecker import PlueckerSimilarity, incidence
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.sequence import track


@pytest.mark.parametrize("rig", ["narrow", "distorted", "fisheye"])
def test_the_incidence_with_rays_and_its_jacobian(rig: str) -> None:
    rng = np.random.default_rng(7)
    person = posed("gavrila22", 1)[0]
    body, q, scene = person.body, person.q, Scene((person,), RIGS[rig])
    parts = rng.integers(0, len(body.parts), 40)
    ends = body.part_parameters[parts]
    local = body.model_from_parts[parts, :3, 3] + rng.uniform(-0.1, 0.1, (40, 3))

    def placed(pose: np.ndarray) -> np.ndarray:
        motions = body.world_from_parameters(pose)[ends]
        return np.einsum("nij,nj->ni", motions[:, :3, :3], local) + motions[:, :3, 3]

    views = rng.integers(0, len(scene.rig), 40)
    points = placed(q)
    pixels = np.stack([scene.rig.cameras[v].project(x[None])[0] for v, x in zip(views, points, strict=True)])
    asked = Comparison(scene, 0, CpuSynthesis(), None)
    pairs = Correspondences(points, ends, views, np.zeros((40, 2)), pixels, np.ones(40))
    assert np.abs(incidence(pairs, asked, q)[0]).max() < 1e-4
    off = replace(pairs, pixels=pixels + np.array([3.0, 4.0]))
    residual, jacobian = incidence(off, asked, q)
    # in px: as far as the pixel is off, up to what a pixel is away from the middle of the image and of the lens
    np.testing.assert_allclose(np.linalg.norm(residual, axis=1), 5.0, rtol=0.2)
    # of rank two: nothing along the ray
    singular = np.linalg.svd(jacobian, compute_uv=False)
    assert (singular[:, 2] < 1e-9 * singular[:, 0]).all()
    scale = np.linalg.norm(residual, axis=1) / np.linalg.norm(_raw(off, scene), axis=1)
    for k in range(body.dof):
        step = 1e-6 * np.eye(body.dof)[k]
        ahead, back = (_raw(replace(off, points=placed(q + way * step)), scene) for way in (1, -1))
        expected = scale[:, None] * (ahead - back) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, k], expected, atol=1e-3)


def _raw(pairs: Correspondences, scene: Scene) -> np.ndarray:
    """X x n - m, one by one."""
    found = []
    for x, v, pixel in zip(pairs.points, pairs.views, pairs.pixels, strict=True):
        camera = scene.rig.cameras[v]
        direction = camera.rays(pixel[None])[0]
        found.append(np.cross(x, direction) - np.cross(camera.centre, direction))
    return np.array(found)


def test_a_pair_counts_as_two_observations_weighted_as_those_of_chamfer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Geman and McClure's: a quarter at half the gate."""
    person = posed("gavrila22", 1)[0]
    body, scene = person.body, Scene((person,), RIGS["narrow"])
    points = body.landmarks_in_world(person.q)[:1]
    pixels = scene.rig.cameras[0].project(points)
    for off_px in (0.0, 10.0):
        pairs = Correspondences(
            points,
            body.part_parameters[:1],
            np.zeros(1, int),
            np.zeros((1, 2)),
            pixels + np.array([off_px, 0.0]),
            np.ones(1),
        )
        monkeypatch.setattr(pluecker, "correspondences", lambda *_, pairs=pairs: pairs)
        asked = Comparison(scene, 0, CpuSynthesis(), None)
        found = PlueckerSimilarity().equations(asked, person.q, 20.0)
        length = np.linalg.norm(incidence(pairs, asked, person.q)[0])
        assert found.total == pytest.approx(2 / (1 + (length / 10) ** 2) ** 2)
        assert found.squares == pytest.approx(found.total / 2 * length**2, abs=1e-9)


def test_it_tracks() -> None:
    simulation = small_simulation(n_frames=3)
    cycle = cycle_for(
        simulation,
        TrueStart(simulation),
        evidence=ContourEvidence(similarity=PlueckerSimilarity()),
        estimation=TwistIcpEstimation(),
    )
    for step in track(simulation.frames(), simulation.scene, cycle):
        assert joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean() < 25
