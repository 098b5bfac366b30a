"""Persons under each other's names are told by the bodies fitted to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import SMALL, TrueStart, cycle_for, small_simulation

from tracker.acquisition.body_fit import fit_bodies, whose
from tracker.acquisition.calibrated_views import ViewSettings
from tracker.acquisition.fitting import FitSettings
from tracker.acquisition.result import stature_of
from tracker.acquisition.shape_space import ShapePrior, space_of
from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.bodies.subject import Subject
from tracker.cameras.frame import Frame
from tracker.foundation.resources import model_path
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.initialization import Stages
from tracker.tracking.start import Start

STATURES_M = 1.62, 1.86
N_FRAMES = 8
QUICK = ViewSettings(frames=4, rounds=1, fit=FitSettings(iterations=8, pose_deg=8.0, pose_m=0.05, rigid_share=0.2))


def tall(stature_m: float, model: str = "human") -> BodyModel:
    return Subject(model=model_path(model), stature_m=stature_m).body()


@pytest.mark.parametrize(
    ("told_m", "fitted_m", "expected"),
    [
        ((1.85, 1.73), (1.76, 1.81), (1, 0)),
        ((1.85, 1.73), (1.86, 1.72), None),
        ((1.85, 1.73), (1.81, 1.77), (1, 0)),
        ((1.85, 1.73), (1.83, 1.75), None),
        ((1.80, 1.79), (1.79, 1.80), None),
        ((1.60, 1.75, 1.90), (1.76, 1.88, 1.61), (2, 0, 1)),
        ((1.60, 1.75, 1.90), (1.61, 1.88, 1.76), (0, 2, 1)),
    ],
)
def test_names_follow_the_statures_fitted(told_m, fitted_m, expected) -> None:
    told = [tall(one) for one in told_m]
    assert whose(told, {k: tall(one) for k, one in enumerate(fitted_m)}) == expected


def test_bodies_of_other_models_and_without_a_fit_stay() -> None:
    told = [tall(1.85), tall(1.6, "gavrila22"), tall(1.7)]
    assert whose(told, {0: tall(1.6), 1: tall(1.85, "gavrila22"), 2: tall(1.7)}) is None
    assert whose(told, {0: tall(1.7)}) is None
    assert whose(told, {0: tall(1.7), 2: tall(1.85)}) == (2, 1, 0)


class Exchanged(TrueStart):
    """Starts each person at the place of the other one."""

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        return super().start(frame, scene, stages).of((1, 0))


@pytest.fixture(scope="module")
def two() -> Simulation:
    """A small and a tall person."""
    made = small_simulation("walking_on_the_spot", n_frames=N_FRAMES, model="human", persons=2, size=SMALL)
    bodies = [tall(stature_m) for stature_m in STATURES_M]
    poses = [q.copy() for q in made.poses]
    for body, one, q in zip(bodies, made.scene.persons, poses, strict=True):
        q[:, body.names.index("torso_z")] *= body.stature_m / one.body.stature_m
    persons = tuple(Person(f"person{k}", body, poses[k][0]) for k, body in enumerate(bodies))
    return replace(made, scene=Scene(persons, made.scene.rig), poses=tuple(poses))


def test_who_begins_under_anothers_name_gets_his_own_back(two: Simulation) -> None:
    spaces = {
        k: space_of(Subject(model=model_path("human"), stature_m=one).description(), ShapePrior())
        for k, one in enumerate(STATURES_M)
    }
    told: list[str] = []
    refined = TwistIcpEstimation()
    cycle = replace(cycle_for(two, Exchanged(two), estimation=refined), progress=lambda line, *_: told.append(line))
    found = fit_bodies(spaces, two.scene, cycle, two.frames, N_FRAMES, QUICK)
    assert any("names are exchanged" in line for line in told)
    for k, person in enumerate(two.scene.persons):
        assert abs(stature_of(found.fits[k].body) - STATURES_M[k]) < 0.02
        away = np.array([step.estimates[k].q for step in found.steps])[:, :3] - two.poses[k][:, :3]
        assert np.linalg.norm(away, axis=1).max() < 0.1, person.name
