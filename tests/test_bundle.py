"""Bundle adjustment: derivatives against differences, elimination against the whole, precision against real errors."""

from __future__ import annotations

import numpy as np
import pytest
from bars import CLEAN, LENGTH_M, all_but_offsets, at_truth, calibration, images_of, recorded
from benchmarks.bars import SIZE, Faults
from scipy.spatial.transform import Rotation

from tracker._native import project_with_slopes
from tracker.cameras.calibration._adjustment import precision
from tracker.cameras.calibration._bundle import Noise, State, adjust, normal_equations, residuals, solved
from tracker.cameras.calibration._objects import (
    GROUPS,
    PARAMETERS,
    Bars,
    Boards,
    MeasuredPoints,
    camera_of,
    moved,
    rigid_motions,
    state_of,
)
from tracker.cameras.calibration._self_calibration import self_calibrated
from tracker.kernels.adjustment import N_OBJECT
from tracker.kernels.rows import BundleCameraRow, BundleUnknowns


def some_state(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(rng.normal(0, 0.3, 3)).as_matrix().ravel()
    interior = [900 + 50 * rng.normal(), 380, 290, 0.01 * rng.normal(), 0.01 * rng.normal()]
    return np.concatenate([turn, rng.normal(0, 0.2, 3) - (0, 0, 3), interior, rng.normal(0, 0.05, 8), [rng.normal()]])


@pytest.mark.parametrize("seed", range(4))
def test_slopes_are_differences_and_the_projection_is_the_camera_s(seed):
    state, rng = some_state(seed), np.random.default_rng(seed)
    camera = camera_of(state, "a", SIZE)
    points = rng.uniform(-0.5, 0.5, (20, 3))
    # within the reach of the lens: beyond, where it turns back, a camera shows nothing
    point, velocity = points[np.isfinite(camera.project(points)).all(axis=1)][0], rng.normal(0, 5, 2)
    by_camera, by_point = np.empty((2, BundleUnknowns.N_UNKNOWNS)), np.empty((2, 3))

    def image(row, at):
        return np.array(
            project_with_slopes(row, at, velocity, np.empty((2, BundleUnknowns.N_UNKNOWNS)), np.empty((2, 3)))[:2]
        )

    found = np.array(project_with_slopes(state, point, velocity, by_camera, by_point)[:2])
    np.testing.assert_allclose(found, camera.project(point) + state[BundleCameraRow.DELAY] * velocity, rtol=1e-12)
    np.testing.assert_allclose(state_of(camera)[: BundleCameraRow.DELAY], state[: BundleCameraRow.DELAY], atol=1e-12)
    for k in range(BundleUnknowns.N_UNKNOWNS):
        step = np.zeros((1, BundleUnknowns.N_UNKNOWNS))
        step[0, k] = 1e-6
        differences = (image(moved(state[None], step)[0], point) - image(moved(state[None], -step)[0], point)) / 2e-6
        np.testing.assert_allclose(by_camera[:, k], differences, rtol=1e-5, atol=1e-5, err_msg=PARAMETERS[k])
    for k, step in enumerate(1e-6 * np.eye(3)):
        differences = (image(state, point + step) - image(state, point - step)) / 2e-6
        np.testing.assert_allclose(by_point[:, k], differences, rtol=1e-6, atol=1e-5)


def test_a_point_behind_the_camera_has_no_image():
    row = some_state(0)
    behind = row[9:12] - row[6:9]
    slopes = np.ones((2, BundleUnknowns.N_UNKNOWNS)), np.ones((2, 3))
    assert not project_with_slopes(row, behind, np.zeros(2), *slopes)[2]
    assert not slopes[0].any()


def boards() -> Boards:
    rng = np.random.default_rng(1)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(rng.normal(size=(3, 3))).as_matrix()
    poses[:, :3, 3] = rng.normal(size=(3, 3))
    return Boards(np.tile(rng.normal(size=(6, 3)), (3, 1)), np.repeat(np.arange(3), 6), poses)


@pytest.mark.parametrize(
    "objects",
    [
        Bars(np.random.default_rng(0).normal(size=(3, 2, 3)), 1.3, 0.01),
        boards(),
        MeasuredPoints(np.random.default_rng(0).normal(size=(4, 3)), np.random.default_rng(1).normal(size=(4, 3)), 0.1),
    ],
)
def test_objects_move_and_are_conditioned_as_they_say(objects):
    """Slopes and conditions are the differences of points and of residuals."""
    counted = np.full(len(objects.points), 3)
    normal, side, _ = objects.conditions(counted)
    n_objects = len(normal)
    gradient = np.zeros((n_objects, N_OBJECT))
    for g in range(n_objects):
        for k in range(N_OBJECT):
            step = np.zeros((n_objects, N_OBJECT))
            step[g, k] = 1e-6
            ahead, back = objects.moved(step), objects.moved(-step)
            change = (ahead.points - back.points) / 2e-6
            np.testing.assert_allclose(
                change, np.where((objects.owners == g)[:, None], objects.slopes[:, :, k], 0), atol=1e-8
            )
            cost = [float(r @ r) / 2 for r in (ahead.conditions(counted)[2], back.conditions(counted)[2])]
            gradient[g, k] = (cost[0] - cost[1]) / 2e-6
    np.testing.assert_allclose(side, -gradient, atol=1e-4 * max(1.0, np.abs(side).max()))
    np.testing.assert_allclose(normal, np.swapaxes(normal, 1, 2))


def dense(state: State, observations, weights) -> tuple[np.ndarray, np.ndarray]:
    """The twin: normal equations of all unknowns together, from differences."""
    n_cameras, n_objects = len(state.cameras), len(state.objects.ends)
    n = n_cameras * BundleUnknowns.N_UNKNOWNS + n_objects * N_OBJECT
    counted = np.full(2 * n_objects, 4)

    def errors(step: np.ndarray) -> np.ndarray:
        cameras, objects = step[: n_cameras * BundleUnknowns.N_UNKNOWNS], step[n_cameras * BundleUnknowns.N_UNKNOWNS :]
        tried = State(moved(state.cameras, cameras), state.objects.moved(objects.reshape(-1, N_OBJECT)))
        images = residuals(tried, observations) * np.sqrt(weights)[:, None]
        return np.concatenate([images.ravel(), tried.objects.conditions(counted)[2]])

    h = 1e-6
    jacobian = np.column_stack([(errors(step) - errors(-step)) / (2 * h) for step in h * np.eye(n)])
    return jacobian, errors(np.zeros(n))


def test_elimination_bar_by_bar_is_the_whole_system_solved():
    recording = recorded(n_bars=8)
    state, observations = at_truth(recording)
    weights = np.random.default_rng(0).uniform(0.5, 2.0, len(observations))
    free = all_but_offsets(4)
    free[0, :6] = False  # a datum
    free[:, [9, 10, 12, 15]] = False  # eight bars do not determine all
    equations = normal_equations(state, observations, weights, np.full(16, 4))
    step = solved(equations, free.ravel())
    assert step is not None
    jacobian, errors = dense(state, observations, weights)
    columns = np.concatenate([free.ravel(), np.ones(8 * N_OBJECT, dtype=bool)])
    wanted = np.linalg.lstsq(jacobian[:, columns], -errors, rcond=None)[0]
    found = np.concatenate([step[free.ravel()], equations.object_steps(step).ravel()])
    scale = np.sqrt(np.diag(np.linalg.inv(jacobian[:, columns].T @ jacobian[:, columns])))
    np.testing.assert_allclose(found / scale, wanted / scale, atol=2e-3)


def test_precision_is_that_of_the_whole_system():
    """The covariance of distances between cameras, which no datum changes, against the pseudo-inverse of everything."""
    recording = recorded(n_bars=8)
    state, observations = at_truth(recording)
    free = all_but_offsets(4)
    free[:, [9, 10, 12, 15]] = False
    used = np.ones(len(observations), dtype=bool)
    covariance, s0, _ = precision(state, observations, used, free, 0.1)
    jacobian, _ = dense(state, observations, np.full(len(observations), 100.0))
    columns = np.concatenate([free.ravel(), np.ones(8 * N_OBJECT, dtype=bool)])
    scale = 1 / np.linalg.norm(jacobian[:, columns], axis=0)
    whole = np.linalg.pinv((jacobian[:, columns] * scale), rcond=1e-9)
    whole = s0**2 * (scale[:, None] * (whole @ whole.T) * scale)
    n = free.sum()
    reduced = covariance[np.ix_(free.ravel(), free.ravel())]
    interior = np.flatnonzero(np.tile(np.arange(BundleUnknowns.N_UNKNOWNS) >= 6, 4)[free.ravel()])
    np.testing.assert_allclose(np.diag(reduced)[interior], np.diag(whole[:n, :n])[interior], rtol=1e-2)


def test_moving_the_whole_rig_changes_no_image():
    state, observations = at_truth(recorded(n_bars=4))
    motions = rigid_motions(state.cameras)
    before = residuals(state, observations)
    for k, motion in enumerate(1e-6 * motions.T):
        w, t = np.zeros(3), np.zeros(3)
        (w if k < 3 else t)[k % 3] = 1e-6
        ends = state.objects.ends + np.cross(w, state.objects.ends) + t
        after = residuals(State(moved(state.cameras, motion), Bars(ends, LENGTH_M, 1e-4)), observations)
        np.testing.assert_allclose(after, before, atol=1e-6)


@pytest.mark.parametrize("around", [True, False])
def test_standard_errors_are_those_found(around):
    ratios, noises = [], []
    for seed in range(8):
        recording = recorded(seed, 80, Faults(0.1, 0.03, 0.03), around)
        start, observations = at_truth(recording)
        views = [(camera.name, camera.size) for camera in recording.rig.cameras]
        adjustment = self_calibrated(start, observations, all_but_offsets(len(views)), 0.1, views)
        error = adjustment.state.cameras[:, 12:22] - start.cameras[:, 12:22]
        ratios.append(error / np.where(adjustment.free, adjustment.sigmas, np.inf)[:, 6:16])
        noises.append(adjustment.s0)
    assert 0.8 < np.sqrt(np.mean(np.square(ratios))) < 1.25
    assert 0.95 < np.mean(noises) < 1.05


def test_gross_errors_and_swapped_ends_are_found():
    recording = recorded(3, 120, Faults(0.1, 0.05, 0.05))
    adjustment, chosen = calibration().adjusted(images_of(recording))
    observations = adjustment.observations
    bars, ends = np.flatnonzero(chosen)[observations.points // 2], observations.points % 2
    exchanged = np.zeros_like(recording.swapped)
    exchanged[observations.views[adjustment.exchanged], bars[adjustment.exchanged]] = True
    # two of four views swapped look like the other two
    assert (exchanged & ~recording.swapped).sum() < 0.15 * recording.swapped.sum()
    # those whose other images are wrong as well cannot be told
    assert (exchanged & recording.swapped).sum() > 0.75 * recording.swapped.sum()
    wrong = recording.outliers[observations.views, bars, np.where(adjustment.exchanged, 1 - ends, ends)]
    assert (wrong & adjustment.used).sum() < 0.05 * wrong.sum()
    assert (~wrong & ~adjustment.used).sum() < 0.05 * len(wrong)


def test_what_cannot_be_determined_is_named_and_held():
    """Targets in the middle of the images tell nothing of the distortion at their borders."""
    recording = recorded(5, 150, CLEAN)
    pixels = np.array(recording.pixels)
    central = np.abs(pixels[0] - (384, 288)).max(axis=-1) < 110
    pixels[0][~central] = np.nan
    images = images_of(recording)
    adjustment, _ = calibration().adjusted(type(images)(images.names, images.sizes, images.frames, pixels))
    mine = [held for held in adjustment.held if held.camera == recording.rig.names[0]]
    assert any(held.parameter.startswith("radial") for held in mine)
    for held in mine:
        assert held.partner in str(held)
        assert held.sigma > held.limit
        assert not adjustment.free[0, PARAMETERS.index(held.parameter)]
    assert adjustment.sigmas[0, GROUPS["radial"][0]] >= 0


def test_robust_weights_do_not_change_what_fits():
    state, observations = at_truth(recorded(6, 40))
    free = all_but_offsets(4)
    free[:, [12, 15]] = False
    plain, _ = adjust(state, observations, free, Noise(0.1))
    robust, _ = adjust(state, observations, free, Noise(0.1, 50.0))
    np.testing.assert_allclose(residuals(plain, observations), residuals(robust, observations), atol=1e-3)


def test_equal_residuals_to_gtsam():
    """An independent adjustment of the same model: k1 k2 p1 p2, bar lengths as range factors."""
    gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed (pip install gtsam): the oracle is left out")
    recording = recorded(7, 40)
    start, observations = at_truth(recording)
    free = all_but_offsets(4)
    free[:, 15] = False
    cameras = start.cameras.copy()
    cameras[:, 21] = 0.0
    state, _ = adjust(State(cameras, start.objects), observations, free, Noise(0.1), 1e-12)
    ours = residuals(state, observations)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise, length = gtsam.noiseModel.Isotropic.Sigma(2, 0.1), gtsam.noiseModel.Isotropic.Sigma(1, 1e-4)
    camera_key, lens_key, point_key = gtsam.symbol_shorthand.X, gtsam.symbol_shorthand.K, gtsam.symbol_shorthand.L
    for v, row in enumerate(cameras):
        pose = gtsam.Pose3(gtsam.Rot3(row[:9].reshape(3, 3).T), row[9:12])
        c, x, y, affinity, shear, k1, k2, p1, p2 = row[12:21]
        values.insert(camera_key(v), pose)
        values.insert(lens_key(v), gtsam.Cal3DS2(c * (1 + affinity), c, c * shear, x, y, k1, k2, p1, p2))
    graph.add(
        gtsam.PriorFactorPose3(camera_key(0), values.atPose3(camera_key(0)), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6))
    )
    for p, point in enumerate(start.objects.points):
        values.insert(point_key(p), point)
    for view, p, pixel in zip(observations.views, observations.points, observations.pixels, strict=True):
        keys = camera_key(int(view)), point_key(int(p)), lens_key(int(view))
        graph.add(gtsam.GeneralSFMFactor2Cal3DS2(pixel, noise, *keys))
    for g in range(len(recording.ends)):
        graph.add(gtsam.RangeFactor3(point_key(2 * g), point_key(2 * g + 1), LENGTH_M, length))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    parameters.setMaxIterations(200)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    theirs = []
    for view, p, pixel in zip(observations.views, observations.points, observations.pixels, strict=True):
        lens = result.atCal3DS2(lens_key(int(view)))
        camera = gtsam.PinholeCameraCal3DS2(result.atPose3(camera_key(int(view))), lens)
        theirs.append(pixel - camera.project(result.atPoint3(point_key(int(p)))))
    np.testing.assert_allclose(ours, np.array(theirs), atol=5e-3)
    assert np.sqrt(np.mean(ours**2)) == pytest.approx(np.sqrt(np.mean(np.square(theirs))), rel=1e-4)
