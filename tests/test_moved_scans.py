"""Recordings made of scans and motion files: skins are drawn where synthesis has them, limbs point as they should."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.test_skins import meshed, smooth
from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.foundation.resources import model_path
from tracker.images.plate import Plate
from tracker.results.recognition import JOINTS
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.movements import poses_of
from tracker.synthesis.simulation.rendering import draw_persons, mesh_of
from tracker.synthesis.simulation.room import background_plates, default_rig
from tracker.synthesis.simulation.sequence import Recipe, Simulation, fill_folder

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))


@pytest.mark.parametrize("blend", [False, True])
def test_skins_are_drawn_where_their_silhouettes_are(blend: bool) -> None:
    """Both rasterize, but blend, place and project points by code of their own."""
    body = load_body(model_path("gavrila22"))
    body = smooth(meshed(body)) if blend else meshed(body)
    person = Person("one", body, poses_of("squat", body, np.array([0.9]), 20.0)[0])
    scene = Scene((person,), default_rig((360, 288)))
    silhouettes = CpuSynthesis().silhouettes(scene)
    for plate, camera, silhouette in zip(background_plates(scene.rig), scene.rig.cameras, silhouettes, strict=True):
        _, mask = draw_persons(plate, camera, scene, (mesh_of(person),))
        assert np.count_nonzero(mask & silhouette) / np.count_nonzero(mask | silhouette) > 0.95


def test_a_rigid_skin_of_the_parts_wears_what_they_wear() -> None:
    body = load_body(model_path("gavrila22"))
    person = Person("one", body, body.rest())
    scene = Scene((person,), default_rig((360, 288)))
    plate, camera = background_plates(scene.rig)[0], scene.rig.cameras[0]
    skinned = replace(person, body=meshed(body, 25, 36))
    (bare, shown), (dressed, mask) = (
        draw_persons(plate, camera, replace(scene, persons=(one,)), (mesh_of(one),)) for one in (person, skinned)
    )
    assert np.count_nonzero(shown & mask) / np.count_nonzero(shown | mask) > 0.95
    apart = np.abs(bare.astype(int) - dressed).max(axis=2)[shown & mask]
    assert np.percentile(apart, 90) < 12


def test_a_simulated_recording_keeps_the_skin_of_its_model(tmp_path: Path) -> None:
    """Its model file was copied without the files of the skin before, and could not be loaded."""
    from tests.test_skin_files import written

    model = written(tmp_path / "from", {"surface": "post.ply", "weights": "post.npz"})
    body = load_body(model)
    rig = default_rig((160, 128))
    recipe = Recipe(model=str(model), seconds=0.08, rig=rig)
    plates = tuple(Plate(picture) for picture in background_plates(rig))
    poses = np.zeros((2, body.dof))
    simulation = Simulation(recipe, Scene((Person("post", body, poses[0]),), rig), (poses,), plates)
    (tmp_path / "to").mkdir()
    fill_folder(simulation, tmp_path / "to", tmp_path / "to" / "config.toml")
    kept = load_body(tmp_path / "to" / "model.toml")
    assert kept.skin is not None
    assert body.skin is not None
    np.testing.assert_allclose(kept.skin.points, body.skin.points, atol=1e-6)


def test_a_movement_of_another_body_is_done_again() -> None:
    """What `human` does, told by its joint centres alone, gavrila22's limbs do within a few degrees."""
    from benchmarks.motion_files import MotionFile
    from benchmarks.moved_scans import directions_of, poses_like

    giver, body = (load_body(model_path(name)) for name in ("human", "gavrila22"))
    times = np.arange(26) / 25.0
    truth = poses_of("walking_on_the_spot", giver, times, heading_deg=70.0)
    marks = [giver.landmark_names.index(name) for name in JOINTS]
    joints = giver.landmarks_in_world(truth)[:, marks]
    found = poses_like(MotionFile(times, joints), body, 25.0)
    assert len(found) == 25
    own = body.landmarks_in_world(found)[:, [body.landmark_names.index(name) for name in JOINTS]]
    cosines = (directions_of(own) * directions_of(joints[:25])).sum(axis=-1)
    assert np.degrees(np.arccos(cosines.min())) < 8
    assert ((found >= body.limits[:, 0]) & (found <= body.limits[:, 1])).all()
    assert np.abs(np.diff(found[:, body.rotates], axis=0)).max() < np.radians(25)
