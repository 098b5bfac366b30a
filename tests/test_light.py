"""Light that changes over a picture: kernels against plain twins, exact fields, silhouettes of known persons."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from recordings import small_simulation

from tracker.foundation.arrays import Array, Image, Mask
from tracker.images.operations.appearance import Light, light_of, sparse
from tracker.images.plate import Plate, changed, threshold_level
from tracker.images.reading.video import open_clip
from tracker.kernels.changes import DARK, block_ratios, connected_blocks, relight, smooth_surface
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation


def picture(seed: int, size: tuple[int, int] = (96, 144)) -> Image:
    """Coloured texture (h, w, 3)."""
    rng = np.random.default_rng(seed)
    grain = cv2.GaussianBlur(rng.standard_normal((*size, 3)).astype(np.float32), (0, 0), 2.0)
    textured: Image = np.clip(110 + 160 * grain, 10, 240).astype(np.uint8)
    return textured


def fields(size: tuple[int, int]) -> dict[str, Array]:
    """Ratios of the light (h, w, 3) of many kinds."""
    y, x = np.mgrid[0 : size[0], 0 : size[1]] / max(size)
    one = np.ones((*size, 3))
    spot = np.exp(-((x - 0.4) ** 2 + (y - 0.4) ** 2) / (2 * 0.25**2))
    return {
        "dimmed": 0.6 * one,
        "brighter": 1.3 * one,
        "one side": one * (0.55 + 0.6 * x)[..., None],
        "a lamp off": one * (1 - 0.45 * spot)[..., None],
        "tinted": one * np.array([0.85, 1.0, 1.15]),
    }


FIELDS = tuple(fields((2, 2)))


def relit(image: Image, field: Array) -> Image:
    seen: Image = np.clip(np.round(image * field), 0, 255).astype(np.uint8)
    return seen


def overlap(found: Mask, truth: Mask) -> float:
    return float((found & truth).sum() / (found | truth).sum())


@pytest.mark.parametrize(("size", "step"), [(6, 1), (6, 2), (7, 3)])
def test_block_ratios_are_medians_of_logarithms(size: int, step: int) -> None:
    now, plate = picture(1), picture(2)
    logs = np.log((now + DARK) / (plate + DARK))
    found = block_ratios(now, plate, size, step)
    assert found.shape == (96 // size, 144 // size, 3)
    for row, column in ((0, 0), (3, 5), (96 // size - 1, 144 // size - 1)):
        block = logs[row * size : (row + 1) * size : step, column * size : (column + 1) * size : step].reshape(-1, 3)
        np.testing.assert_allclose(found[row, column], np.median(block, axis=0), atol=1e-6)


@pytest.mark.parametrize("stride", [1, 2])
def test_the_surface_is_that_of_most_blocks(stride: int) -> None:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[-1:1:18j, -1:1:30j]
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    truth = terms @ rng.normal(0, 0.2, (6, 3))
    others = truth.copy()
    others[4:16, 8:20] += rng.uniform(0.3, 1.0, (12, 12, 1))
    found = smooth_surface(others + rng.normal(0, 0.01, truth.shape), 0.03, 20, stride)
    # A quarter of the blocks shows something else on one side: Cauchy's weight of a block 10 halves away is 1 %.
    assert np.abs(found - truth).max() < 0.05
    exact = smooth_surface(truth, 0.03, 8, stride)
    np.testing.assert_allclose(exact, truth, atol=1e-5)


def plain_surface(ratios: Array, least: float, n_steps: int, stride: int) -> Array:
    """The twin of the surface: weighted normal equations by numpy."""
    y, x = ((2 * np.arange(n) + 1) / n - 1 for n in ratios.shape[:2])
    y, x = np.meshgrid(y, x, indexing="ij")
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    taken, values = terms[::stride, ::stride].reshape(-1, 6), ratios[::stride, ::stride].reshape(-1, 3)
    factors = np.zeros((6, 3))
    factors[0] = np.median(values, axis=0)
    for _ in range(n_steps):
        off = np.abs(values - taken @ factors).max(axis=1)
        weighted = (taken / (1 + (off / max(np.median(off), least)) ** 2)[:, None]).T
        factors = np.linalg.solve(weighted @ taken + 1e-6 * np.eye(6), weighted @ values)
    surface: Array = terms @ factors
    return surface


@pytest.mark.parametrize(("size", "stride"), [((3, 3), 1), ((7, 10), 1), ((17, 30), 2), ((1, 5), 1)])
def test_the_surface_equals_its_numpy_twin(size: tuple[int, int], stride: int) -> None:
    ratios = np.random.default_rng(8).normal(0, 0.3, (*size, 3))
    np.testing.assert_allclose(
        smooth_surface(ratios, 0.03, 8, stride), plain_surface(ratios, 0.03, 8, stride), atol=1e-9
    )


def test_blocks_are_connected_as_by_a_plain_search() -> None:
    departures = np.random.default_rng(9).normal(0, 0.12, (18, 25, 3))
    most = 0.2
    reached = np.abs(departures).max(axis=2) < most
    waiting = list(zip(*np.nonzero(reached), strict=True))
    while waiting:
        y, x = waiting.pop()
        for v, u in ((y, x + 1), (y, x - 1), (y + 1, x), (y - 1, x)):
            inside = 0 <= v < 18 and 0 <= u < 25
            if inside and not reached[v, u] and np.abs(departures[v, u] - departures[y, x]).max() < most:
                reached[v, u] = True
                waiting.append((v, u))
    assert 0.2 < (np.abs(departures).max(axis=2) < most).mean() < reached.mean() < 1
    np.testing.assert_array_equal(connected_blocks(departures, most), reached)


@pytest.mark.parametrize(("origin", "spacing"), [((0, 0), 1), ((-6, 40), 1), ((0, 0), 4)])
def test_relit_parts_are_the_bilinear_gain_of_the_blocks(origin: tuple[int, int], spacing: int) -> None:
    plate, gains = picture(4), np.random.default_rng(5).uniform(0.5, 1.5, (4, 6, 3)).astype(np.float32)
    part = plate[:50, :70]
    lit = np.empty(part.shape, dtype=np.uint8)
    relight(np.ascontiguousarray(part), gains, 24.0, (*origin, spacing), lit)
    nodes = (np.arange(6) + 0.5) * 24 - 0.5
    for y, x in ((0, 0), (13, 29), (49, 69)):
        at_x, at_y = origin[0] + spacing * x, origin[1] + spacing * y
        for c in range(3):
            rows = [np.interp(at_x, nodes, gains[k, :, c]) for k in range(4)]
            gain = np.interp(at_y, nodes[:4], rows)
            assert abs(float(lit[y, x, c]) - np.clip((part[y, x, c] + DARK) * gain - DARK, 0, 255)) <= 0.51
    np.testing.assert_array_equal(Light(np.ones((4, 6, 3), np.float32), 24).on(part, origin, spacing), part)


@pytest.mark.parametrize("kind", FIELDS)
@pytest.mark.parametrize("share", [0.0, 0.25])
def test_the_light_is_found_whoever_stands_in_it(kind: str, share: float) -> None:
    plate = picture(6, (480, 640))
    field = fields((480, 640))[kind]
    image = relit(plate, field)
    noisy = np.clip(image + np.random.default_rng(7).normal(0, 3, image.shape), 0, 255).astype(np.uint8)
    width = round(640 * share)
    noisy[:, 200 : 200 + width] = (30, 40, 120)
    light = light_of(sparse(noisy), sparse(plate))
    assert light is not None
    off = np.abs(light.on(plate).astype(float) - image).max(axis=2)
    free = np.ones(off.shape, dtype=np.bool_)
    free[:, 200 : 200 + width] = False
    # The noise of the medians; a lamp's spot is flattened a little by the median filter, and bridged behind a person.
    assert np.percentile(off[free], 95) < (10 if kind == "a lamp off" else 5)
    assert np.percentile(off, 95) < (20 if kind == "a lamp off" else 7)


def test_small_pictures_have_no_light_of_their_own() -> None:
    assert light_of(sparse(picture(1, (60, 300))), sparse(picture(2, (60, 300)))) is None


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("arm_swing", n_frames=1, size=(720, 576))


@pytest.mark.parametrize("kind", FIELDS)
def test_silhouettes_are_found_in_changed_light(
    kind: str, simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = next(simulation.frames())
    scene = simulation.scene.with_poses(tuple(poses[0] for poses in simulation.poses))
    truths = CpuSynthesis().silhouettes(scene)
    before, after, same = [], [], []
    for image, plate, truth in zip(frame.images, simulation.plates, truths, strict=True):
        assert image is not None
        other = relit(image, fields(image.shape[:2])[kind])
        after.append(overlap(changed(other, plate).foreground, truth))
        same.append(overlap(changed(image, plate).foreground, truth))
        assert threshold_level(other, plate) < 40
        with monkeypatch.context() as without:
            without.setattr("tracker.images.plate.light_of", lambda now, plate: None)
            before.append(overlap(changed(other, plate).foreground, truth))
    assert np.mean(after) > np.mean(same) - 0.04
    assert np.mean(before) < np.mean(same) - 0.2


@pytest.mark.parametrize("kind", FIELDS)
def test_a_rendered_person_is_found_in_changed_light(kind: str, data: Callable[[str], Path]) -> None:
    folder = data("room/D-TwoElbowRot")
    image = open_clip(folder / "FRONT.mp4", "FRONT")[2].read(10)
    plate = Plate(cv2.imread(str(folder / "background" / "FRONT.png")))
    mask = cv2.imread(str(sorted((folder / "masks" / "FRONT").iterdir())[10]), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    found = changed(relit(image, fields(image.shape[:2])[kind]), plate).foreground
    assert overlap(found, mask > 0) > 0.9
