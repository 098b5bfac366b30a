"""Following points: a moving plane known exactly, kernels against plain twins, what hides and changes points."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from textures import Waves, pixels_of, sensed

from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.triangulation import triangulate
from tracker.foundation.errors import MatchingError, SequenceError
from tracker.kernels.adjustment import intersect_rays
from tracker.points.following.births import Density, chosen_evenly, points_of_image, points_of_surface
from tracker.points.following.following import Following
from tracker.points.following.points import expected, restored
from tracker.points.following.sequence import STATE, Counts, follow, save_state, saved_state
from tracker.points.surfaces import LeastSquaresMatching
from tracker.points.surfaces.growth import Growth
from tracker.points.surfaces.surface import Preparation, SurfaceMeasurement, measure_surface
from tracker.points.trajectories import PointStatus
from tracker.running.jobs._following import Born

SIZE, NOISE, N_FRAMES = (200, 160), 1.0, 9
TEXTURE, OTHER = Waves(0.012, widest=16.0, n=120), Waves(0.012, seed=3, widest=16.0, n=120)


@pytest.fixture(scope="module")
def rig():
    lens = np.array((-0.15, 0.05, 0.001, -0.001, 0.0))
    cameras = (Camera.looking_at(name, SIZE, 430.0, (x, -0.25, 0.7), np.zeros(3)) for name, x in PLACES)
    return Rig(tuple(replace(camera, distortion=lens) for camera in cameras))


PLACES = ("left", -0.12), ("middle", 0.0), ("right", 0.12)


def motion(k):
    """Rotation and shift of the plane in frame k: 2 px and 1.2 degrees a frame."""
    return Rotation.from_euler("xyz", np.array((0.8, 0.6, 0.7)) * k, degrees=True), np.array((3e-3, 2e-3, 2e-3)) * k


def seen(texture, camera, k, key, noise=NOISE):
    """The image of the plane in frame k."""
    return sensed(grey_of(texture, camera, k), noise, key)


def grey_of(texture, camera, k):
    """The same without noise, computed once for all tests."""
    key = texture, camera.name, k
    if key not in GREY:
        GREY[key] = grey_levels(texture, camera, k)
    return GREY[key]


GREY = {}


def grey_levels(texture, camera, k):
    """What the plane's texture is at each pixel in frame k."""
    turn, shift = motion(k)
    rays = turn.inv().apply(camera.rays(pixels_of(camera.size)).reshape(-1, 3))
    centre = turn.inv().apply(camera.centre - shift)
    places = centre[:2] - rays[:, :2] / rays[:, 2:] * centre[2]
    return texture(places.reshape(*SIZE[::-1], 2))


@pytest.fixture(scope="module")
def frames(rig):
    return tuple(
        Frame(k, k / 50, tuple(seen(TEXTURE, camera, k, 10 * k + v) for v, camera in enumerate(rig.cameras)))
        for k in range(N_FRAMES)
    )


@pytest.fixture(scope="module")
def born(rig, frames):
    """Points of the surface, and their places on the plane."""
    surface = measure_surface(SurfaceMeasurement(growth=Growth(step_px=4)), frames[0], rig)
    new = points_of_surface(surface)
    inner = (np.abs(new.pixels[1] - (100, 80)) < (55, 40)).all(axis=1)
    rows = np.flatnonzero(inner)
    new = new.select(rows[chosen_evenly(len(rows), 250)])
    camera = rig.cameras[1]
    rays = camera.rays(new.pixels[1])
    return new, camera.centre - rays / rays[:, 2:] * camera.centre[2]


def where(places, k):
    turn, shift = motion(k)
    return turn.apply(places) + shift


def followed(rig, frames, new, following=None, preparation=None):
    steps = follow(following or Following(), preparation or Preparation(), rig, frames, lambda frame: new)
    return [frame for frame, _ in steps]


@pytest.fixture(scope="module")
def result(rig, frames, born):
    return followed(rig, frames, born[0])


def test_points_of_a_moving_plane_are_followed_as_their_sigmas_say(result, born):
    last = result[-1]
    assert last.alive.mean() > 0.98
    off = last.positions - where(born[1], N_FRAMES - 1)
    alive = last.alive
    inverse = np.linalg.inv(last.covariances[alive])
    squares = np.einsum("ni,nij,nj->n", off[alive], inverse, off[alive])
    # the match of the birth and that of the last frame share the key's noise: sigmas are on the safe side
    assert 0.35 < np.sqrt(squares.mean() / 3) < 1.2
    assert np.linalg.norm(off[alive], axis=1).max() < 2e-3


def test_key_patches_do_not_drift_and_previous_ones_do(rig, frames, born, result):
    def across(frame, camera):
        gaps = frame.pixels[1] - camera.project(where(born[1], frame.index))
        return np.sqrt(np.nanmean(gaps**2))

    previous = followed(rig, frames, born[0], Following(template="previous", start="correlation"))
    camera = rig.cameras[1]
    assert across(result[-1], camera) < 1.4 * across(result[1], camera)
    assert across(previous[-1], camera) > 1.7 * across(previous[1], camera)
    assert across(previous[-1], camera) > 1.5 * across(result[-1], camera)
    assert np.nanmax(result[-1].drift_px[result[-1].status == PointStatus.FOLLOWED]) < 0.1
    # seven more matches, each about as uncertain as that of the birth
    growth = np.nanmedian(previous[-1].drift_px) / np.nanmedian(previous[1].drift_px)
    assert 1.8 < growth < np.sqrt(8)


def test_ids_are_for_life(result):
    for frame in result:
        np.testing.assert_array_equal(frame.ids, result[0].ids)
    assert len(set(result[0].ids)) == len(result[0].ids)
    assert (result[0].status == PointStatus.BORN).all()


def covered(frames, first, last, columns):
    """A textured strip before part of the plane in some frames."""
    strip = sensed(Waves(9.0, seed=8)(pixels_of(SIZE)), NOISE, 5)
    changed = []
    for frame in frames:
        images = [image.copy() for image in frame.images]
        if first <= frame.index < last:
            for image in images:
                image[:, columns] = strip[:, columns]
        changed.append(replace(frame, images=tuple(images)))
    return changed


def test_hidden_points_are_found_again_and_none_is_wrong(rig, frames, born):
    result = followed(rig, covered(frames, 2, 6, slice(80, 125)), born[0])
    hidden = np.array([not frame.alive[i] for frame in result[2:6] for i in range(250)]).reshape(4, -1).all(axis=0)
    assert 50 < hidden.sum() < 200
    off = np.linalg.norm(result[-1].positions - where(born[1], N_FRAMES - 1), axis=1)
    again = result[-1].alive[hidden]
    assert again.mean() > 0.85
    assert np.nanmax(off) < 2e-3
    assert any((frame.status == PointStatus.FOUND_AGAIN).any() for frame in result)
    never = followed(rig, covered(frames, 2, 6, slice(80, 125)), born[0], Following(find_again=False))
    assert never[-1].alive[hidden].sum() == 0


def test_points_that_were_all_hidden_at_once_are_found_again(rig, frames, born):
    hiding = covered(frames, 3, 6, slice(0, SIZE[0]))
    result = followed(rig, hiding, born[0])
    assert not any(frame.alive.any() for frame in result[3:6])
    off = np.linalg.norm(result[-1].positions - where(born[1], N_FRAMES - 1), axis=1)
    assert result[-1].alive.mean() > 0.9
    assert np.nanmax(off) < 2e-3


def test_a_changing_pattern_gets_new_keys_and_says_so(rig, frames, born):
    def mixed(camera, k, key):
        share = k / (N_FRAMES - 1)
        return sensed((1 - share) * grey_of(TEXTURE, camera, k) + share * grey_of(OTHER, camera, k), NOISE, key)

    changing = [
        Frame(k, k / 50, tuple(mixed(camera, k, 10 * k + v) for v, camera in enumerate(rig.cameras)))
        for k in range(N_FRAMES)
    ]
    result = followed(rig, changing, born[0])
    rekeyed = np.array([(frame.status == PointStatus.REKEYED) for frame in result])
    alive = result[-1].alive
    assert rekeyed.any(axis=0)[alive].mean() > 0.8
    assert alive.mean() > 0.5
    assert (result[-1].drift_px[alive & rekeyed.any(axis=0)] > np.nanmedian(result[1].drift_px)).mean() > 0.9
    for k, frame in enumerate(result):
        # a new key is of the frame before; whoever never got one is known by the patch of the birth
        assert (frame.keys[:, frame.status == PointStatus.REKEYED].max(axis=0, initial=0) == k - 1).all()
        assert (frame.keys[:, ~rekeyed[: k + 1].any(axis=0)] == 0).all()
        assert (frame.born == 0).all()


def test_one_view_is_followed_in_its_image(rig, frames, born):
    flat = [replace(frame, images=frame.images[1:2]) for frame in frames]
    result = followed(Rig(rig.cameras[1:2]), flat, points_of_image(born[0].pixels[1]))
    gaps = result[-1].pixels[0] - rig.cameras[1].project(where(born[1], N_FRAMES - 1))
    assert result[-1].alive.mean() > 0.98
    assert np.sqrt(np.nanmean(gaps**2)) < 0.05
    assert np.isnan(result[-1].positions).all()


def test_a_point_that_no_patch_fits_around_is_never_seen(rig, frames):
    flat = [replace(frame, images=frame.images[1:2]) for frame in frames[:3]]
    result = followed(Rig(rig.cameras[1:2]), flat, points_of_image(np.array([[100.0, 80.0], [3.0, 80.0]])))
    for frame in result:
        np.testing.assert_array_equal(frame.alive, [True, False])


def test_a_lonely_point_of_one_view_waits_where_it_was_seen_last(frames, rig):
    still = [replace(frames[0], index=k, images=frames[0].images[1:2]) for k in range(6)]
    hiding = covered(still, 2, 4, slice(0, SIZE[0]))
    result = followed(Rig(rig.cameras[1:2]), hiding, points_of_image(np.array([[100.0, 80.0]])))
    assert [bool(frame.alive[0]) for frame in result] == [True, True, False, False, True, True]
    np.testing.assert_allclose(result[-1].pixels[0], [[100.0, 80.0]], atol=1e-3)


def test_a_frame_without_an_image_shows_no_points_and_loses_none(rig, frames, born, result):
    holed = [replace(f, images=(f.images[0], None, f.images[2])) if f.index == 4 else f for f in frames]
    result = followed(rig, holed, born[0])
    assert not result[4].alive.any()
    assert result[-1].alive.mean() > 0.95
    alone = [replace(f, images=(f.images[0], None, None)) if f.index == 2 else f for f in frames[:4]]
    result = followed(rig, alone, born[0].select(np.arange(0, 250, 5)), Following(min_views=1))
    assert not result[2].alive.any()
    assert (result[3].status == PointStatus.FOLLOWED).mean() > 0.95
    with pytest.raises(SequenceError, match='view "middle" has no image in frame 4, in which following begins'):
        followed(rig, holed[4:], born[0])


def test_a_saved_state_continues_to_the_same_bits(rig, frames, born, result):
    steps = follow(Following(), Preparation(), rig, frames[:5], lambda frame: born[0])
    *_, (_, points) = steps
    again = restored({name: array.copy() for name, array in points.arrays().items()})
    rest = follow(Following(), Preparation(), rig, frames[4:], lambda frame: born[0], again)
    for frame, expected_frame in zip((f for f, _ in rest), result[5:], strict=True):
        np.testing.assert_array_equal(frame.positions, expected_frame.positions)
        np.testing.assert_array_equal(frame.status, expected_frame.status)


def test_a_state_saved_while_an_image_is_missing_continues_to_the_same_bits(rig, frames, born, tmp_path):
    new = born[0].select(np.arange(0, 250, 5))
    holed = [replace(f, images=(f.images[0], None, f.images[2])) if f.index == 4 else f for f in frames[:6]]
    whole = followed(rig, holed, new)
    *_, (_, points) = follow(Following(), Preparation(), rig, holed[:5], lambda frame: new)
    save_state(tmp_path, points, Counts([0, 1, 2, 3, 4], [0.0, 0.02, 0.04, 0.06, 0.08], seconds=3.0), 7)
    state = saved_state(tmp_path)
    assert (state.frame, state.frames, len(state.times), state.seconds) == (3, (0, 1, 2, 3), 4, 3.0)
    rest = follow(Following(), Preparation(), rig, holed[state.frame :], lambda frame: new, state.points)
    for frame, expected_frame in zip((f for f, _ in rest), whole[4:], strict=True):
        np.testing.assert_array_equal(frame.positions, expected_frame.positions)
    assert whole[5].alive.mean() > 0.9
    with np.load(tmp_path / STATE) as saved:
        np.savez(tmp_path / STATE, **{name: saved[name] for name in saved.files if name != "latest"})
    with pytest.raises(SequenceError, match="no saved state to go on from"):
        saved_state(tmp_path)


def test_ray_intersection_is_triangulation(rig):
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.05, 0.05, (60, 3))
    pixels = rig.project(points) + rng.normal(scale=0.1, size=(3, 60, 2))
    pixels[0, :20] = np.nan
    pixels[:2, 20] = np.nan
    expected_points, expected_covariances = triangulate(rig.cameras, pixels, 0.2)
    variances = np.tile((0.04, 0.04, 0.0), (3, 60, 1))
    found, covariances, residuals = points + 0.01, np.zeros((60, 3, 3)), np.zeros(60)
    intersect_rays(rig.packed, pixels, variances, found, covariances, residuals)
    np.testing.assert_allclose(found, expected_points, atol=1e-8)
    np.testing.assert_allclose(covariances, expected_covariances, rtol=1e-4)
    gaps = (rig.project(expected_points) - pixels) ** 2
    known = np.isfinite(expected_points[:, 0])
    np.testing.assert_allclose(residuals[known], np.sqrt(np.nanmean(gaps[:, known], axis=(0, 2))), atol=1e-6)
    assert np.isinf(residuals[20])


def test_neighbours_of_an_affine_motion_expect_it(rig, frames, born):
    new = points_of_image(born[0].pixels[1])
    points = Following().begin(new, (LeastSquaresMatching().prepared(frames[0].images[1]),), 0)
    affine, shift = np.array([[0.9, 0.2], [-0.1, 1.2]]), np.array([12.0, -7.0])
    now = new.pixels @ affine.T + shift
    now[:, ::3] = np.nan
    lost = np.arange(0, 250, 3)
    starts = expected(points, now, lost, 0)
    known = np.isfinite(starts.pixels[:, 0])
    assert known.mean() > 0.8
    # the pull towards the unit matrix leaves a little
    np.testing.assert_allclose(starts.pixels[known], (new.pixels[0] @ affine.T + shift)[lost][known], atol=0.1)
    np.testing.assert_allclose(starts.affine[known], np.tile(affine, (known.sum(), 1, 1)), atol=0.03)


def test_curvature_that_a_later_key_has_seen_is_not_corrected_twice():
    """A parabola that grows along x, followed with the patch of the frame before as key."""
    size, texture, growth = (170, 56), Waves(9.0, 60.0, 1), 2.5e-4 * np.arange(8)
    pixels = pixels_of(size)
    bent = []
    for t, k in enumerate(growth):
        at_first = pixels.copy()
        u = pixels[..., 0] - 85
        at_first[..., 0] = 85 + 2 * u / (1 + np.sqrt(1 + 4 * k * u))
        bent.append(Frame(t, t / 25, (sensed(texture(at_first), 1.0, t),)))
    places = np.stack(np.meshgrid(np.arange(45, 126, 8.0), np.arange(12, 45, 8.0)), axis=-1).reshape(-1, 2)
    rig = Rig((Camera.looking_at("one", size, 430.0, (0, -0.25, 0.7), np.zeros(3)),))
    last = followed(rig, bent, points_of_image(places), Following(template="previous"))[-1]
    u = places[:, 0] - 85
    assert last.alive.all()
    # the mean of a patch of 15 px lies 0.033 px beside its centre at last
    assert abs(np.mean(last.pixels[0, :, 0] - 85 - u - growth[-1] * u**2)) < 0.01


def test_odd_lines_are_followed(rig, frames):
    preparation = Preparation(odd_lines_only=True)
    torn = []
    for frame in frames:
        images = [cv2.GaussianBlur(image, (0, 0), 1.0) for image in frame.images]
        for image in images:
            image[1::2] = np.roll(image[1::2], 9, axis=1)
        torn.append(replace(frame, images=tuple(images)))
    measurement = SurfaceMeasurement(growth=Growth(step_px=4), preparation=preparation)
    new = points_of_surface(measure_surface(measurement, torn[0], rig))
    result = followed(rig, torn, new, preparation=preparation)
    first, last = result[0], result[-1]
    both = last.alive
    turn, shift = motion(N_FRAMES - 1)
    off = last.positions[both] - (turn.apply(first.positions[both]) + shift)
    assert both.mean() > 0.8
    assert np.median(np.linalg.norm(off, axis=1)) < 5e-4


def test_new_surface_gets_new_points_and_old_surface_does_not(rig, frames):
    # a strip hides a third of the plane in the first frames
    hiding = covered(frames, 0, 3, slice(0, 70))
    measurement = SurfaceMeasurement(growth=Growth(step_px=6))

    def births(frame):
        return points_of_surface(measure_surface(measurement, hiding[frame.index], rig))

    steps = [f for f, _ in follow(Following(), Preparation(), rig, hiding, births, density=Density(every_frames=4))]
    first, fourth, last = steps[0], steps[4], steps[-1]
    new = fourth.status == PointStatus.BORN
    n_before = fourth.alive[~new].sum()
    assert new.sum() > 50
    assert (fourth.ids[new] > first.ids.max()).all()
    # the uncovered third, and some at the border that moves into the views
    born_at = fourth.pixels[1][new][:, 0]
    assert np.median(born_at) < 75
    assert len(steps[8].ids) == len(last.ids)
    gaps = np.linalg.norm(fourth.pixels[1][fourth.alive][:, None] - fourth.pixels[1][fourth.alive], axis=2)
    gaps[np.diag_indices(len(gaps))] = np.inf
    assert np.nanmin(gaps) > 1.5
    assert n_before > 0.8 * first.alive.sum()


def test_of_two_points_that_run_together_the_older_one_goes_on(frames, born):
    new = points_of_image(np.concatenate([born[0].pixels[1][:50], born[0].pixels[1][:10] + 0.4]))
    points = Following().begin(new, (LeastSquaresMatching().prepared(frames[0].images[1]),), 0)
    kept = Density().kept(points, 4.0)
    np.testing.assert_array_equal(np.flatnonzero(~kept), np.arange(50, 60))
    points.since[3] = 251
    assert not Density().kept(points, 4.0)[3]
    assert Density(forget_frames=None).kept(points, 4.0)[3]


def test_texture_at_the_border_alone_is_told(rig):
    dot = np.full((160, 200), 90, np.uint8)
    dot[2:5, 3:6] = 200
    born = Born(SurfaceMeasurement(), Following(), Rig(rig.cameras[:1]), (), [])
    with pytest.raises(MatchingError, match="no patch of 15 px around it is within the image"):
        born.first(Frame(0, 0.0, (dot,)), (dot,))


def test_points_of_voxels_are_born_where_their_pixels_are(rig, frames):
    measurement = SurfaceMeasurement(growth=Growth(step_px=8), voxel_mm=30)
    new = Born(measurement, Following(), rig, (), []).first(frames[0], ())
    assert 50 < len(new.positions) < 120
    np.testing.assert_allclose(rig.project(new.positions), new.pixels, atol=0.2)
