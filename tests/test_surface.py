"""Surface measurement: a plane known exactly, files, given seeds, interlaced images, and what makes one impossible."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
import trimesh
from textures import Waves, plane_seen
from typer.testing import CliRunner

from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.errors import ConfigError, MatchingError, SequenceError, TrackerError
from tracker.images.operations.appearance import wallis_filter
from tracker.images.reading.stills import StillReading
from tracker.points.following.births import given_points
from tracker.points.surfaces.growth import Growth
from tracker.points.surfaces.patch_figure import patch_figure, patch_searches
from tracker.points.surfaces.points import NeighbourhoodFilter, voxel_filtered
from tracker.points.surfaces.seeds import Seeds
from tracker.points.surfaces.surface import (
    Preparation,
    SurfaceMeasurement,
    blur_px,
    field_camera,
    measure_surface,
    residual_rms_px,
)
from tracker.points.surfaces.surface_files import write_csv
from tracker.running.cli import app
from tracker.running.jobs import described, load_job

SIZE = (240, 180)
NOISE = 1.0
CONFIGS = Path(__file__).parents[1] / "configs" / "surfaces"


def looking(name, x, focal=520.0, lens=(0.0,) * 5):
    camera = Camera.looking_at(name, SIZE, focal, (x, -0.25, 0.7), np.zeros(3))
    return Camera(camera.name, SIZE, camera.matrix, np.array(lens), camera.camera_from_world)


@pytest.fixture(scope="module")
def rig():
    lens = (-0.15, 0.05, 0.001, -0.001, 0.0)
    return Rig(tuple(looking(name, x, lens=lens) for name, x in (("left", -0.12), ("middle", 0.0), ("right", 0.12))))


@pytest.fixture(scope="module")
def frame(rig):
    texture = Waves(0.012, widest=16.0, n=120)
    images = (plane_seen(texture, camera, NOISE, k) for k, camera in enumerate(rig.cameras))
    return Frame(0, 0.0, tuple(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in images))


@pytest.fixture(scope="module")
def surface(frame, rig):
    return measure_surface(SurfaceMeasurement(growth=Growth(step_px=4)), frame, rig)


def blurred(image, sigma):
    return cv2.GaussianBlur(image, (0, 0), sigma)


def with_image(frame, view, image):
    return Frame(0, 0.0, tuple(image if v == view else old for v, old in enumerate(frame.images)))


def measured(frame, rig, **fields):
    return measure_surface(SurfaceMeasurement(**{"growth": Growth(step_px=6), **fields}), frame, rig)


def test_the_points_of_a_plane_lie_on_it_as_their_sigmas_say(surface):
    points = surface.points
    assert surface.template == 1
    assert len(points) > 1200
    assert (points.n_views == 3).all()
    height = points.points[:, 2]
    sigma = np.sqrt(points.covariances[:, 2, 2])
    assert 0.7 < np.sqrt(np.mean((height / sigma) ** 2)) < 1.4
    assert np.sqrt(np.mean(height**2)) < 1e-4
    assert 0.8 < points.s0 < 1.3
    assert residual_rms_px(points) < 0.02
    template = surface.views[1].camera
    np.testing.assert_allclose(template.project(points.points), points.pixels[1], atol=0.1)


def test_a_pair_is_measured_too(frame, rig):
    pair = Rig(rig.cameras[:2])
    points = measured(Frame(0, 0.0, frame.images[:2]), pair).points
    assert len(points) > 500
    assert np.sqrt(np.mean(points.points[:, 2] ** 2)) < 2e-4


def test_points_that_not_all_views_show_are_measured_where_that_is_wanted(frame, rig):
    half = frame.images[0].copy()
    half[:, :120] = np.random.default_rng(0).integers(0, 255, half[:, :120].shape)
    spoilt = with_image(frame, 0, half)
    everywhere = measured(spoilt, rig, min_views=2).points
    in_all = measured(spoilt, rig).points
    assert len(in_all) < 0.75 * len(everywhere)
    assert set(everywhere.n_views.tolist()) == {2, 3}
    assert np.abs(everywhere.points[:, 2]).max() < 2e-3


def test_a_view_of_something_else_is_done_without_where_two_are_enough(frame, rig):
    other = plane_seen(Waves(0.012, widest=16.0, n=120, seed=9), rig.cameras[2], NOISE, 7)
    spoilt = with_image(frame, 2, cv2.cvtColor(other, cv2.COLOR_GRAY2BGR))
    found = measured(spoilt, rig, min_views=2)
    assert len(found.points) > 500
    assert set(found.points.n_views.tolist()) == {2}
    assert [warning for warning in found.warnings if 'views "middle" and "right"' in warning]
    clicked = given_points(found, SurfaceMeasurement(min_views=2), np.array([[120.0, 90.0]]), ["navel"])
    np.testing.assert_array_equal(np.isfinite(clicked.pixels[:, 0, 0]), [True, True, False])
    with pytest.raises(
        MatchingError, match=r"navel at \[120, 90\]: seen by 2 of 3 views; in view \"right\": nothing matched"
    ):
        given_points(found, SurfaceMeasurement(), np.array([[120.0, 90.0]]), ["navel"])
    with pytest.raises(MatchingError, match='views "middle" and "right"'):
        measured(spoilt, rig)


def test_seeds_may_be_given_by_hand(frame, rig, surface):
    place = np.array([0.01, 0.0, 0.0])
    pixels = {camera.name: tuple(np.round(camera.project(place)) + 2) for camera in rig.cameras}
    points = measured(frame, rig, seeds=Seeds(given=(pixels,))).points
    assert len(points) > 500
    assert np.sqrt(np.mean(points.points[:, 2] ** 2)) < 1e-4
    with pytest.raises(MatchingError, match=r'no point for both "middle" and "left"'):
        measured(frame, rig, seeds=Seeds(given=({"middle": (1.0, 2.0)},)))


def test_odd_lines_are_enough(frame, rig):
    # A field of an interlaced image: the even lines show another moment
    torn = Frame(0, 0.0, tuple(image.copy() for image in frame.images))
    for image in torn.images:
        image[1::2] = np.roll(image[1::2], 9, axis=1)
    points = measured(torn, rig, preparation=Preparation(odd_lines_only=True)).points
    assert len(points) > 200
    assert np.sqrt(np.mean(points.points[:, 2] ** 2)) < 2e-4


def test_the_camera_of_a_field_sees_every_second_line(rig):
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3))
    whole, field = rig.cameras[0], field_camera(rig.cameras[0])
    np.testing.assert_allclose(field.project(points), whole.project(points) * (1, 0.5))
    assert field.size == (240, 90)


def test_local_contrast_is_brought_up_where_it_is_poor(frame):
    grey = frame.images[0][..., 0]
    poor = (100 + (grey.astype(float) - 128) * np.linspace(0.05, 1, SIZE[0])).astype(np.float32)
    enhanced = wallis_filter(poor, 41, 40.0, 0.9)
    spread = [np.std(enhanced[40:140, a : a + 60]) for a in (20, 160)]
    assert np.std(poor[40:140, 20:80]) < 0.5 * np.std(poor[40:140, 160:220])
    assert 0.7 < spread[0] / spread[1] < 1.3
    plain = (100 + np.random.default_rng(0).normal(size=(200, 200))).astype(np.float32)
    assert np.std(wallis_filter(plain, 41, 40.0, 0.8)) == pytest.approx(0.8 * 40 / (0.8 + 0.2 * 40), rel=0.05)


def test_enhanced_contrast_adds_points_and_takes_none(frame, rig):
    fades = np.where(np.arange(SIZE[0]) < 120, 0.03, 1.0)[:, None]
    poor = tuple((100 + (image.astype(float) - 128) * fades).clip(0, 255).astype(np.uint8) for image in frame.images)
    poor = Frame(0, 0.0, poor)
    plain = measured(poor, rig).points
    enhanced = measured(poor, rig, preparation=Preparation(enhance_contrast=True)).points
    assert len(enhanced) >= len(plain) > 200
    assert np.sqrt(np.mean(enhanced.points[:, 2] ** 2)) < 5e-4


def test_a_surface_that_hardly_grew_is_warned_of(frame, rig, surface):
    assert surface.warnings == ()
    assert all(coverage is None or coverage.share > 0.8 for coverage in surface.coverages)
    noise = np.random.default_rng(0).normal(scale=18, size=(3, *SIZE[::-1], 1))
    noisy = (np.stack(frame.images) + noise).clip(0, 255).astype(np.uint8)
    grainy = Frame(0, 0.0, tuple(noisy))
    poor = measured(grainy, rig, neighbourhood=NeighbourhoodFilter(min_island=1, min_neighbours=1))
    assert len(poor.warnings) == 2
    assert "places that both views are known to show" in poor.warnings[0]
    assert "not precise enough (max_sigma_px)" in poor.warnings[0]


def test_the_search_of_a_patch_leads_from_its_neighbour_to_where_it_is(surface):
    matching, at = SurfaceMeasurement().matching, (118.0, 91.0)
    aside = np.array([0.6, -0.4, *np.zeros(13)])
    fields = tuple(field and replace(field, found=field.found + aside) for field in surface.fields)
    searches = patch_searches(replace(surface, fields=fields), matching, at)
    assert [search.view.camera.name for search in searches] == ["left", "right"]
    camera = surface.views[surface.template].camera
    ray = camera.rays(np.array([at]))[0]
    place = camera.centre - camera.centre[2] / ray[2] * ray
    for search in searches:
        true = search.view.camera.project(place[None])[0]
        off = np.linalg.norm(search.way - true, axis=1)
        assert len(off) >= 3
        assert off[-1] < 0.05
        assert off[0] == pytest.approx(np.hypot(0.6, 0.4), abs=0.1)
        assert search.match.good.all()
    picture = patch_figure(surface.views[1], searches, matching.patch_px)
    assert [axis.get_title().partition(":")[0] for axis in picture.axes[:3]] == ["middle", "left", "right"]
    with pytest.raises(MatchingError, match=r"\[3, 91\] is too near the border for 13 px"):
        patch_searches(surface, matching, (3.0, 91.0))


def test_why_seeds_fail_is_said(frame, rig):
    with pytest.raises(MatchingError, match=r"could be matched \(patches agree too little \(min_correlation\)\)"):
        measured(frame, rig, growth=Growth(step_px=6, min_correlation=1.0))


def test_the_limit_that_leaves_no_point_is_named(frame, rig):
    with pytest.raises(MatchingError, match=r"none of \d+ points is as precise as 0.0001 mm \(max_sigma_mm\)"):
        measured(frame, rig, max_sigma_mm=1e-4)


def test_voxels_replace_points_by_their_centre_of_gravity(surface):
    coarse = voxel_filtered(surface.points, 0.02)
    assert 20 < len(coarse) < 0.2 * len(surface.points)
    assert np.abs(coarse.points[:, 2]).max() < np.abs(surface.points.points[:, 2]).max()
    assert (coarse.sigma_m > 0.5 * np.median(surface.points.sigma_m)).all()
    np.testing.assert_allclose(voxel_filtered(surface.points, 1e-6).points, sorted_like(surface.points.points))


def test_views_of_any_name_have_their_columns(surface, tmp_path):
    write_csv(surface.points, ("left, near", "middle", 'the "right"'), tmp_path / "surface.csv")
    with (tmp_path / "surface.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert float(row["left, near_x"]) == pytest.approx(surface.points.pixels[0, 0, 0], abs=1e-3)
    assert float(row['the "right"_y']) == pytest.approx(surface.points.pixels[2, 0, 1], abs=1e-3)


def sorted_like(points):
    cells = np.floor((points - points.min(axis=0)) / 1e-6)
    return points[np.lexsort(cells.T[::-1])]


@pytest.mark.parametrize("sigma", [0.0, 2.0, 3.0, 5.0])
def test_blur_is_measured(frame, sigma):
    grey = frame.images[1][..., 0]
    found = blur_px(blurred(grey, sigma) if sigma else grey)
    assert 0.5 * sigma <= found < sigma + 1.2


def test_bad_images_are_named(frame, rig):
    one = frame.images[2]
    with pytest.raises(MatchingError, match=r'view "right": a blank image \(grey levels 90 to 90\)'):
        measured(with_image(frame, 2, np.full_like(one, 90)), rig)
    with pytest.raises(MatchingError, match=r'view "right": a blurred image: its edges are about .* px wide'):
        measured(with_image(frame, 2, blurred(one, 6.0)), rig)
    with pytest.raises(SequenceError, match=r'view "right" has no image in frame 0'):
        measured(with_image(frame, 2, None), rig)


def test_images_that_do_not_overlap_are_named(frame, rig):
    other = plane_seen(Waves(0.012, seed=5, widest=16.0, n=120), rig.cameras[2], NOISE, 2)
    with pytest.raises(MatchingError, match=r'views "middle" and "right": .*do not overlap'):
        measured(with_image(frame, 2, other), rig)


def test_the_rig_of_other_images_is_named(frame, rig):
    moved = Camera.looking_at("right", SIZE, 520.0, (0.12, 0.3, 0.7), np.zeros(3))
    turned = Rig((*rig.cameras[:2], moved))
    with pytest.raises(MatchingError, match=r"agree with one another, but only \d+ with the calibration"):
        measured(frame, turned)


def test_parameters_that_do_not_fit_the_rig_are_named(frame, rig):
    with pytest.raises(ConfigError, match=r'template = "midle": no such view; did you mean "middle"'):
        measured(frame, rig, template="midle")
    with pytest.raises(ConfigError, match="min_views = 4: there are 3 views"):
        measured(frame, rig, min_views=4)
    with pytest.raises(ConfigError, match="two or more views"):
        measured(Frame(0, 0.0, frame.images[:1]), Rig(rig.cameras[:1]))
    with pytest.raises(ValueError, match="left < right"):
        Growth(region=(10, 10, 5, 20))


CONFIG = """
name = "plane"
[reading]
use = "stills"
path = "{view}.png"
rig = "rig.toml"
[growth]
step_px = 6
"""


@pytest.fixture
def folder(tmp_path, frame, rig):
    save_rig(rig, tmp_path / "rig.toml")
    for name, image in zip(rig.names, frame.images, strict=True):
        cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    (tmp_path / "surface.toml").write_text(CONFIG)
    return tmp_path


def run_command(folder, *arguments):
    return CliRunner().invoke(
        app, ["surface", str(folder / "surface.toml"), "--output", str(folder / "out"), *arguments]
    )


def test_the_command_writes_cloud_table_pictures_and_configuration(folder):
    result = run_command(folder)
    assert result.exit_code == 0, result.output
    assert "points matched" in result.output
    out = folder / "out"
    cloud = trimesh.load(out / "surface.ply")
    rows = list(csv.DictReader((out / "surface.csv").read_text().splitlines()))
    summary = json.loads((out / "surface.json").read_text())
    n = summary["frames"][0]["n_points"]
    assert n == len(rows) == len(cloud.vertices) > 500
    np.testing.assert_allclose(cloud.vertices, [[float(row[axis]) for axis in "xyz"] for row in rows], atol=1e-6)
    assert all(float(row["sigma"]) > 0 and row["left_x"] for row in rows)
    for name in ("matches.png", "cloud.png"):
        assert cv2.imread(str(out / name)).std() > 10
    assert not list(out.glob("*.part"))
    assert {"growth", "matching", "name"} <= set(summary["config"])


def test_nothing_is_written_where_nothing_can_be_measured(folder):
    cv2.imwrite(str(folder / "left.png"), np.full((*SIZE[::-1], 3), 77, np.uint8))
    result = run_command(folder)
    assert isinstance(result.exception, TrackerError)
    assert "blank" in str(result.exception)
    assert not (folder / "out").exists()


def test_results_are_not_overwritten(folder):
    (folder / "out").mkdir()
    (folder / "out" / "notes.txt").write_text("mine")
    assert "is not empty" in str(run_command(folder).exception)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("matching.patch_pix=13", 'unknown key "patch_pix"; did you mean "patch_px"'),
        ("groth.step_px=2", 'unknown section "groth"; did you mean "growth"'),
        ("matching.patch_px=12", "expected an odd number"),
        ("growth.order=spiral", "best_first"),
        ("reading.path={view}.jpg", 'view "left": no file'),
    ],
)
def test_mistakes_in_the_configuration_are_named(folder, override, message):
    result = run_command(folder, "--set", override)
    assert isinstance(result.exception, TrackerError)
    assert message in str(result.exception)


def test_a_described_run_loads_to_an_equal_one(folder, tmp_path):
    run = load_job("surface", folder / "surface.toml")
    (tmp_path / "again.toml").write_text(tomli_w.dumps(described(run)))
    assert load_job("surface", tmp_path / "again.toml") == run


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_the_configurations_load_to_what_they_describe(path, monkeypatch, tmp_path):
    monkeypatch.setenv("BODYTRACK_DATA", "/recordings")
    run = load_job("surface", path)
    (tmp_path / "again.toml").write_text(tomli_w.dumps(described(run)))
    assert load_job("surface", tmp_path / "again.toml") == run
    assert run.name == path.stem


def test_still_pictures_are_a_recording_of_one_frame(folder, rig):
    sequence = StillReading(path=str(folder / "{view}.png"), rig=folder / "rig.toml", downscale=2).open()
    frames = list(sequence.frames())
    assert [frame.index for frame in frames] == [0]
    assert frames[0].images[0].shape == (90, 120, 3)
    (folder / "left.png").write_bytes(b"no image")
    with pytest.raises(SequenceError, match="not an image"):
        list(StillReading(path=str(folder / "{view}.png"), rig=folder / "rig.toml").open().frames())


def test_middlebury_cameras_are_read(folder, rig):
    camera = rig.cameras[0]
    numbers = [*camera.matrix.ravel(), *camera.camera_from_world[:3, :3].ravel(), *camera.camera_from_world[:3, 3]]
    line = "left.png " + " ".join(f"{value:.17g}" for value in numbers)
    absent = line.replace("left", "absent")
    (folder / "plane_par.txt").write_text(f"2\n{line}\n{absent}\n")
    read = load_rig(folder / "plane_par.txt")
    assert read.names == ("left",)
    assert read.cameras[0].size == SIZE
    np.testing.assert_allclose(read.cameras[0].camera_from_world, camera.camera_from_world)
    (folder / "plane_par.txt").write_text("1\nleft.png 1 2 3\n")
    with pytest.raises(TrackerError, match="3 numbers found, expected 21"):
        load_rig(folder / "plane_par.txt")
