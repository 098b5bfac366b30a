"""What is not known of a fitted body: misfit that lasts, looks that err alike, and sigmas that hold the body's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.recordings import small_simulation
from tracker.acquisition._residuals import Lasting, Rows
from tracker.acquisition.clouds import Look
from tracker.acquisition.fitting import FitSettings, Task, prior_of
from tracker.acquisition.shape_space import ShapePrior, space_of
from tracker.acquisition.variations import Unsure, of_people, telling_bodies, variations_of
from tracker.bodies.body.description import read_description, save_description
from tracker.bodies.body.entries import Variation
from tracker.foundation.errors import ModelError
from tracker.foundation.resources import model_path
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.trajectory import Step

HUMAN = read_description(model_path("human"))
SPACE = space_of(HUMAN, ShapePrior())


def moved_by(vector):
    """The whole body elsewhere in its own frame: as images have it, the root is elsewhere then."""
    return Variation(
        joints=(vector,) * len(HUMAN.segments),
        starts=(vector,) * len(HUMAN.parts),
        ends=(vector,) * len(HUMAN.parts),
        landmarks=(vector,) * len(HUMAN.landmarks),
    )


@pytest.fixture(scope="module")
def step():
    """Somebody who stands before four cameras, found exactly."""
    simulation = small_simulation("walking_on_the_spot", 1)
    body = HUMAN.build()
    person = replace(simulation.scene.persons[0], body=body, q=body.rest())
    scene = replace(simulation.scene, persons=(person,))
    raised = body.rest()
    raised[body.root.shifts] = simulation.scene.persons[0].q[simulation.scene.persons[0].body.root.shifts]
    scene = scene.with_poses((raised,))
    estimate = Estimate(raised, 1e-6 * np.eye(body.dof), None, 0.0, 1)
    return Step(next(iter(simulation.frames())), scene, (estimate,), CpuSynthesis().contours(scene))


def told(step, variations):
    model = HUMAN.model_copy(update={"variations": tuple(variations)})
    return next(iter(telling_bodies([step], {step.scene.persons[0].name: model}))).estimates[0]


def test_a_body_that_may_be_elsewhere_in_its_own_frame_has_an_unsure_root_and_sure_joints(step):
    """The contours stay, so the joints do; the root is known no better than where it is in the body."""
    before, found, body = step.estimates[0], told(step, [moved_by((0.02, 0.0, 0.0))]), step.scene.persons[0].body
    sigmas = np.sqrt(np.diag(found.covariance))
    assert sigmas[body.index("torso_x")] == pytest.approx(0.02, rel=0.02)
    assert sigmas[body.index("torso_y")] < 0.002
    plain = body.landmark_sigmas(before.q, before.covariance)
    np.testing.assert_allclose(found.joint_sigmas_m, plain, atol=0.001)


def knee_behind(metres):
    """Left thigh and shin whose surfaces lie further back at the knee, so that its joint lies further to the front."""
    still, back = (0.0, 0.0, 0.0), (-metres, 0.0, 0.0)
    names = [part.name for part in HUMAN.parts]
    ends = tuple(back if name == "left_thigh" else still for name in names)
    starts = tuple(back if name == "left_shin" else still for name in names)
    return Variation(starts=starts, ends=ends)


def test_where_a_knee_lies_in_its_leg_makes_the_angles_at_it_unsure(step):
    """Contours of thigh and shin stay, so the joint moves: by 20 mm between two parts of 0.5 m."""
    tilt_deg = np.degrees(0.02 / 0.5)
    body = step.scene.persons[0].body
    found = told(step, [knee_behind(0.02)])
    sigma_deg = np.degrees(np.sqrt(np.diag(found.covariance)))
    assert sigma_deg[body.index("left_leg_extension")] == pytest.approx(2 * tilt_deg, abs=0.8)
    assert sigma_deg[body.index("left_leg_elevation")] == pytest.approx(tilt_deg, abs=0.8)
    assert sigma_deg[body.index("right_leg_extension")] < 0.5
    assert found.joint_sigmas_m[body.landmark_names.index("left_knee")] == pytest.approx(0.02, abs=0.004)
    assert found.joint_sigmas_m[body.landmark_names.index("right_knee")] < 0.005


def test_frames_that_an_interrupted_run_has_told_stay_as_they_are(step):
    model = HUMAN.model_copy(update={"variations": (moved_by((0.02, 0.0, 0.0)),)})
    name = step.scene.persons[0].name
    (same,) = telling_bodies([step], {name: model}, {step.frame.index: None})
    assert same is step
    (unmoved,) = telling_bodies([step], {name: HUMAN})
    assert unmoved is step
    lost = replace(step, estimates=(replace(step.estimates[0], status=Status.LOST),))
    (kept,) = telling_bodies([lost], {name: model})
    assert kept.estimates[0].joint_sigmas_m is None


def test_the_ways_kept_hold_nearly_all_that_is_unsure_of_angles(step):
    """A body that was never fitted: all ways in which persons differ, against the few that are kept."""
    few = of_people(SPACE)
    assert 8 <= len(few) <= 32
    every = SPACE.directions * SPACE.sigmas
    rest, n = SPACE.general.rest(), len(SPACE.names)
    alone = variations_of(SPACE, np.zeros(n), SPACE.covariance, (rest,))
    assert few == alone
    found = told(step, few)
    still = HUMAN.model_copy(update={"variations": few})
    assert Unsure.of(still) is not None
    assert every.shape[1] == n
    sigma_deg = np.degrees(np.sqrt(np.diag(found.covariance)))
    for name in ("left_leg_extension", "right_arm_extension"):
        assert 1.5 < sigma_deg[SPACE.general.index(name)] < 8


def test_variations_are_kept_in_the_model_file_and_grow_with_the_body(tmp_path):
    model = HUMAN.model_copy(update={"variations": of_people(SPACE)[:3]})
    save_description(model, tmp_path / "anna.toml", decimals=None)
    read = read_description(tmp_path / "anna.toml")
    assert read.variations == model.variations
    first, larger = model.variations[0], model.scaled(2.0).variations[0]
    np.testing.assert_allclose(larger.joints, 2 * np.array(first.joints))
    assert (larger.radii, larger.taper) == (first.radii, first.taper)


def test_a_variation_of_another_body_is_refused():
    too_many = Variation(joints=((0.0, 0.0, 0.0),) * (len(HUMAN.segments) + 1))
    with pytest.raises(ModelError, match=r"variations\[0\]: joints: 18 entries, expected at most the model's 17"):
        HUMAN.model_copy(update={"variations": (too_many,)}).build()


def rows_of(patches, weights, asks):
    n = len(weights)
    none = np.zeros(n)
    whole = np.zeros(n, dtype=np.int64)
    return Rows(asks @ [1.0, 0.5], asks, none, whole, whole, none > 0, weights, patches)


def test_misfit_that_lasts_is_what_correlated_residuals_are():
    """Against generalized least squares with the whole covariance of the residuals."""
    rng = np.random.default_rng(3)
    share, n_unknowns, looks = 0.4, 3, []
    lasting = Lasting(n_unknowns, share)
    matrix, vector = np.zeros((n_unknowns, n_unknowns)), np.zeros(n_unknowns)
    slopes = rng.normal(size=(1, 2, 2))
    for unknowns in (np.array([0, 1]), np.array([0, 2])):
        asks, weights, patches = rng.normal(size=(6, 2)), rng.uniform(0.2, 1, 6), np.array([0, 0, 1, 1, 1, 2])
        rows = rows_of(patches, weights, asks)
        lasting.add(rows, slopes, unknowns)
        jacobian = np.zeros((6, n_unknowns))
        jacobian[:, unknowns] = asks @ slopes[0]
        matrix += jacobian.T @ (weights[:, None] * jacobian)
        vector += jacobian.T @ (weights * rows.residuals)
        looks.append((jacobian, rows))
    jacobian = np.concatenate([one for one, _ in looks])
    weights, patches, residuals = (
        np.concatenate([getattr(rows, name) for _, rows in looks]) for name in ("weights", "patches", "residuals")
    )
    covariance = np.diag((1 - share) / weights) + share * (patches[:, None] == patches)
    found = lasting.taken_from(matrix, vector)
    np.testing.assert_allclose(found[0], jacobian.T @ np.linalg.solve(covariance, jacobian))
    np.testing.assert_allclose(found[1], jacobian.T @ np.linalg.solve(covariance, residuals))


def test_twelve_looks_are_no_twelve_witnesses_of_what_is_wrong_in_all_alike():
    """An offset of an angle that the looks share may be twice as large as one of a single look, and no smaller."""
    body, n_looks = SPACE.general, 12
    columns = [k * body.dof + np.arange(body.dof) for k in range(n_looks)]
    rig = small_simulation("walking_on_the_spot", 1).scene.rig
    looks = tuple(Look(rig, own, None) for own in columns)
    task = Task(SPACE, looks, CpuSynthesis(), FitSettings(pose_deg=8.0))
    n, poses = len(SPACE.names), np.tile(body.rest(), n_looks)
    matrix, pull = prior_of(task, (np.zeros(n), np.zeros(len(poses))), poses, "form", 2.0)
    assert not pull.any()
    spread = np.linalg.inv(matrix)[n:, n:]

    def mean_deg(name):
        own = [column[body.index(name)] for column in columns]
        return np.degrees(np.sqrt(spread[np.ix_(own, own)].mean()))

    assert mean_deg("left_arm_extension") == pytest.approx(8 * np.sqrt(4 + 1 / 12))
    # ... and where persons are usually like that, not farther than they are
    usual_deg = np.degrees(body.spreads[body.index("left_collar_elevation")])
    both_deg = 1 / np.sqrt(1 / usual_deg**2 + 1 / mean_deg("left_arm_extension") ** 2)
    assert mean_deg("left_collar_elevation") == pytest.approx(both_deg)


def test_who_has_long_thighs_has_a_short_trunk():
    """ANSUR II, of one stature; what it does not tell, and bodies that are no person's, are independent."""

    def correlation(space, one, other):
        k, j = space.names.index(one), space.names.index(other)
        return space.covariance[k, j] / (space.sigmas[k] * space.sigmas[j])

    assert correlation(SPACE, "left_thigh.length", "chest.height") == pytest.approx(-0.74)
    assert correlation(SPACE, "left_hand.length", "left_foot.length") == pytest.approx(0.61)
    assert correlation(SPACE, "left_hand.length", "left_hand.radius_side") == 0
    np.testing.assert_allclose(np.sqrt(np.diag(SPACE.covariance)), SPACE.sigmas)
    assert (np.linalg.eigvalsh(SPACE.covariance) > 0).all()
    dog = space_of(read_description(model_path("quadruped")), ShapePrior())
    np.testing.assert_allclose(dog.covariance, np.diag(dog.sigmas**2))
    sided = space_of(HUMAN, ShapePrior(symmetric=False))
    assert correlation(sided, "left_thigh.length", "chest.height") == pytest.approx(-0.74)
