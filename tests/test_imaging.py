"""Edges: step edges at known places and with known noise, segments of known shapes, chamfer images."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from tracker.foundation.arrays import Array, Image, Mask
from tracker.images.operations.edges import EdgeSegments, canny, chamfer_image, gradient, segment_edges

RULE = (4, float(np.radians(20.0)), 8)
DARK, BRIGHT = 60.0, 180.0
Region = Callable[[Array, Array], Mask]


def picture(inside: Region, size: int = 160, n: int = 8) -> Array:
    """Grey image of a bright region; a pixel is bright by the share of its square that the region covers."""
    steps = (np.arange(n) + 0.5) / n - 0.5
    places = (np.arange(size)[:, None] + steps).ravel()
    covered = inside(places[None, :], places[:, None]).reshape(size, n, size, n)
    grey: Array = DARK + (BRIGHT - DARK) * covered.mean(axis=(1, 3))
    return grey


def digitized(grey: Array, noise: float = 0.0, seed: int = 0) -> Image:
    noisy = grey + noise * np.random.default_rng(seed).standard_normal(grey.shape)
    image: Image = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
    return image


def edges_of(image: Image, sigma_px: float = 1.0) -> EdgeSegments:
    slopes = gradient(image, sigma_px)
    return segment_edges(canny(slopes, 3.0, 7.0), slopes, RULE)


def normal_at(degrees: float) -> Array:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


def half_plane(degrees: float, offset: float) -> tuple[Array, Region]:
    """Normal of a straight edge, towards the bright side, and the image it makes; n . p = offset on the edge."""
    nx, ny = normal = normal_at(degrees)
    return normal, lambda x, y: nx * x + ny * y > offset


def disc(x0: float, y0: float, radius: float) -> Region:
    return lambda x, y: np.hypot(x - x0, y - y0) < radius


DEGREES = (0.0, 10.0, 22.0, 30.0, 45.0, 68.0, 90.0, 137.0, 180.0, 200.0, 270.0, 333.0)


@pytest.mark.parametrize("degrees", DEGREES)
def test_a_step_edge_is_found_where_it_is_and_points_to_the_brighter_side(degrees: float) -> None:
    # The worst systematic errors of a parabola through three slopes are some hundredths of a pixel.
    residuals, turns = [], []
    for fraction in (-0.4, -0.2, 0.0, 0.25, 0.45):
        offset = float(normal_at(degrees) @ (80, 80)) + fraction
        normal, region = half_plane(degrees, offset)
        found = edges_of(digitized(picture(region)))
        central = (abs(found.points - 80) < 60).all(axis=1)
        residuals.append(found.points[central] @ normal - offset)
        turns.append(found.directions[central] @ normal)
        assert len(residuals[-1]) > 115
        assert abs(residuals[-1].mean()) < 0.06
    assert np.sqrt((np.concatenate(residuals) ** 2).mean()) < 0.05
    assert np.concatenate(turns).min() > np.cos(np.radians(3))


@pytest.mark.parametrize("noise", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("across", [0, 1])
def test_noise_moves_edges_as_far_as_the_filters_predict(noise: float, across: int) -> None:
    # The vertex of the parabola is (before - after) / (2 curvature): its deviation is that of the difference of
    # two slopes, found from the filters' response to one pixel, over the curvature of the clean slope.
    impulse = np.zeros((21, 21), dtype=np.float32)
    impulse[10, 10] = 1
    response = cv2.Sobel(cv2.GaussianBlur(impulse, (0, 0), 1.0), cv2.CV_32F, 1, 0) / 8
    difference = np.roll(response, 1, axis=1) - np.roll(response, -1, axis=1)
    clean = picture(half_plane(0.0, 80.0)[1])
    slope = gradient(digitized(clean), 1.0).slopes[80, 79:82, 0]
    rounding = np.sqrt(1 / 12)
    deviation = np.hypot(noise, rounding) * np.sqrt((difference**2).sum())
    predicted = deviation / (2 * abs(slope[0] - 2 * slope[1] + slope[2]))
    residuals = []
    for seed in range(8):
        image = digitized(clean, noise, seed)
        found = edges_of(image if across == 0 else np.ascontiguousarray(image.T))
        central = (abs(found.points - 80) < 70).all(axis=1)
        residuals.append(found.points[central, across] - 80)
    rms = float(np.sqrt((np.concatenate(residuals) ** 2).mean()))
    # About 250 independent values (the smoothing correlates neighbours): their deviation is known to 5 %.
    assert 0.8 * predicted < rms < 1.25 * predicted
    assert abs(np.concatenate(residuals).mean()) < 4 * predicted / np.sqrt(250)


@pytest.mark.parametrize("sigma_px", [0.0, 1.0, 2.5])
def test_the_gradient_of_a_ramp_is_its_slope(sigma_px: float) -> None:
    x, y = np.meshgrid(np.arange(40), np.arange(40))
    ramp = (10 + 3 * x + 2 * y).astype(np.uint8)
    inner = gradient(ramp, sigma_px).slopes[8:-8, 8:-8]
    np.testing.assert_allclose(inner, np.broadcast_to([3.0, 2.0], inner.shape), atol=0.01)


def test_the_gradient_of_a_colour_image_is_that_of_its_strongest_channel() -> None:
    image = np.random.default_rng(2).integers(0, 256, (30, 40, 3), dtype=np.uint8)
    each = np.stack([gradient(np.ascontiguousarray(image[..., c]), 1.0).slopes for c in range(3)])
    strongest = np.abs(each).sum(axis=-1).argmax(axis=0)
    expected = np.take_along_axis(each, strongest[None, ..., None], axis=0)[0]
    found = gradient(image, 1.0).slopes
    tied = np.abs(np.abs(each).sum(axis=-1) - np.abs(found).sum(axis=-1)) < 1e-6
    assert (np.abs(found).sum(axis=-1) == np.abs(expected).sum(axis=-1)).all()
    alone = tied.sum(axis=0) == 1
    assert alone.mean() > 0.9
    np.testing.assert_array_equal(found[alone], expected[alone])


@pytest.mark.parametrize("size", [(2, 2), (2, 9), (9, 2), (3, 3), (31, 70)])
@pytest.mark.parametrize("darkest", [0, 250])
def test_strongest_slopes_equal_their_numpy_twin_to_the_border(size: tuple[int, int], darkest: int) -> None:
    # Few grey levels make many ties, which the first channel wins.
    image = np.random.default_rng(3).integers(darkest, 256, (*size, 3), dtype=np.uint8)
    each = np.stack([cv2.Sobel(image, cv2.CV_16S, *order) for order in ((1, 0), (0, 1))])
    strongest = np.abs(each).sum(axis=0).argmax(axis=-1)
    dx, dy = np.take_along_axis(each, strongest[None, ..., None], axis=-1)[..., 0]
    found = gradient(image, 0.0)
    np.testing.assert_array_equal(found.dx, dx)
    np.testing.assert_array_equal(found.dy, dy)


def test_edge_thresholds_are_slopes_in_grey_levels_per_pixel() -> None:
    slopes = gradient(digitized(picture(half_plane(0.0, 80.0)[1])), 1.0)
    peak = float(np.abs(slopes.slopes).max())
    assert np.count_nonzero(canny(slopes, 1.0, 1.02 * peak)) == 0
    edges = canny(slopes, 1.0, 0.98 * peak)
    assert np.count_nonzero(edges) >= 158
    assert set(np.flatnonzero(edges.any(axis=0))) <= {79, 80, 81}


@pytest.mark.parametrize("radius", [10, 15, 25, 35])
def test_a_circle_is_one_segment_or_two(radius: int) -> None:
    # Pixels quantize the tangent to 7 degrees, so that now and then a circle is split; most are not.
    counts = []
    for x0, y0 in np.random.default_rng(radius).uniform(79, 81, (11, 2)):
        found = edges_of(digitized(picture(disc(x0, y0, radius), n=4)))
        gaps = np.hypot(*(found.points - (x0, y0)).T) - radius
        assert np.abs(gaps).max() < 0.5
        assert len(gaps) > 0.9 * 2 * np.pi * radius
        counts.append(found.n_segments)
    assert np.median(counts) <= 2


@pytest.mark.parametrize("sides", [3, 4, 5, 6])
@pytest.mark.parametrize("turn", [0.0, 7.0, 20.0, 45.0])
def test_a_polygon_is_split_at_its_corners_and_only_there(sides: int, turn: float) -> None:
    inradius = 30.0 if sides == 3 else 50.0
    normals = np.stack([normal_at(turn + 360 * k / sides) for k in range(sides)])

    def inside(x: Array, y: Array) -> Mask:
        within: Mask = np.logical_and.reduce([n[0] * (x - 80) + n[1] * (y - 80) < inradius for n in normals])
        return within

    found = edges_of(digitized(picture(inside)))
    outward = (found.points - 80) @ normals.T
    side = outward.argmax(axis=1)
    tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    along = np.abs(((found.points - 80) * tangents[side]).sum(axis=1))
    middle = along < inradius * np.tan(np.pi / sides) - 10
    pieces = [np.unique(found.segments[middle & (side == k)]) for k in range(sides)]
    assert sum(len(piece) for piece in pieces) == len(np.unique(np.concatenate(pieces)))
    # The chain of a closed outline begins somewhere: the side it begins on may come in two pieces.
    assert sorted(len(piece) for piece in pieces)[:-1] == [1] * (sides - 1)
    assert max(len(piece) for piece in pieces) <= 2


@pytest.mark.parametrize("radius", [15, 25, 35])
@pytest.mark.parametrize("flip", [False, True])
def test_an_s_curve_is_split_where_its_curvature_changes_sign(radius: int, flip: bool) -> None:
    def wave(x: Array, y: Array) -> Mask:
        left, right = np.hypot(x - 80 + radius, y - 80), np.hypot(x - 80 - radius, y - 80)
        band: Mask = ((y > 80) & (np.abs(left - radius) < 3)) | ((y <= 80) & (np.abs(right - radius) < 3))
        return band if not flip else band[:, ::-1]

    found = edges_of(digitized(picture(wave)))
    beyond = found.points[:, 1] - 80
    far = RULE[0] + RULE[2]
    inner = np.abs(found.points[:, 0] - 80) < 1.2 * radius
    above = set(found.segments[(beyond > far) & inner])
    below = set(found.segments[(beyond < -far) & inner])
    assert above
    assert below
    assert not above & below


def test_analysing_edges_leaves_its_input_alone_and_is_deterministic() -> None:
    image = digitized(picture(half_plane(30.0, 100.0)[1]), noise=6.0)
    slopes = gradient(image, 1.0)
    edges = canny(slopes, 3.0, 7.0)
    before = edges.copy(), slopes.dx.copy(), slopes.dy.copy()
    first, second = segment_edges(edges, slopes, RULE), segment_edges(edges, slopes, RULE)
    for kept, copy in zip((edges, slopes.dx, slopes.dy), before, strict=True):
        np.testing.assert_array_equal(kept, copy)
    for name in ("points", "directions", "segments"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_an_image_without_edges_has_no_segments() -> None:
    found = edges_of(np.full((40, 50), 90, dtype=np.uint8))
    assert found.points.shape == found.directions.shape == (0, 2)
    assert found.n_segments == 0


@pytest.mark.parametrize("reach", [5.0, 30.0, 1000.0])
@pytest.mark.parametrize("fraction", [0.0, 0.499])
def test_a_chamfer_image_is_the_distance_to_the_nearest_point(reach: float, fraction: float) -> None:
    rng = np.random.default_rng(4)
    width, height = 70, 50
    points = (rng.integers(1, (width - 1, height - 1), (25, 2)) + rng.uniform(-fraction, fraction, (25, 2))).astype(
        "f4"
    )
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    exact = np.hypot(x[..., None] - points[:, 0], y[..., None] - points[:, 1]).min(axis=2)
    found = chamfer_image(points, (width, height), reach)
    assert found.shape == (height, width)
    assert found.max() <= reach
    # The 5 x 5 mask's steps are up to 2 % off; points count at their pixel.
    slack = 0.02 * exact + np.sqrt(2) * fraction + 1e-3
    assert (np.abs(found - np.minimum(exact, reach)) <= slack).all()


@pytest.mark.parametrize("reach", [2.5, 40.0])
@pytest.mark.parametrize(
    ("size", "n_points"), [((70, 50), 1), ((70, 50), 40), ((333, 217), 90), ((3, 40), 2), ((1, 1), 1)]
)
def test_a_chamfer_image_is_that_of_opencv(size: tuple[int, int], n_points: int, reach: float) -> None:
    pixels = np.random.default_rng(n_points).integers(0, size, (n_points, 2))
    free = np.full(size[::-1], 255, dtype=np.uint8)
    free[pixels[:, 1], pixels[:, 0]] = 0
    twin = np.minimum(cv2.distanceTransform(free, cv2.DIST_L2, 5), reach)
    np.testing.assert_allclose(chamfer_image(pixels.astype(np.float32), size, reach), twin, atol=1e-3)


def test_a_chamfer_image_of_nothing_is_its_reach() -> None:
    empty = chamfer_image(np.zeros((0, 2), dtype=np.float32), (7, 5), 12.0)
    np.testing.assert_array_equal(empty, np.full((5, 7), 12.0, dtype=np.float32))
