"""Analysis: synthesized persons before walls and clutter, and what every analysis holds for every kind of input."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tracker.bodies.body.description import load_body
from tracker.bodies.contours import Contours, expected_samples, joined, region_around
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Mask
from tracker.foundation.configuration.components import available, find
from tracker.foundation.errors import SequenceError
from tracker.foundation.resources import model_path
from tracker.images.analysis import Analysis, thinned
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.analysis.silhouettes import SilhouetteAnalysis
from tracker.images.plate import Plate
from tracker.images.sight import Observation, Sight, ViewObservation
from tracker.synthesis.cpu import CpuSynthesis

SIZE = 384, 288
POST = slice(20, 270), slice(20, 32)
"""A bright post at the left border, far from the person."""

Plates = tuple[Plate | None, ...]


@pytest.fixture(scope="module")
def scene() -> Scene:
    """One person with spread arms before two cameras."""
    body = load_body(model_path("gavrila22"))
    q = body.rest()
    for side in ("left", "right"):
        q[body.index(f"{side}_arm_abduction")] = np.radians(50.0)
    places = {"front": (4.5, 0.4, 0.2), "side": (0.8, 4.5, 0.4)}
    rig = Rig(tuple(Camera.looking_at(name, SIZE, 480.0, at, np.zeros(3)) for name, at in places.items()))
    return Scene((Person("one", body, body.clamped(q)),), rig)


@pytest.fixture(scope="module")
def expected(scene: Scene) -> Contours:
    return CpuSynthesis().contours(scene)


@pytest.fixture(scope="module")
def outlines(scene: Scene) -> tuple[Mask, ...]:
    return CpuSynthesis().silhouettes(scene)


@pytest.fixture(scope="module")
def plates() -> tuple[Plate, ...]:
    """Even grey walls with a little noise, and the post."""
    empty = []
    for seed in range(2):
        grey = np.full((SIZE[1], SIZE[0], 3), 150.0)
        grey[POST] = 230.0
        noise = np.random.default_rng(seed).standard_normal(grey.shape)
        empty.append(Plate(np.round(grey + noise).astype(np.uint8)))
    return tuple(empty)


@pytest.fixture(scope="module")
def frame(plates: tuple[Plate, ...], outlines: tuple[Mask, ...]) -> Frame:
    """The dark person before the walls."""
    images = []
    for plate, outline in zip(plates, outlines, strict=True):
        image = plate.picture.copy()
        image[outline] = (60, 50, 40)
        images.append(cv2.GaussianBlur(image, (0, 0), 0.6))
    return Frame(0, 0.0, tuple(images))


def all_views(observation: Observation) -> list[ViewObservation]:
    views = [view for view in observation.views if view is not None]
    assert len(views) == len(observation.views)
    return views


def gaps_to(points: Array32, samples: Array32) -> Array:
    """Distance of each point to the nearest expected sample, px."""
    nearest: Array = np.linalg.norm(points[:, None].astype(float) - samples[None, :, :2], axis=2).min(axis=1)
    return nearest


@pytest.mark.parametrize(("n", "most"), [(0, 10), (10, 10), (11, 10), (997, 10), (1000, 400), (5000, 400)])
def test_thinning_keeps_the_total_length_and_spreads_evenly(n: int, most: int) -> None:
    indices = np.flatnonzero(np.tile([True, False, True], n))[:n]
    picked, weights = thinned(indices, most)
    assert len(picked) == min(n, most)
    assert weights.sum() == pytest.approx(n, rel=1e-5)
    places = np.searchsorted(indices, picked)
    np.testing.assert_array_equal(indices[places], picked)
    if n > 0:
        steps = np.diff(places, prepend=places[0] - n / most if n > most else -1)
        assert steps.min() >= np.floor(max(1, n / most))
        assert steps.max() <= np.ceil(max(1, n / most))
        assert abs(places.mean() - (n - 1) / 2) <= 0.5


def test_expected_samples_are_the_matched_ones_of_all_poses(expected: Contours, scene: Scene) -> None:
    moved = CpuSynthesis().contours(scene.with_pose(0, scene.persons[0].q + 0.05))
    for v in range(2):
        each = [one.of(v).pixels[one.of(v).weights > 0] for one in (expected, moved)]
        np.testing.assert_array_equal(expected_samples(joined((expected, moved)), v)[:, :2], np.concatenate(each))
        assert 0 < len(each[0]) <= len(expected.of(v).pixels)
        assert not expected.of(v).between[expected.of(v).weights > 0].any()


def test_the_region_of_interest_is_the_box_of_the_samples_with_a_margin() -> None:
    samples = np.array([[100.2, 50, 1, 0], [140.0, 90.6, 1, 0]], dtype=np.float32)
    assert region_around(samples, SIZE, 10.0) == (90, 40, 60, 61)
    assert region_around(samples, SIZE, 1000.0) == (0, 0, *SIZE)
    assert region_around(samples[:0], SIZE, 10.0) == (0, 0, *SIZE)


@pytest.mark.parametrize("place", [(-500.0, -500.0), (900.0, 100.0), (383.0, 287.0), (200.0, 2000.0)])
def test_the_region_of_interest_lies_in_the_image(place: tuple[float, float]) -> None:
    x, y, width, height = region_around(np.array([[*place, 1, 0]], dtype=np.float32), SIZE, 3.0)
    assert min(x, y) >= 0
    assert min(width, height) >= 8
    assert x + width <= SIZE[0]
    assert y + height <= SIZE[1]


def test_edges_inside_the_foreground_count_less(frame: Frame, plates: Plates, outlines: tuple[Mask, ...]) -> None:
    inside = cv2.erode(outlines[0].astype(np.uint8), np.ones((13, 13), np.uint8)) > 0
    image = np.array(frame.images[0])
    stripes = inside & (np.add.outer(np.arange(SIZE[1]), np.zeros(SIZE[0], dtype=int)) % 16 < 8)
    image[stripes] = (60, 50, 150)
    striped = replace(frame, images=(image, *frame.images[1:]))
    view = ContourAnalysis(interior_weight=0.25, n_scene=10_000).observe(Sight(striped, plates), None).views[0]
    assert view is not None
    places = np.round(view.edges[view.scene]).astype(int)
    within = inside[places[:, 1], places[:, 0]]
    assert within.sum() > 100
    assert set(view.scene_weights[within]) == {0.25}
    # Gaps between limbs that the foreground closes lie inside, too.
    assert set(view.scene_weights[~within]) == {0.25, 1.0}
    assert view.scene_weights[~within].mean() > 0.85
    unknown = ContourAnalysis(interior_weight=0.25, n_scene=10_000).observe(Sight(striped, (None, None)), None).views[0]
    assert unknown is not None
    assert set(unknown.scene_weights) == {1.0}


@pytest.mark.parametrize("use", available("analysis"))
@pytest.mark.parametrize("known", [True, False])
def test_every_analysis_finds_the_outline_and_keeps_the_contract(
    use: str, known: bool, frame: Frame, expected: Contours, plates: Plates
) -> None:
    analysis: Analysis = find("analysis", use)()
    assert isinstance(analysis, Analysis)
    sight = Sight(frame, plates)
    observation = analysis.observe(sight, expected if known else None)
    for v, view in enumerate(all_views(observation)):
        n = len(view.edges)
        assert view.edges.shape == view.directions.shape == (n, 2)
        assert view.segments.shape == view.accepted.shape == (n,)
        np.testing.assert_allclose(np.linalg.norm(view.directions, axis=1), 1, atol=1e-5)
        assert (view.edges >= -0.5).all()
        assert (view.edges <= np.array(SIZE) - 0.5).all()
        assert view.accepted[view.scene].all()
        length = view.accepted.sum() / len(view.scene)
        share = getattr(analysis, "interior_weight", 1.0)
        np.testing.assert_allclose(view.scene_weights[view.scene_weights > 0.99 * length], length, rtol=1e-5)
        np.testing.assert_allclose(view.scene_weights[view.scene_weights <= 0.99 * length], share * length, rtol=1e-5)
        assert (np.diff(view.scene) > 0).all()
        assert view.distance.max() <= view.reach
        pixels = np.floor(view.edges[view.accepted] + 0.5).astype(int) - view.origin
        assert sorted(map(tuple, np.argwhere(view.distance == 0)[:, ::-1].tolist())) == sorted(
            set(map(tuple, pixels.tolist()))
        )
        assert sight.silhouette(v) is not None
        # Contours of the model, and hulls drawn in its place, differ by less than 2 px.
        samples = expected_samples(expected, v)
        assert np.percentile(gaps_to(samples[:, :2], np.concatenate([view.edges, view.directions], axis=1)), 60) < 2
        assert np.percentile(gaps_to(view.edges[view.scene], samples), 90) < 6


@pytest.mark.parametrize("use", available("analysis"))
def test_every_analysis_leaves_missing_views_out_and_the_others_as_they_are(
    use: str, frame: Frame, expected: Contours, plates: Plates
) -> None:
    analysis: Analysis = find("analysis", use)()
    whole = analysis.observe(Sight(frame, plates), expected)
    part = analysis.observe(Sight(replace(frame, images=(None, frame.images[1])), plates), expected)
    assert part.views[0] is None
    assert_same(part.views[1], whole.views[1])
    nothing = analysis.observe(Sight(replace(frame, images=(None, None)), plates), None)
    assert nothing.views == (None, None)


def assert_same(one: ViewObservation | None, other: ViewObservation | None) -> None:
    assert one is not None
    assert other is not None
    for name, value in vars(one).items():
        np.testing.assert_array_equal(value, getattr(other, name), err_msg=name)


@pytest.mark.parametrize("use", available("analysis"))
def test_every_analysis_is_deterministic_and_leaves_its_input_alone(
    use: str, frame: Frame, expected: Contours, plates: tuple[Plate, ...]
) -> None:
    analysis: Analysis = find("analysis", use)()
    images = [image for image in (*frame.images, *(plate.picture for plate in plates)) if image is not None]
    before = [image.copy() for image in images]
    first, second = (analysis.observe(Sight(frame, plates), expected) for _ in range(2))
    for one, other in zip(first.views, second.views, strict=True):
        assert_same(one, other)
    for image, copy in zip(images, before, strict=True):
        np.testing.assert_array_equal(image, copy)


def test_views_analysed_at_the_same_time_do_not_disturb_each_other(
    frame: Frame, expected: Contours, plates: Plates
) -> None:
    alone, together = (ContourAnalysis(threads=n).observe(Sight(frame, plates), expected) for n in (1, 4))
    for one, other in zip(alone.views, together.views, strict=True):
        assert_same(one, other)


def test_edges_point_to_the_brighter_side_and_silhouettes_inwards(
    frame: Frame, plates: Plates, outlines: tuple[Mask, ...]
) -> None:
    dark_person = ContourAnalysis().observe(Sight(frame, plates), None)
    silhouettes = SilhouetteAnalysis().observe(Sight(frame, plates), None)
    for analysis, inwards in ((dark_person, -1), (silhouettes, 1)):
        for view, outline in zip(all_views(analysis), outlines, strict=True):
            points, directions = view.edges[view.accepted], view.directions[view.accepted]
            ahead = np.round(points + 3 * inwards * directions).astype(int)
            behind = np.round(points - 3 * inwards * directions).astype(int)
            assert outline[ahead[:, 1], ahead[:, 0]].mean() > 0.97
            assert outline[behind[:, 1], behind[:, 0]].mean() < 0.03


def test_a_background_rejects_what_has_not_changed(frame: Frame, plates: Plates) -> None:
    for backgrounds, use, sees_post in ((plates, True, False), (plates, False, True), ((None, None), True, True)):
        sight = Sight(frame, backgrounds)
        observation = ContourAnalysis(use_background=use).observe(sight, None)
        for v, view in enumerate(all_views(observation)):
            assert (view.edges[:, 0] < 36).any() == sees_post
            assert (view.edges[view.accepted][:, 0] < 36).any() == sees_post
            assert (sight.silhouette(v) is None) == (backgrounds[0] is None)


@pytest.mark.parametrize(("grow_px", "sees_post"), [(0, False), (4, False), (12, True)])
def test_edges_count_so_far_outside_of_what_has_changed(
    grow_px: int, sees_post: bool, frame: Frame, plates: tuple[Plate, ...]
) -> None:
    image = plates[0].picture.copy()
    image[POST[0], 40:60] = 90  # 8 px beside the post
    view = ContourAnalysis(grow_px=grow_px).observe(Sight(replace(frame, images=(image,)), plates[:1]), None).views[0]
    assert view is not None
    sides = [abs(view.edges[view.accepted, 0] - x) < 1 for x in (POST[1].start - 0.5, POST[1].stop - 0.5, 39.5, 59.5)]
    assert [side.sum() > 200 for side in sides] == [False, sees_post, True, True]


def test_the_expected_contours_reject_what_is_far_from_them(frame: Frame, expected: Contours) -> None:
    clutter = tuple(None if image is None else image.copy() for image in frame.images)
    for image in clutter:
        assert image is not None
        cv2.line(image, (90, 5), (300, 25), (240, 240, 240), 5)  # above the person
        cv2.line(image, (150, 100), (330, 285), (240, 240, 240), 5)  # out of the person
    observation = ContourAnalysis(margin_px=300).observe(Sight(replace(frame, images=clutter)), expected)
    for v, view in enumerate(all_views(observation)):
        gaps = gaps_to(view.edges, expected_samples(expected, v))
        assert (gaps > 40).sum() > 200
        assert not view.accepted[gaps > 40].any()
        assert view.accepted[gaps < 3].mean() > 0.8
        share = np.bincount(view.segments, view.accepted) / np.maximum(np.bincount(view.segments), 1)
        assert set(share) <= {0.0, 1.0}


def test_the_outline_shows_a_limb_where_none_is_expected(
    scene: Scene, frame: Frame, plates: Plates, outlines: tuple[Mask, ...]
) -> None:
    lowered = scene.persons[0].q.copy()
    lowered[scene.persons[0].body.index("left_arm_abduction")] = 0.0
    wrong = scene.with_pose(0, scene.persons[0].body.clamped(lowered))
    missed = outlines[0] & ~CpuSynthesis().silhouettes(wrong)[0]
    beyond = cv2.dilate(missed.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    expected = CpuSynthesis().contours(wrong)
    lengths = []
    for outline_px in (0, 3):
        view = ContourAnalysis(outline_px=outline_px).observe(Sight(frame, plates), expected).views[0]
        assert view is not None
        found = np.round(view.edges[view.accepted]).astype(int)
        far = gaps_to(view.edges[view.accepted], expected_samples(expected, 0)) > 20
        lengths.append(int((beyond[found[:, 1], found[:, 0]] & far).sum()))
    assert lengths[1] > 60
    assert lengths[0] < 0.3 * lengths[1]


@pytest.mark.parametrize("use", available("analysis"))
def test_edges_in_the_region_of_interest_are_those_of_the_whole_image(
    use: str, frame: Frame, expected: Contours, plates: Plates
) -> None:
    kind = find("analysis", use)
    whole, part = (
        kind(margin_px=2000).observe(Sight(frame, plates), expected),
        kind(margin_px=20).observe(Sight(frame, plates), expected),
    )
    for everywhere, within in zip(all_views(whole), all_views(part), strict=True):
        (x, y), (height, width) = within.origin, within.distance.shape
        assert everywhere.distance.shape == SIZE[::-1]
        assert width * height < 0.8 * SIZE[0] * SIZE[1]
        inner = ((everywhere.edges > (x, y)) & (everywhere.edges < (x + width - 1, y + height - 1))).all(axis=1)
        np.testing.assert_allclose(within.edges, everywhere.edges[inner], atol=1e-4)
        np.testing.assert_allclose(within.directions, everywhere.directions[inner], atol=1e-6)
        np.testing.assert_array_equal(within.accepted, everywhere.accepted[inner])
        np.testing.assert_allclose(within.distance, everywhere.distance[y : y + height, x : x + width], atol=1e-4)


def test_silhouettes_need_the_background_of_every_view(frame: Frame, plates: Plates) -> None:
    for backgrounds in ((), (plates[0], None), (None, None)):
        with pytest.raises(SequenceError, match="background of every view"):
            SilhouetteAnalysis().observe(Sight(frame, backgrounds), None)


def test_packed_arrays_hold_every_view_in_order(frame: Frame, expected: Contours, plates: Plates) -> None:
    first, second = all_views(ContourAnalysis(reach_px=25.0).observe(Sight(frame, plates), expected))
    flat, layout, scene, starts, reach = Observation((first, None, second)).packed
    assert [array.dtype for array in (flat, layout, scene, starts, reach)] == ["f4", "i8", "f4", "i8", "f4"]
    assert not any(array.flags.writeable for array in (flat, layout, scene, starts, reach))
    np.testing.assert_array_equal(starts, np.cumsum([0, len(first.scene), 0, len(second.scene)]))
    np.testing.assert_array_equal(reach, [25, 0, 25])
    np.testing.assert_array_equal(layout[1, 1:], 0)
    for v, view in ((0, first), (2, second)):
        start, x, y, width, height = layout[v]
        np.testing.assert_array_equal(flat[start : start + width * height].reshape(height, width), view.distance)
        assert (x, y) == view.origin
        rows = scene[starts[v] : starts[v + 1]]
        assert (np.diff(rows[:, 1]) >= 0).all()
        columns = view.edges[view.scene], view.directions[view.scene], view.scene_weights[:, None]
        assert sorted(rows.tolist()) == sorted(np.concatenate(columns, axis=1).tolist())
    assert len(flat) == first.distance.size + second.distance.size


@pytest.mark.parametrize("n_views", [0, 3])
def test_packed_arrays_of_missing_views_are_empty(n_views: int) -> None:
    flat, layout, scene, starts, reach = Observation((None,) * n_views).packed
    assert len(flat) == 0
    assert scene.shape == (0, 5)
    np.testing.assert_array_equal(starts, np.zeros(n_views + 1))
    np.testing.assert_array_equal(reach, np.zeros(n_views))
    assert n_views == 0 or layout.shape == (n_views, 5)
