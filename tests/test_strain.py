"""Strain of a surface between followed points, and how far it slides over the bones of a body."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from followed import on_body, outer, written
from motions import LOST, made_up
from typer.testing import CliRunner

from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError, TrackerError
from tracker.points.strain import gauges_of, near, smoothed, spacing_m, strains_of
from tracker.results.result import load_result
from tracker.running.cli import app
from tracker.running.skin_strain import Asked, on_bones, slides, strain_followed

TURN = cv2.Rodrigues(np.array([0.4, -0.7, 0.2]))[0]


def sheet(n: int = 13, step_m: float = 0.005) -> Array:
    """(N, 2) a grid on a plane, metres."""
    places = step_m * (np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2) - (n - 1) / 2)
    return np.asarray(places, dtype=np.float64)


def in_space(flat: Array, height: Array | float = 0.0) -> Array:
    return np.column_stack([flat, np.broadcast_to(height, len(flat))]) @ TURN.T + [0.3, -0.2, 1.4]


def test_a_sheet_that_is_stretched_and_sheared_has_these_strains() -> None:
    """And whatever turns and moves it besides has none."""
    flat = sheet()
    stretch = np.array([[1.08, 0.03], [0.0, 0.96]])
    sizes, directions = np.linalg.eigh(stretch @ stretch.T)
    found = strains_of(gauges_of(np.column_stack([flat, np.zeros(len(flat))]), 0.0125), in_space(flat @ stretch.T), 0.0)
    known = np.isfinite(found.stretches[:, 0])
    assert known.all()
    np.testing.assert_allclose(found.stretches, np.tile(np.sqrt(sizes[::-1]) - 1, (len(flat), 1)), atol=1e-9)
    np.testing.assert_allclose(found.shear, np.sqrt(sizes[1]) - np.sqrt(sizes[0]), atol=1e-9)
    along = np.abs(found.directions @ (TURN @ [*directions[:, 1], 0.0]))
    np.testing.assert_allclose(along, 1.0, atol=1e-9)
    still = strains_of(gauges_of(in_space(flat), 0.0125), np.column_stack([flat, np.zeros(len(flat))]), 0.0)
    np.testing.assert_allclose(still.stretches, 0.0, atol=1e-9)


def test_bending_is_hardly_a_strain() -> None:
    """A sheet that is rolled round a limb of 50 mm keeps its lengths; chords of 12 mm are shorter by 0.2 %."""
    flat, radius = sheet(21), 0.05
    angle = flat[:, 0] / radius
    rolled = np.column_stack([radius * np.sin(angle), flat[:, 1], radius * np.cos(angle)])
    found = strains_of(gauges_of(in_space(flat), 0.0125), rolled, 0.0)
    inner = (np.abs(flat) < 0.035).all(axis=1)
    assert np.abs(found.stretches[inner]).max() < 0.01
    assert np.abs(np.median(found.stretches[inner])) < 0.004


@pytest.mark.parametrize("patch_m", [0.0, 0.015])
def test_sigmas_are_as_large_as_the_errors(patch_m: float) -> None:
    """Of independent errors, and of errors that neighbours share as patches that overlap do."""
    flat, rng, sigma_m = sheet(25), np.random.default_rng(3), 5e-5
    gaps = np.linalg.norm(flat[:, None] - flat[None], axis=-1)
    shared = np.maximum(1 - gaps / (np.sqrt(2) * patch_m), 0) ** 2 if patch_m else np.eye(len(flat))
    values, vectors = np.linalg.eigh(shared)
    root = vectors * np.sqrt(np.maximum(values, 0))
    gauges, ratios = gauges_of(in_space(flat), 0.0125), []
    for _ in range(4):
        noise = sigma_m * root @ rng.normal(size=(len(flat), 3))
        found = strains_of(gauges, 1.03 * (in_space(flat) + noise), patch_m)
        # both strains are the same here: the mean does not know which one is the larger
        ratios.append((found.stretches.mean(axis=1) - 0.03) / (found.sigmas.mean(axis=1) / np.sqrt(2)))
    assert 0.8 < np.std(ratios) < 1.25
    if patch_m:
        alone = strains_of(gauges, 1.03 * (in_space(flat) + noise), 0.0)
        assert np.median(alone.sigmas) < 0.7 * np.median(found.sigmas), "else the correlation would be of no account"


def test_a_point_that_follows_something_else_is_left_out() -> None:
    flat = sheet()
    moved = in_space(1.05 * flat)
    moved[84] += [0.004, 0.0, 0.003]  # in the middle
    found = strains_of(gauges_of(in_space(flat), 0.0125), moved, 0.0)
    others = np.arange(len(flat)) != 84
    np.testing.assert_allclose(found.stretches[others], 0.05, atol=1e-6)


def test_of_too_few_points_and_of_points_in_a_line_nothing_is_said() -> None:
    flat = sheet()
    lone = gauges_of(in_space(flat[:13]), 0.0125)
    assert np.isnan(strains_of(lone, in_space(1.1 * flat[:13]), 0.0).stretches).all()
    moved = in_space(1.1 * flat)
    moved[flat[:, 1] > 1e-6] = np.nan
    moved[flat[:, 1] < -0.006] = np.nan
    found = strains_of(gauges_of(in_space(flat), 0.0125), moved, 0.0)
    row = np.abs(flat[:, 1]) < 1e-6
    np.testing.assert_allclose(found.stretches[row], 0.1, atol=1e-9)
    assert np.isnan(found.stretches[~np.isfinite(moved[:, 0])]).all()
    moved[np.abs(flat[:, 1] + 0.005) < 1e-6] = np.nan  # what is left is a line
    assert np.isnan(strains_of(gauges_of(in_space(flat), 0.0125), moved, 0.0).stretches).all()


def test_depths_are_smoothed_and_nothing_else() -> None:
    """Cameras beside one another know depth six times worse: over a curved surface that noise nearly goes."""
    flat, rng = sheet(21), np.random.default_rng(5)
    depth, lateral = 3e-4, 5e-5
    true = in_space(flat, 4.0 * flat[:, 0] ** 2)
    noise = np.column_stack([lateral * rng.normal(size=(len(flat), 2)), depth * rng.normal(size=len(flat))])
    covariance = TURN @ np.diag([lateral**2, lateral**2, depth**2]) @ TURN.T
    noisy = true + noise @ TURN.T
    found = smoothed(noisy, np.tile(covariance, (len(flat), 1, 1)), near(noisy, 0.0225))
    off, before = (found - true) @ TURN, (noisy - true) @ TURN
    inner = (np.abs(flat) < 0.035).all(axis=1)
    assert off[inner, 2].std() < 0.3 * before[inner, 2].std()
    np.testing.assert_allclose(off[:, :2], before[:, :2], atol=1e-9)
    alike = smoothed(noisy, np.tile(lateral**2 * np.eye(3), (len(flat), 1, 1)), near(noisy, 0.0225))
    np.testing.assert_array_equal(alike, noisy, "no direction is known worst")
    lone = smoothed(noisy[:5], np.tile(covariance, (5, 1, 1)), near(noisy[:5], 0.0225))
    np.testing.assert_array_equal(lone, noisy[:5])


def test_a_spacing_is_that_of_neighbours() -> None:
    assert spacing_m(in_space(sheet())) == pytest.approx(0.005)
    assert np.isnan(spacing_m(in_space(sheet())[:1]))


def test_skin_that_slides_over_a_bone_is_told_of_that_segment_alone() -> None:
    """The body moves; the skin of a thigh slides 8 mm along it, all other skin moves with its bone."""
    movement = made_up("gavrila22")
    body, (begun, now) = movement.scene.persons[0].body, [movement.steps[t].estimates[0] for t in (0, 8)]
    points = on_body(body)
    thigh = [part.name for part in body.parts].index("left_thigh")
    kept = outer(body, points, begun.q)
    first = points.in_world(body, begun.q)[0][kept]
    shifted = points.place + np.where((points.part == thigh)[:, None], [0.0, 0.0, 0.008], 0.0)
    last = replace(points, place=shifted).in_world(body, now.q)[0][kept]
    known = {one.segment: one for one in slides(on_bones(body, begun, first), now, last)}
    own = known.pop(body.parts[thigh].segment)
    assert own.slide_m == pytest.approx(0.008, abs=0.0012)
    assert len(known) > 6
    for one in known.values():
        assert one.slide_m < 1e-6, one.segment
        assert abs(one.lift_m) < 1e-6
    off = slides(on_bones(body, begun, first), replace(now, covariance=1e-4 * np.eye(body.dof)), last)
    assert all(0.003 < one.sigma_m < 0.06 for one in off)


def test_points_that_are_not_on_the_body_are_refused() -> None:
    movement = made_up("gavrila22")
    body, begun = movement.scene.persons[0].body, movement.steps[0].estimates[0]
    world = on_body(body).in_world(body, begun.q)[0]
    with pytest.raises(SequenceError, match="in the world of one calibration"):
        on_bones(body, begun, world + np.array([2.0, 0.0, 0.0]))


@pytest.fixture
def followed(tmp_path: Path) -> Path:
    """A following of 12 frames: the points of a sheet before the first camera of a rig, stretched by 1 % a frame."""
    rig = made_up("gavrila22").scene.rig
    save_rig(rig, tmp_path / "rig.toml")
    camera, flat = rig.cameras[0], sheet()
    middle, axes = camera.centre + 2.0 * camera.camera_from_world[2, :3], camera.camera_from_world[:2, :3]
    places = np.array([middle + (1 + 0.01 * t) * flat @ axes for t in range(12)])
    written(places, 1e-4, 1e-5, tmp_path / "trajectories.csv")
    told = {"config": {"following": {"matching": {"patch_px": 13}}}}
    (tmp_path / "follow.json").write_text(json.dumps(told))
    return tmp_path


def run(*arguments: str) -> str:
    done = CliRunner().invoke(app, ["strain", *arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_the_command_writes_a_table_and_a_picture_a_frame(followed: Path) -> None:
    told = run(str(followed), "--every", "5", "--view", str(load_rig(followed / "rig.toml").names[0]))
    folder = followed / "strain"
    assert sorted(path.name for path in folder.iterdir()) == [
        *("strain.csv", "strain_000005.png", "strain_000010.png", "strain_000011.png")
    ]
    assert "pictures without images" in told  # the recording is not there
    with (folder / "strain.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["frame"] for row in rows} == {"5", "10", "11"}
    last = [row for row in rows if row["frame"] == "11"]
    assert len(last) == 169
    strains = np.array([[float(row[f"stretch_{k}"]) for k in (1, 2)] for row in last])
    sigmas = np.array([[float(row[f"sigma_{k}"]) for k in (1, 2)] for row in last])
    np.testing.assert_allclose(strains.mean(axis=0), 0.11, atol=0.002)
    assert (np.abs(strains - 0.11) < 5 * sigmas).mean() > 0.95
    assert cv2.imread(str(folder / "strain_000011.png")).shape[1] > 1000
    with pytest.raises(TrackerError, match="--overwrite"):
        run(str(followed))
    run(str(followed), "--reference", "11", "--frames", "0:1", "--overwrite")
    with (folder / "strain.csv").open() as file:
        assert float(next(csv.DictReader(file))["stretch_1"]) == pytest.approx(1 / 1.11 - 1, abs=0.01)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--reference", "40"], "no frame 40; its frames are 0 to 11"),
        (["--frames", "30:"], "no frame to compare"),
        (["--frames", "x"], "expected A:B"),
        (["--view", "nort"], 'no view is called "nort"'),
        (["--person", "anna"], "--person needs --body: the result of a run"),
    ],
)
def test_what_cannot_be_is_one_line_and_nothing_is_written(followed: Path, options: list[str], words: str) -> None:
    with pytest.raises(TrackerError, match=words) as caught:
        run(str(followed), *options)
    assert "\n" not in str(caught.value)
    assert not (followed / "strain").exists()


def test_what_is_no_following_in_space_is_refused(followed: Path, tmp_path: Path) -> None:
    written(np.zeros((2, 3, 2)), 0.1, 0.1, followed / "trajectories.csv")
    with pytest.raises(TrackerError, match="strain needs points in space"):
        run(str(followed))
    (followed / "follow.json").write_text('{"config": {}}')
    with pytest.raises(TrackerError, match=r"damaged: no width of the patches"):
        run(str(followed))
    (followed / "follow.json").unlink()
    with pytest.raises(TrackerError, match="expected the result folder of `bodytrack follow`"):
        run(str(followed))


def test_sliding_is_told_beside_a_run(tmp_path: Path) -> None:
    movement = made_up("gavrila22")
    result, folder = movement.result(tmp_path / "result"), tmp_path / "followed"
    body, points = movement.scene.persons[0].body, on_body(movement.scene.persons[0].body)
    kept = outer(body, points, movement.steps[0].estimates[0].q)
    indices = [step.frame.index for step in movement.steps]
    places = np.full((indices[4] + 1, int(kept.sum()), 3), np.nan)
    for step in movement.steps[:5]:
        places[step.frame.index] = points.in_world(body, step.estimates[0].q)[0][kept]
    written(places, 1e-4, 1e-6, folder / "trajectories.csv")
    save_rig(movement.scene.rig, folder / "rig.toml")
    (folder / "follow.json").write_text('{"config": {"following": {"matching": {"patch_px": 13}}}}')
    told = run(str(folder), "--body", str(result), "--every", "1", "--gauge-mm", "60")
    assert "sliding over the bones" in told
    with (folder / "strain" / "slides.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {int(row["frame"]) for row in rows} == set(indices[1 : LOST.start]), "who is lost has no bones"
    assert max(float(row["slide_mm"]) for row in rows) < 0.02
    loaded = load_result(result)
    gone = replace(loaded, replays=loaded.replays[1:])
    with pytest.raises(TrackerError, match="is not found in frame"):
        strain_followed(folder, Asked(), (gone, "person1"), tmp_path / "other")
    assert not (tmp_path / "other").exists()
