"""Starts: chosen by what the recording has, refused before the first frame, found without plates."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from observations import four_views
from recordings import cycle_for, joint_errors_mm, small_simulation
from typer.testing import CliRunner

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.contours import ContourEvidence
from tracker.foundation.errors import ConfigError, InitializationError
from tracker.foundation.resources import model_path
from tracker.images.plate import Plate
from tracker.running.cli import _told, app
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, Simulation, write_sequence
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._floor import floor_places
from tracker.tracking.initialization._stance_search import direction_images, on_floor, posed, turned
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.given import GivenInitialization
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.initialization.stance import StanceInitialization

RIG = four_views()
NEAR_M = 6.0
"""Floor that is searched: cameras stand 5 m away at the most, and floor far behind them takes most of the time."""

PLATE = Plate(np.zeros((8, 8, 3), np.uint8))


def scene_of(body: BodyModel, *names: str) -> Scene:
    return Scene(tuple(Person(name, body, body.rest()) for name in names), RIG)


def plates(n: int) -> tuple[Plate | None, ...]:
    return tuple(PLATE if v < n else None for v in range(len(RIG)))


def start_file(path: Path, body: BodyModel, **changes: str) -> Path:
    row = {"frame": "0", "person": "anna"} | {parameter.column: "0" for parameter in body.parameters} | changes
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, row)
        writer.writeheader()
        writer.writerow(row)
    return path


# Chosen by what there is


@pytest.mark.parametrize(("n_plates", "told"), [(4, "pca, the background plates of 4"), (2, "of 2"), (0, "stance, no")])
def test_the_start_is_chosen_by_the_plates(body: BodyModel, n_plates: int, told: str) -> None:
    assert told in AutoInitialization().check(scene_of(body, "anna"), plates(n_plates))


def test_given_poses_come_first(body: BodyModel, tmp_path: Path) -> None:
    path = start_file(tmp_path / "start.csv", body, torso_x_m="0.5")
    chosen = AutoInitialization(poses=path)
    assert "given" in chosen.check(scene_of(body, "anna"), plates(4))
    stages = Stages(CpuSynthesis(), ContourEvidence(), HybridEstimation(), plates(4))
    start = chosen.start(Frame(0, 0.0, (None,) * 4), scene_of(body, "anna"), stages)
    assert start.poses[0][body.index("torso_x")] == 0.5


# Refused before the first frame


@pytest.mark.parametrize(
    ("initialization", "persons", "n_plates", "message"),
    [
        (AutoInitialization(), 1, 1, "one view has a background plate"),
        (PcaInitialization(), 1, 1, r"at least two views, 1 given \(none of b, c, d\)"),
        (PcaInitialization(), 1, 0, "0 given"),
        (StanceInitialization(floor_m=9.0), 1, 0, "no place on the floor"),
    ],
)
def test_what_cannot_work_is_refused(
    body: BodyModel,
    initialization: AutoInitialization | PcaInitialization | StanceInitialization,
    persons: int,
    n_plates: int,
    message: str,
) -> None:
    with pytest.raises(ConfigError, match=message):
        initialization.check(scene_of(body, *"ab"[:persons]), plates(n_plates))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"person": "ana"}, 'no start pose of person "anna"; did you mean "ana"'),
        ({"status": "lost"}, 'no start pose of person "anna"; none is there'),
        ({"torso_x_m": "nan"}, '"torso_x_m" is .nan., expected a finite number'),
        ({"torso_x_m": "west"}, '"torso_x_m" is .west., expected a finite number'),
        ({"frame": ""}, '"frame" is .., expected a finite number'),
        ({"left_arm_extension_deg": "-20"}, '"left_arm_extension_deg" is -20, outside the limits 0 to 150 deg'),
    ],
)
def test_a_start_file_is_read_before_the_first_frame(
    body: BodyModel, tmp_path: Path, changes: dict[str, str], message: str
) -> None:
    path = start_file(tmp_path / "start.csv", body, **changes)
    with pytest.raises(ConfigError, match=message):
        GivenInitialization(poses=path).check(scene_of(body, "anna"), plates(0))


def test_a_misnamed_start_file_is_answered_with_the_nearest(body: BodyModel, tmp_path: Path) -> None:
    start_file(tmp_path / "start.csv", body)
    with pytest.raises(ConfigError, match=r'strat.csv: no such file of start poses; did you mean "start.csv"'):
        GivenInitialization(poses=tmp_path / "strat.csv").check(scene_of(body, "anna"), plates(0))
    with pytest.raises(ConfigError, match=r"start.csv: no such file of start poses; none is there"):
        GivenInitialization(poses=tmp_path / "empty" / "start.csv").check(scene_of(body, "anna"), plates(0))


def test_a_table_that_does_not_say_whose_poses_it_has(body: BodyModel, tmp_path: Path) -> None:
    path = start_file(tmp_path / "start.csv", body)
    path.write_text(path.read_text().replace("person", "persons", 1))
    with pytest.raises(ConfigError, match='no column "person"; did you mean "persons"'):
        GivenInitialization(poses=path).check(scene_of(body, "anna"), plates(0))


def test_a_missing_column_is_answered_with_the_nearest(body: BodyModel, tmp_path: Path) -> None:
    path = start_file(tmp_path / "start.csv", body)
    path.write_text(path.read_text().replace("torso_twist_deg", "torso_turn_deg"))
    with pytest.raises(ConfigError, match='no column "torso_twist_deg" of model "gavrila22"; did you mean'):
        GivenInitialization(poses=path).check(scene_of(body, "anna"), plates(0))


def test_a_wrong_start_leaves_nothing_and_ends_with_2(tmp_path: Path) -> None:
    config = write_sequence(Recipe("arm_swing", seconds=0.08, size=(180, 144)), tmp_path / "sequence")
    wrong = ["--set", "initialization.poses=nowhere.csv"]
    done = CliRunner().invoke(app, ["run", str(config), "--output", str(tmp_path / "out"), *wrong])
    assert isinstance(done.exception, ConfigError)
    told, code = _told(done.exception)
    assert code == 2
    assert "no such file of start poses" in told
    assert len(told.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


# The floor


def test_all_floor_that_two_views_show_is_searched() -> None:
    """Also behind a camera, where another two look."""
    places = floor_places(RIG, 0.0, 0.25, 10.0)
    points = np.concatenate([places, np.zeros((len(places), 1))], axis=1)
    seen = sum(
        ((camera.project(points) > 0) & (camera.project(points) < np.array(camera.size) - 1)).all(axis=1)
        for camera in RIG.cameras
    )
    assert seen.min() >= 2
    centres = np.array([camera.centre[:2] for camera in RIG.cameras])
    assert ((places < centres.min(axis=0)) | (places > centres.max(axis=0))).any()
    again = floor_places(Rig(RIG.cameras[:2]), 0.0, 0.25, 10.0)
    assert len(again) < len(places)


@pytest.mark.parametrize("floor_m", [0.0, 0.4])
def test_the_places_are_on_the_floor_that_is_told(floor_m: float) -> None:
    (alone,) = Rig(RIG.cameras[:1]).cameras
    places = floor_places(Rig((alone,)), floor_m, 0.5, 6.0)
    points = np.concatenate([places, np.full((len(places), 1), floor_m)], axis=1)
    assert (np.linalg.norm(points - alone.centre, axis=1) <= 6.0).all()
    assert ((alone.project(points) >= 0).all(axis=1)).all()


# Found without plates


def drawn(scene: Scene) -> Frame:
    """A person of one colour before walls of another."""
    masks = CpuSynthesis().silhouettes(scene)
    return Frame(0, 0.0, tuple(np.where(mask[..., None], (60, 90, 160), 190).astype(np.uint8) for mask in masks))


@pytest.mark.parametrize("arms_deg", [85.0, 10.0])
def test_a_standing_person_is_found_on_edges_alone(body: BodyModel, arms_deg: float) -> None:
    q = posed(body, {"arm_abduction": arms_deg, "leg_abduction": 5.0})
    (q,) = on_floor(body, turned(body, q, np.array([0.5])), np.array([[0.23, -0.31]]), 0.0)
    scene = Scene((Person("one", body, q),), RIG)
    stages = Stages(CpuSynthesis(), ContourEvidence(), HybridEstimation(), (None,) * 4)
    standing = body.start.stances_deg[:3]
    search = StanceInitialization(stances_deg=standing, hypotheses=3, farthest_m=NEAR_M)
    start = search.start(drawn(scene), scene, stages)
    off = body.landmarks_in_world(np.array([one.q for one in start.hypotheses[0]])) - body.landmarks_in_world(q)
    assert np.linalg.norm(off, axis=2).mean(axis=1).min() < 0.03


def without_plates(simulation: Simulation) -> Stages:
    return replace(cycle_for(simulation).stages, plates=(None,) * 4)


def test_someone_crouching_in_a_cluttered_room_is_found() -> None:
    simulation = small_simulation("squat", n_frames=31)
    # where they are deepest, alone: to draw the frames before takes longer than the start
    recipe = replace(simulation.recipe, seconds=1 / 25)
    simulation = replace(simulation, recipe=recipe, poses=(simulation.poses[0][30:],))
    deepest = next(simulation.frames())
    crouching = simulation.scene.persons[0].body.start.stances_deg[6:8]
    initialization = StanceInitialization(stances_deg=crouching, hypotheses=2)
    start = initialization.start(deepest, simulation.scene, without_plates(simulation))
    errors = [joint_errors_mm(simulation, 0, 0, one.q).mean() for one in start.hypotheses[0]]
    assert min(errors) < 30
    # one that faces away is there as well, however little speaks for it: the frames after may
    turns_deg = np.array([one.turn_deg for one in start.hypotheses[0]])
    assert np.abs((turns_deg - turns_deg[0] + 180) % 360 - 180).max() > 90


def test_an_empty_room_is_empty() -> None:
    """Furniture offers contours of which nine tenths lie on edges; those of a person lie on edges in all views."""
    simulation = small_simulation(n_frames=1)
    empty = Frame(0, 0.0, tuple(plate.picture for plate in simulation.plates))
    scene = simulation.scene
    search = StanceInitialization(stances_deg=scene.persons[0].body.start.stances_deg[:3], hypotheses=2)
    with pytest.raises(InitializationError, match=r"frame 0: .* expected at least 0.16"):
        search.start(empty, scene, without_plates(simulation))


# Stances


@pytest.mark.parametrize("name", ["gavrila22", "human", "quadruped"])
@pytest.mark.parametrize("pitch_deg", [0.0, 40.0])
def test_a_turned_stance_is_the_stance_seen_from_elsewhere(name: str, pitch_deg: float) -> None:
    body = load_body(model_path(name))
    q = body.rest()
    q[body.root.columns[-2]] = np.radians(pitch_deg)
    headings = np.radians([-130.0, 0.0, 20.0, 95.0])
    poses = turned(body, q, headings)
    marks = body.landmarks_in_world(q)
    for heading, found in zip(headings, body.landmarks_in_world(poses), strict=True):
        cos, sin = np.cos(heading), np.sin(heading)
        expected = marks @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_stance_stands_on_the_floor_where_it_is_put(body: BodyModel) -> None:
    poses = turned(body, posed(body, {"leg_elevation": 90.0, "leg_extension": 90.0}), np.radians([0.0, 50.0]))
    placed = on_floor(body, poses, np.array([[1.0, 2.0], [-1.0, 0.5]]), 0.3)
    marks = body.landmarks_in_world(placed)
    middles = (marks.min(axis=1) + marks.max(axis=1)) / 2
    np.testing.assert_allclose(middles[:, :2], [[1.0, 2.0], [-1.0, 0.5]], atol=1e-9)
    ankles = [body.landmark_names.index(f"{side}_ankle") for side in ("left", "right")]
    assert ((marks[:, ankles, 2] > 0.3) & (marks[:, ankles, 2] < 0.45)).all()


# Edges and their directions


def bar(image_size: tuple[int, int], upright: bool) -> np.ndarray:
    picture = np.full((*image_size[::-1], 3), 40, np.uint8)
    if upright:
        picture[:, 150:210] = 200
    else:
        picture[110:170] = 200
    return picture


@pytest.mark.parametrize("upright", [True, False])
def test_contours_gain_on_edges_of_their_own_direction_only(body: BodyModel, upright: bool) -> None:
    size = (360, 288)
    edges = direction_images(Frame(0, 0.0, (bar(size, upright), None)), 0.035)
    rows = np.linspace(30, 250, 40)
    samples = np.zeros((1, 2, 60, 5), np.float32)
    samples[0, 0, :40] = np.stack([np.full(40, 150.0), rows, np.ones(40), np.zeros(40), np.ones(40)], axis=1)
    samples[0, 0, 40:] = np.nan
    counts = np.array([[40, 0]])
    filler = np.zeros((1, 2, 60), np.int64)
    contours = Contours(samples, samples[..., :3], filler, filler > 0, counts)
    (found,) = edges.scores(contours)
    assert found[1] == 0
    assert (found[0] > 0.5) == upright
    assert upright or found[0] <= 0.05
