"""Acquisition: models of known persons found again, honest sigmas, and every bad input refused by name."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
from observations import bent, four_views
from recordings import cycle_for, small_simulation
from test_shape_space import some_shape, space
from typer.testing import CliRunner

from tracker.acquisition.calibrated_views import (
    Seen,
    ViewSettings,
    Watching,
    _own,
    check_overlaps,
)
from tracker.acquisition.clouds import Look
from tracker.acquisition.fitting import Fit, FitSettings, Task, fit
from tracker.acquisition.pictures import Pair, Picture, orthographic_camera, read_silhouette
from tracker.acquisition.result import bone_lengths, model_of, stature_of
from tracker.acquisition.silhouette_task import SilhouetteSettings
from tracker.acquisition.two_silhouettes import _turn_deg, acquire, section_distances
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body, read_description, save_description
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.measures.outlines import outline_observation, overlap
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.tables import Table, read_config
from tracker.foundation.errors import SequenceError, TrackerError
from tracker.foundation.geometry.superquadrics import surface
from tracker.foundation.resources import model_path
from tracker.images.analysis.contours import ContourAnalysis
from tracker.running.cli import app
from tracker.running.jobs.acquire import _in_view, acquire_to, acquisition_from
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

SIZE, PX_PER_M = (440, 440), 200.0
CAMERA = orthographic_camera("picture", SIZE, PX_PER_M)
QUICK = SilhouetteSettings(fit=FitSettings(iterations=6, pose_m=0.5, pose_deg=6.0))


def t_pose(body: BodyModel, turn: float = 0.0, arms_deg: float = 85.0) -> Array:
    q = body.rest()
    q[:3] = 0.0, 0.0, 0.15
    q[body.index("torso_twist")] = -np.pi / 2 + turn
    for side in ("left", "right"):
        q[body.index(f"{side}_arm_abduction")] = np.radians(arms_deg)
        q[body.index(f"{side}_leg_abduction")] = np.radians(5)
    return q


def silhouette(body: BodyModel, q: Array) -> Mask:
    return CpuSynthesis().silhouettes(Scene((Person("one", body, q),), Rig((CAMERA,))))[0]


def stored(folder: Path, name: str, mask: Mask) -> Path:
    path = folder / f"{name}.png"
    cv2.imwrite(str(path), mask.astype(np.uint8) * 255)
    return path


def pair(folder: Path, front: Mask, side: Mask) -> Pair:
    return Pair(
        front=Picture(mask=stored(folder, "front", front), px_per_m=PX_PER_M),
        side=Picture(mask=stored(folder, "side", side), px_per_m=PX_PER_M),
    )


@pytest.fixture(scope="module")
def person() -> BodyModel:
    """Somebody who is not the general model."""
    of = space()
    return of.body(some_shape(of, seed=3, share=0.8))


def test_a_model_is_acquired_from_two_silhouettes(person: BodyModel, tmp_path: Path) -> None:
    front, side = silhouette(person, t_pose(person)), silhouette(person, t_pose(person, np.pi / 2))
    reported: list[str] = []
    found = acquire(
        read_description(model_path("gavrila22")),
        [pair(tmp_path, front, side)],
        stature_of(person),
        QUICK,
        lambda what, done, total: reported.append(what),
    )
    assert min(found.overlaps) > 0.955
    assert np.mean(found.overlaps) > np.mean(found.start_overlaps) + 0.03
    assert found.turns_deg[0] == pytest.approx(90, abs=6)
    assert set(reported) == {"fitting shape and pose", "searching the shape of each part"}
    true = dict(zip((part.name for part in person.parts), 2000 * person.shapes[:, :2], strict=True))
    got = dict(zip((part.name for part in found.fit.body.parts), 2000 * found.fit.body.shapes[:, :2], strict=True))
    for part in ("torso", "head", "left_thigh", "left_shin"):
        np.testing.assert_allclose(got[part], true[part], atol=25)


def test_lengths_and_sigmas_come_out_of_bent_poses_in_four_views(person: BodyModel) -> None:
    of, rig, synthesis = space(), four_views((720, 576)), CpuSynthesis()
    poses = [bent(person), bent(person)]
    poses[1][person.index("left_arm_extension")] = 1.6
    poses[1][person.index("right_leg_elevation")] = 0.9
    looks, starts = [], []
    for k, q in enumerate(poses):
        masks = synthesis.silhouettes(Scene((Person("one", person, q),), rig))
        columns = k * person.dof + np.arange(person.dof)
        looks.append(Look(rig, columns, outline_observation(masks)))
        starts.append(person.clamped(q + np.random.default_rng(k).normal(0, 0.03, person.dof)))
    settings = FitSettings(iterations=10, pose_deg=8.0, pose_m=0.05, rigid_share=0.2)
    found = fit(Task(of, tuple(looks), synthesis, settings), np.zeros(len(of.names)), np.concatenate(starts))
    places = {mark.name: mark.point for mark in person.landmarks}
    off, predicted = [], []
    for bone in bone_lengths(found):
        one, other = bone.bone.split("-")
        if any(joint in other for joint in ("elbow", "wrist", "knee", "ankle")):
            off.append(bone.length_mm - 1000 * np.linalg.norm(places[one] - places[other]))
            predicted.append(bone.sigma_mm)
    assert np.abs(off).max() < 20
    assert np.sqrt(np.mean(np.square(np.array(off) / predicted))) < 2
    for k, q in enumerate(poses):
        made, true = (
            synthesis.silhouettes(Scene((Person("one", body, pose),), rig))
            for body, pose in ((found.body, found.pose(k)), (person, q))
        )
        assert min(overlap(a, b) for a, b in zip(made, true, strict=True)) > 0.95


def test_a_clicked_joint_is_where_it_was_clicked(person: BodyModel, tmp_path: Path) -> None:
    q = t_pose(person)
    front, side = silhouette(person, q), silhouette(person, t_pose(person, np.pi / 2))
    pixels = CAMERA.project(person.landmarks_in_world(q))
    clicks = {
        name: tuple(pixels[k].tolist())
        for k, name in enumerate(person.landmark_names)
        if name.endswith(("hip", "knee", "ankle"))
    }
    given = pair(tmp_path, front, side)
    clicked = Pair(front=Picture(mask=given.front.mask, px_per_m=PX_PER_M, clicks=clicks), side=given.side)
    found = acquire(read_description(model_path("gavrila22")), [clicked], stature_of(person), QUICK)
    again = CAMERA.project(found.fit.body.landmarks_in_world(found.fit.pose(0)))
    off = [np.linalg.norm(again[person.landmark_names.index(name)] - clicks[name]) for name in clicks]
    assert max(off) < 5


def changed(front: Mask, side: Mask, what: str, person: BodyModel) -> tuple[Mask, Mask]:
    """A pair with one fault."""
    front, side = front.copy(), side.copy()
    rows, columns = np.nonzero(front)
    if what == "empty":
        side[:] = False
    elif what == "cut":
        front = np.roll(front, SIZE[1] - rows.max() + 20, axis=0)
        front[:100] = False
    elif what == "two":
        front |= np.roll(front, 190, axis=1) & (np.arange(SIZE[0]) > columns.max() + 3)
        front[:, columns.max() + 20 : columns.max() + 60] |= rows.min() < np.arange(SIZE[1])[:, None]
        front[-4:] = False
    elif what == "touching":
        front = np.roll(front, -25, axis=1) | np.roll(front, 25, axis=1)
    elif what == "swapped":
        front, side = side, front
    elif what == "turned":
        side = silhouette(person, t_pose(person, np.radians(62)))
    return front, side


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("empty", "side: the silhouette is empty"),
        ("cut", "front: the person is cut off at the bottom border"),
        ("two", "two persons"),
        ("touching", "front: the fitted body covers .* two persons that touch"),
        ("swapped", "front and side are swapped"),
        ("turned", r"the views are not orthogonal: between front and side the person is turned by (5[6-9]|6[0-8]) or"),
    ],
)
def test_bad_pairs_are_refused_by_name(person: BodyModel, tmp_path: Path, what: str, message: str) -> None:
    q = t_pose(person, arms_deg=80.0)
    if what in ("two", "touching"):
        q = t_pose(person, arms_deg=10.0 if what == "two" else 60.0)
    front, side = changed(silhouette(person, q), silhouette(person, t_pose(person, np.pi / 2)), what, person)
    few = SilhouetteSettings(fit=FitSettings(iterations=4, pose_m=0.5, pose_deg=6.0))
    with pytest.raises(SequenceError, match=message):
        acquire(read_description(model_path("gavrila22")), [pair(tmp_path, front, side)], stature_of(person), few)


def test_a_scale_that_contradicts_the_stature_is_refused(person: BodyModel, tmp_path: Path) -> None:
    """Else a body of 1.65 m covered 98 % of the silhouettes of somebody of 1.80 m: lengths were of neither."""
    given = pair(tmp_path, silhouette(person, t_pose(person)), silhouette(person, t_pose(person, np.pi / 2)))
    with pytest.raises(SequenceError, match=r"by its px_per_m, and 1\.\d\d m by stature_m: check both"):
        acquire(read_description(model_path("gavrila22")), [given], 0.9 * stature_of(person), QUICK)


def test_a_person_not_found_in_the_views_is_refused() -> None:
    with pytest.raises(SequenceError, match=r"covers 20% .* worst is view b with 10%"):
        check_overlaps(np.array([0.3, 0.1, np.nan]), ("a", "b", "c"), ViewSettings())
    check_overlaps(np.array([np.nan, np.nan]), ("a", "b"), ViewSettings())


def test_a_person_is_told_from_others_and_from_furniture() -> None:
    body, rig, synthesis = load_body(model_path("gavrila22")), four_views(), CpuSynthesis()
    persons = []
    for name, x in (("one", 0.5), ("other", -0.5)):
        q = t_pose(body, arms_deg=20.0)
        q[:3] = x, 0.0, 1.24
        persons.append(Person(name, body, q))
    both, one = (synthesis.silhouettes(Scene(tuple(some), rig)) for some in (persons, persons[:1]))
    other = synthesis.silhouettes(Scene((persons[1],), rig))
    masks = [mask.copy() for mask in both]
    masks[0][:40, :40] = True
    watching = Watching(rig, synthesis, ContourAnalysis(), (None,) * len(rig))
    seen = Seen(Frame(0, 0.0, (None,) * len(rig)), Scene(tuple(persons), rig))
    found = _own((*masks[:-1], None), seen, 0, watching)
    assert found[-1] is None
    kept = [v for v, mask in enumerate(found) if mask is not None]
    assert kept == [v for v in range(len(rig) - 1) if not (one[v] & other[v]).any()]
    assert kept
    for v in kept:
        np.testing.assert_array_equal(found[v], one[v])


def test_the_section_search_prefers_the_true_radius() -> None:
    true = np.array([0.08, 0.06, 0.2, 0.5, 1.0, -0.2, -0.2])
    eta = np.linspace(-1.3, 1.3, 150)
    points = np.concatenate(
        [surface(true, eta, np.full_like(eta, omega))[0][:, [1, 2]] for omega in (-np.pi / 2, np.pi / 2)]
    )
    tried = np.repeat(true[None], 5, axis=0)
    tried[:, 1] *= [0.8, 0.9, 1.0, 1.1, 1.2]
    distances = section_distances(tried, 1, points)
    assert int(np.argmin(distances)) == 2
    assert distances[2] < 0.6 * distances[[1, 3]].min()


def test_a_model_is_saved_with_its_sigmas_and_loads_again(person: BodyModel, tmp_path: Path) -> None:
    of, synthesis, q = space(), CpuSynthesis(), t_pose(person)
    look = Look(Rig((CAMERA,)), np.arange(person.dof), outline_observation((silhouette(person, q),)))
    found = fit(Task(of, (look,), synthesis, FitSettings(iterations=2)), np.zeros(len(of.names)), q)
    description = model_of(found, "somebody", "for a test")
    save_description(description, tmp_path / "new" / "somebody.toml")
    again = read_description(tmp_path / "new" / "somebody.toml")
    assert again.name == "somebody"
    assert again.sigmas["left_hip-left_knee.length"] == pytest.approx(
        description.sigmas["left_hip-left_knee.length"], abs=1e-5
    )
    body = load_body(tmp_path / "new" / "somebody.toml")
    np.testing.assert_allclose(body.shapes, found.body.shapes, atol=2e-5)
    np.testing.assert_allclose(body.landmarks_in_world(q), found.body.landmarks_in_world(q), atol=5e-5)
    assert body.stature_m == pytest.approx(1.8, abs=0.1)


def test_the_command_writes_model_picture_and_figures(person: BodyModel, tmp_path: Path) -> None:
    given = pair(tmp_path, silhouette(person, t_pose(person)), silhouette(person, t_pose(person, np.pi / 2)))
    views = {view: {"mask": getattr(given, view).mask.name, "px_per_m": PX_PER_M} for view in ("front", "side")}
    config, output = tmp_path / "somebody.toml", tmp_path / "out" / "somebody.toml"
    config.write_text(tomli_w.dumps({"name": "somebody", "pairs": [views]}))
    few = ["--set", "acquisition.fit.iterations=2", "--set", "acquisition.fit.pose_m=0.5"]
    done = CliRunner().invoke(app, ["acquire", str(config), "--output", str(output), *few])
    assert done.exit_code == 0, done.output
    assert "silhouette IoU front: 0.9" in done.output
    assert "left hip - left knee" in done.output
    assert output.with_suffix(".png").stat().st_size > 20_000
    assert json.loads(output.with_suffix(".json").read_text())["overlaps"]["front"] > 0.9
    assert load_body(output).name == "somebody"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, r"expected either \[\[pairs\]\]"),
        ({"pairs": [], "reading": {}}, r"expected either \[\[pairs\]\]"),
        ({"pairs": [{"front": {}}]}, r"\[pairs 1\]: the key .* is missing"),
        ({"pairs": [{"front": {"msk": "a"}, "side": {}}]}, r'unknown key "msk"; did you mean "mask"'),
        ({"pairs": [{"front": {}, "side": {}}]}, "front: give a mask, or an image and its background"),
        (
            {"pairs": [{"front": {}, "side": {}}], "stature_m": 180},
            "stature_m = 180: .* less than or equal to 5 .height of the person, metres",
        ),
        ({"pairs": [{"front": {"mask": "no.png"}, "side": {}}]}, "front: no file"),
        ({"paris": [], "pairs": [{}]}, 'unknown key "paris"; did you mean "pairs"'),
    ],
)
def test_a_file_that_describes_no_acquisition_is_one_line(table: Table, message: str, tmp_path: Path) -> None:
    with pytest.raises(TrackerError, match=message) as caught:
        acquire_to(acquisition_from(table, "config.toml", tmp_path, "config"), tmp_path / "out" / "one.toml")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_silhouette_comes_from_image_and_background(person: BodyModel, tmp_path: Path) -> None:
    mask, rng = silhouette(person, t_pose(person)), np.random.default_rng(0)
    plate = rng.integers(90, 110, (*mask.shape, 3)).astype(np.uint8)
    image = np.where(mask[..., None], np.uint8(200), plate)
    for name, picture in (("image", image), ("plate", plate)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture)
    given = Picture(image=tmp_path / "image.png", background=tmp_path / "plate.png")
    found = read_silhouette(given, "front", stature_of(person))
    # Smoothing lets the foreground grow by a pixel all around, and limbs are 20 px wide here.
    assert overlap(found.mask, mask) > 0.9
    assert found.camera.matrix[0, 0] / 1000 == pytest.approx(PX_PER_M, rel=0.02)


@pytest.mark.parametrize("name", ["silhouettes", "balancing_tpose"])
def test_the_acquisition_files_can_be_used(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("BODYTRACK_DATA", str(tmp_path))
    config = Path(__file__).parents[1] / "configs" / "acquisition" / f"{name}.toml"
    # Everything is read and checked before the first picture or video is missed.
    with pytest.raises(TrackerError, match=r"no file|calibration"):
        acquire_to(acquisition_from(read_config(config), name, config.parent, name), tmp_path / "one.toml")


def test_who_comes_in_late_is_still_seen_in_as_many_frames() -> None:
    class Late:
        n_frames = 50

        def frames(self) -> Iterator[Frame]:
            return (Frame(2 * n + 10, 0.0, ()) for n in range(self.n_frames))

    cycle = replace(cycle_for(small_simulation(n_frames=1)), nobody_before=60)
    frames, n_frames = _in_view(Late(), cycle)  # type: ignore[arg-type]
    assert [frame.index for frame in frames] == list(range(60, 110, 2))
    assert n_frames == 25


def test_the_turn_between_views_is_seen_along_the_lines_of_sight(person: BodyModel) -> None:
    """Two cameras at a right angle, as seen by the person, whatever they look at beside her."""
    looks, poses = [], []
    for n, name in enumerate(("front", "side")):
        place = np.array([(4.0, 0.0, 1.0), (0.0, 4.0, 1.0)][n])
        aim = (0.6, 0.9, 1.0) if n == 0 else (0.9, -0.6, 1.0)
        camera = Camera.looking_at(name, (800, 600), 600.0, tuple(place.tolist()), np.array(aim))
        looks.append(Look(Rig((camera,)), n * person.dof + np.arange(person.dof)))
        poses.append(person.rest())
    of = space()
    found = Fit(of, tuple(looks), np.zeros(len(of.names)), np.concatenate(poses), np.eye(1))
    assert _turn_deg(person, found, 0) == pytest.approx(90)


def test_a_model_is_refined_over_the_frames_of_a_run(tmp_path: Path) -> None:
    folder = tmp_path / "sequence"
    write_sequence(Recipe("arm_swing", seconds=0.08, size=(320, 256)), folder)
    table = read_config(folder / "config.toml")
    table["initialization"] = {"use": "given", "poses": str(folder / "truth_poses.csv")}
    table |= {"evidence": {"use": "contours"}, "estimation": {"use": "twist_icp"}}
    table["acquisition"] = {"frames": 2, "rounds": 2, "fit": {"iterations": 4, "pose_deg": 8.0, "pose_m": 0.05}}
    said: list[str] = []
    job = acquisition_from(table, "config.toml", folder, "one")
    result = acquire_to(job, tmp_path / "one.toml", lambda what, *_: said.append(what))
    assert {"start: search for person1 in frame 0", "tracking", "fitting shape and pose"} == set(said)
    true = load_body(folder / "model.toml")
    places = {mark.name: mark.point for mark in true.landmarks}
    for bone in result.bones:
        one, other = bone.bone.split("-")
        # The model was right to begin with: refining must not spoil it.
        assert bone.length_mm == pytest.approx(1000 * np.linalg.norm(places[one] - places[other]), abs=20)
    assert result.picture.is_file()
    with pytest.raises(TrackerError, match='no person "eva"'):
        acquisition_from(table | {"acquisition": {"person": "eva"}}, "config.toml", folder, "two").open()
