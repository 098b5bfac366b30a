"""Standard errors of cameras that boards calibrate, against real errors: blur, bent boards, few positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracker.cameras.calibration import report_text
from tracker.cameras.calibration._bundle import Noise, _equations_of, _left_out, adjust, normal_equations
from tracker.cameras.calibration._objects import PARAMETERS
from tracker.cameras.calibration.chessboard import BoardImages, ChessboardCalibration
from tracker.cameras.camera import Camera
from tracker.kernels.rows import BundleUnknowns

SIZE = 640, 480
MATRIX = np.array([[800.8, 0, 322.0], [0, 800.0, 241.0], [0, 0, 1]])
SQUARE_M, NOISE_PX = 0.03, 0.1
PLAN = SQUARE_M * np.stack([*np.meshgrid(np.arange(9.0), np.arange(6.0)), np.zeros((6, 9))], axis=-1).reshape(-1, 3)
CALIBRATION = ChessboardCalibration(square_m=SQUARE_M, sigma_px=NOISE_PX)
CAMERA = Camera("a", SIZE, MATRIX, np.array([-0.1, 0.05, 0, 0, 0]), np.eye(4))


def held(rng, shape):
    """(N, 2) images of a board somewhere, wholly inside the picture."""
    while True:
        turn = Rotation.from_rotvec([*rng.uniform(-0.6, 0.6, 2), rng.uniform(-0.3, 0.3)]).as_matrix()
        away = rng.uniform(0.4, 0.8)
        place = np.array([*rng.uniform(-0.24, 0.24, 2) * away, away])
        pixels = CAMERA.project((shape - PLAN.mean(axis=0)) @ turn.T + place)
        if np.isfinite(pixels).all() and (pixels > 5).all() and (pixels < np.array(SIZE) - 5).all():
            return pixels


def pictures(seed, n_positions, bent_m=0.0, blur_px=0.0):
    """Corners with white noise, on a board bent in some way, in pictures each shifted smoothly in a way of its own."""
    rng = np.random.default_rng(seed)
    x, y = ((PLAN - PLAN.mean(axis=0)) / 0.12)[:, :2].T
    ways = rng.normal(size=3)
    height = bent_m * (ways[0] * x**2 + ways[1] * x * y + ways[2] * y**2)
    shape = PLAN + np.column_stack([0 * x, 0 * x, height])
    seen = {}
    for frame in range(n_positions):
        pixels = held(rng, shape)
        u, v = ((pixels - (320, 240)) / 320).T
        field = np.column_stack([u, v, u * u, u * v, v * v]) @ rng.normal(0, blur_px, (5, 2))
        seen[0, frame] = PLAN, pixels + field + rng.normal(0, NOISE_PX, pixels.shape)
    return BoardImages(("a",), (SIZE,), seen)


@pytest.mark.parametrize(
    ("faults", "grown"),
    [({}, (1.0, 1.2)), ({"blur_px": 0.4}, (1.5, 5)), ({"bent_m": 7e-4}, (1.5, 8))],
    ids=["white noise", "blurred pictures", "bent board"],
)
@pytest.mark.parametrize("n_positions", [7, 20])
def test_standard_errors_are_those_that_errors_have(faults, grown, n_positions):
    """Camera constant and principal point; least squares alone tell 2.5 to 13 times too little where faults are."""
    ratios, inflations, bents = [], [], []
    for seed in range(16):
        adjustment = CALIBRATION.calibrate_images(pictures(seed, n_positions, **faults)).adjustment
        found = adjustment.state.cameras[0, 12:15] - (MATRIX[1, 1], *MATRIX[:2, 2])
        ratios.append(found / adjustment.sigmas[0, [BundleUnknowns.C, BundleUnknowns.CX, BundleUnknowns.CY]])
        inflations.append(adjustment.inflation)
        bents.append(adjustment.bent_m)
    # the mean square of 48 errors, a third of them independent, has a standard deviation of a third
    assert 0.4 < np.mean(np.square(ratios)) < 2.0
    assert grown[0] <= np.median(inflations) < grown[1]
    share = np.mean(np.array(bents) > 0)
    assert share >= 0.9 if "bent_m" in faults else share <= 0.1


def test_a_bent_board_is_named_and_its_height_told():
    result = CALIBRATION.calibrate_images(pictures(3, 13, bent_m=7e-4))
    rng = np.random.default_rng(3)
    ways, x, y = rng.normal(size=3), *((PLAN - PLAN.mean(axis=0)) / 0.12)[:, :2].T
    height = 7e-4 * np.abs(ways[0] * x**2 + ways[1] * x * y + ways[2] * y**2).max()
    assert result.adjustment.bent_m == pytest.approx(height, rel=0.5)
    assert any("corners of the board seem to be up to" in line for line in result.advice)
    assert "from the scatter between the board's positions" in report_text("a", result)


def test_positions_of_which_nearly_all_corners_are_wrong_tell_nothing():
    """A pose fits any three corners: six such positions passed for 36 coordinates without a residual."""
    images, rng = pictures(0, 12), np.random.default_rng(99)
    wrong = {}
    for frame in range(6):
        shape, pixels = images.seen[0, frame]
        chosen = rng.choice(len(shape), 6, replace=False)
        found = pixels[chosen]
        found[2:] += rng.uniform(-80, 80, (4, 2))
        wrong[0, 100 + frame] = shape[chosen], found
    clean = CALIBRATION.calibrate_images(images).adjustment
    adjustment = CALIBRATION.calibrate_images(replace(images, seen={**images.seen, **wrong})).adjustment
    assert adjustment.redundancy == clean.redundancy
    assert adjustment.s0 == pytest.approx(clean.s0)
    np.testing.assert_allclose(adjustment.sigmas[:, 6:], clean.sigmas[:, 6:], rtol=1e-3)


def test_positions_add_up_to_the_whole_and_one_left_out_is_one_adjusted_without():
    adjustment = CALIBRATION.calibrate_images(pictures(0, 12)).adjustment
    state, rows, free = adjustment.state, adjustment.observations, adjustment.free
    weights = adjustment.used / NOISE_PX**2
    no_deformation, n = np.zeros((1, len(rows), 2)), int(free.sum())
    extended = [_equations_of(g, state, rows, weights, no_deformation, free.ravel()) for g in range(12)]
    parts = [(normal[:n, :n], side[:n]) for normal, side in extended]
    counted = rows.counted(adjustment.used, len(state.objects.points))
    whole = normal_equations(state, rows, weights, counted).normal[np.ix_(free.ravel(), free.ravel())]
    np.testing.assert_allclose(sum(normal for normal, _ in parts), whole, rtol=1e-8, atol=1e-8 * whole.max())

    # the exterior is the datum here: a single camera's own place is free, as no picture tells it
    inner = np.flatnonzero([PARAMETERS[k] not in EXTERIOR for k in np.flatnonzero(free[0])])

    def inverse(normal):
        found = np.zeros_like(normal)
        found[np.ix_(inner, inner)] = np.linalg.inv(normal[np.ix_(inner, inner)])
        return found

    normals, sides = (np.stack(column) for column in zip(*parts, strict=True))
    steps = _left_out(normals, sides, inverse)[:, inner]
    interior = free.copy()
    interior[:, :6] = False
    constant = list(np.flatnonzero(free[0])[inner]).index(BundleUnknowns.C)
    for g in (0, 5):
        used = adjustment.used & (state.objects.owners[rows.points] != g)
        without, _ = adjust(replace(state), rows, interior, Noise(NOISE_PX, used=used))
        step = without.cameras[0, 12] - state.cameras[0, 12]
        assert steps[g, constant] == pytest.approx(step, rel=0.1, abs=0.02)


EXTERIOR = PARAMETERS[:6]
