"""`bodytrack show frame`: every kind of evidence draws what it saw in a frame, figure 6 of Gavrila & Davis."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import sections
from detected import detected, written
from doubted import in_doubt
from followed import followed
from recordings import cycle_for, small_simulation
from sections import each, made
from typer.testing import CliRunner

from tracker.cameras.frame import Frame
from tracker.evidence import EvidencePicture
from tracker.evidence._shares import UNKNOWN, gaps_picture
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.silhouettes import SilhouetteEvidence
from tracker.foundation.errors import TrackerError
from tracker.images.sight import Sight
from tracker.results.result import load_result
from tracker.running.cli import app
from tracker.running.jobs import execute, load_job
from tracker.running.viewing.frame_evidence import SeenFrame, evidence_picture, seen_in_frame
from tracker.synthesis.simulation.sequence import Recipe, Simulation, write_sequence
from tracker.tracking.cycle import Cycle


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation(n_frames=2)


@pytest.fixture(scope="module")
def cycle(simulation: Simulation) -> Cycle:
    return cycle_for(simulation)


@pytest.fixture(scope="module")
def frame(simulation: Simulation) -> Frame:
    return next(iter(simulation.frames()))


@pytest.fixture(scope="module", autouse=True)
def files(simulation: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What a detector and a following would have found in frame 0."""
    scene, person = simulation.scene, simulation.scene.persons[0]
    keypoints = written(detected(scene, noise_px=1.0), scene.rig.names, tmp_path_factory.mktemp("keypoints"))
    points = followed(person.body, person.q[None], scene.rig, tmp_path_factory.mktemp("points"))
    given = {("evidence", "keypoints"): {"path": keypoints}, ("evidence", "points"): {"path": points}}
    sections.GIVEN.update(given)
    yield
    for one in given:
        del sections.GIVEN[one]


def drawn(evidence, simulation, cycle, sight, q=None) -> list[tuple[EvidencePicture, ...]]:
    """What it draws of every view, when it has learnt from the frame before, which was the same."""
    scene, contours = simulation.scene, cycle.synthesis.contours(simulation.scene)
    trusted = np.ones((len(scene.rig), len(scene.shapes)), dtype=bool)
    whole = Sight(next(iter(simulation.frames())), cycle.plates)
    memory = evidence.learned(None, whole, scene, contours, trusted)
    seen = evidence.observe(sight, contours, memory)
    asked = Comparison(scene if q is None else scene.with_pose(0, q), 0, cycle.synthesis, seen)
    return [evidence.pictures(asked, sight, v) for v in range(len(scene.rig))]


@each("evidence")
def test_each_kind_draws_what_it_saw_as_large_as_the_image(use, simulation, frame, cycle):
    before = [image.copy() for image in frame.images]
    views = drawn(made("evidence", use), simulation, cycle, Sight(frame, cycle.plates))
    for image, pictures in zip(frame.images, views, strict=True):
        assert pictures
        for one in pictures:
            assert one.title == one.title.strip() != ""
            assert one.picture is None or (one.picture.shape, one.picture.dtype) == (image.shape, np.uint8)
    if use != "departures":  # nothing has departed from what frame 0 itself has shown
        assert all(any(np.ptp(one.picture) > 0 for one in pictures if one.picture is not None) for pictures in views)
    np.testing.assert_array_equal(frame.images, before)


@each("evidence")
def test_of_a_view_without_an_image_it_says_that_there_is_none(use, simulation, frame, cycle):
    """And of the others it draws what it has."""
    sight = Sight(replace(frame, images=(None, *frame.images[1:])), cycle.plates)
    views = drawn(made("evidence", use), simulation, cycle, sight)
    assert all(one.picture is None for one in views[0])
    assert all(one.title for one in views[0])
    if use != "departures":
        assert any(one.picture is not None for one in views[1])


def test_accepted_edges_are_some_of_the_edges_and_black_in_the_chamfer_image(simulation, frame, cycle):
    for edges, accepted, chamfer in drawn(ContourEvidence(), simulation, cycle, Sight(frame, cycle.plates)):
        some, fewer = (one.picture[..., 0] > 0 for one in (edges, accepted))
        assert 50 < np.count_nonzero(fewer) < np.count_nonzero(some)
        assert not (fewer & ~some).any()
        grey = chamfer.picture[..., 0]
        assert np.median(grey[fewer]) < 20
        assert (grey[:4] == 255).all()  # nobody is at the upper border


def test_a_foreground_is_white_and_what_the_plate_does_not_know_blue(simulation, frame, cycle):
    unknown = np.zeros(frame.images[0].shape[:2], dtype=bool)
    unknown[:40] = True
    plates = tuple(replace(plate, unknown=unknown) for plate in cycle.plates)
    masks = cycle.synthesis.silhouettes(simulation.scene)
    for mask, (picture,) in zip(
        masks, drawn(SilhouetteEvidence(), simulation, cycle, Sight(frame, plates)), strict=True
    ):
        white = (picture.picture == 255).all(axis=2)
        assert np.count_nonzero(white & mask) > 0.9 * np.count_nonzero(mask)
        assert (picture.picture[:40] == UNKNOWN).all()


def test_a_point_too_far_from_its_place_is_red_and_one_that_is_nowhere_is_not_drawn():
    image = np.zeros((40, 60, 3), np.uint8)
    ends = np.array([[10.0, 10.0], [30.0, 30.0], [50.0, 5.0]]), np.array([[12.0, 10.0], [40.0, 30.0], [np.nan, 1e9]])
    picture = gaps_picture(image, *ends, np.array([False, True, True]))
    green, red = picture[10, 10].tolist(), picture[30, 35].tolist()
    assert green[1] > 200 > 100 > green[2]
    assert red[2] > 200 > 100 > red[1]
    assert not picture[:, 45:].any()


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of three simulated frames."""
    folder = tmp_path_factory.mktemp("shown")
    config = write_sequence(Recipe("arm_swing", seconds=0.12, size=(256, 208)), folder / "sequence")
    start = ["initialization.use=given", "initialization.poses=truth_poses.csv", 'recordings=["run_json","journal"]']
    execute(load_job("track", config, [*start, "passes=1"]), folder / "result")
    return folder / "result"


def changed(tracked: Path, folder: Path, evidence: str) -> Path:
    """The result as one that had told this of its evidence."""
    shutil.copytree(tracked, folder)
    told = json.loads((folder / "run.json").read_text())
    told["choices"]["evidence"] = evidence
    (folder / "run.json").write_text(json.dumps(told))
    return folder


def seen(folder: Path) -> SeenFrame:
    result = load_result(folder)
    return seen_in_frame(result, 2, next(iter(result.bodies)))


def titles(frame: SeenFrame) -> list[str]:
    return [one.title for one in frame.views[0].pictures if one.picture is not None]


def test_a_frame_is_seen_as_the_run_saw_it(tracked: Path, tmp_path: Path) -> None:
    one = seen(tracked)
    assert [view.name for view in one.views] == list(load_result(tracked).rig.names)
    assert (one.frame, one.differs) == (2, "")
    assert titles(one) == [
        *("edges", "accepted edges", "chamfer image", "foreground", "colours of the nearest part"),
        "places followed, and their positions by the pose",
    ]
    assert set(one.probabilities) == {"left_arm", "right_arm", "left_leg", "right_leg"}
    # frame 2 was predicted from the two before: near what was found, and not the same
    gap = np.linalg.norm(one.views[0].expected.pixels[:20] - one.views[0].found.pixels[:20], axis=1)
    assert 0 < gap.mean() < 8
    # what the run did not have is not shown either, and what cannot be made again is told
    stays = seen(changed(tracked, tmp_path / "stays", "contours, foreground where nobody stays, colours"))
    assert "not made again" in stays.differs


def written_lines(frame: SeenFrame) -> int:
    """Lines of writing above the pictures."""
    picture = evidence_picture(frame, frame.views[0], 480)
    rest = evidence_picture(replace(frame, differs="", probabilities={}), frame.views[0], 480)
    return (picture.shape[0] - rest.shape[0]) // 20


def test_the_title_tells_doubt_its_reason_and_the_limbs(tracked: Path) -> None:
    one = seen(tracked)
    one, view = replace(one, estimate=replace(one.estimate, doubts=())), one.views[0]
    doubted = replace(one, estimate=in_doubt(one.estimate, "left_arm", whole=True))
    sure, unsure = (evidence_picture(which, view, 480) for which in (one, doubted))
    assert unsure.shape[0] - sure.shape[0] == 2 * 20
    assert written_lines(one) == 1
    assert written_lines(replace(one, differs="the plates are not those of the run")) == 2
    # about as high as wide, whatever the person's own shape
    assert 0.4 < sure.shape[0] / sure.shape[1] < 2.5


def run(*arguments: str) -> str:
    done = CliRunner().invoke(app, ["show", *arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_the_command_writes_a_picture_a_view_and_replaces_none_unasked(tracked: Path, tmp_path: Path) -> None:
    told = run("frame", str(tracked), "--frame", "1", "--output", str(tmp_path))
    names = load_result(tracked).rig.names
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(f"frame_000001_person1_{v}.png" for v in names)
    assert told.count("written: ") == len(names)
    assert cv2.imread(str(tmp_path / f"frame_000001_person1_{names[0]}.png")).shape[1] % 480 == 0
    with pytest.raises(TrackerError, match="--overwrite"):
        run("frame", str(tracked), "--frame", "1", "--output", str(tmp_path))
    run("frame", str(tracked), "--frame", "1", "--view", names[1], "--output", str(tmp_path), "--overwrite")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--frame", "7"], "no frame 7, the nearest is 2"),
        (["--frame", "1", "--view", "nort"], 'no view is called "nort"'),
        (["--frame", "1", "--person", "anna"], 'no person is called "anna"; valid: person1'),
        ([], "expected a result and a frame"),
        (["--frame", "1", "--schema"], "expected a result and a frame"),
    ],
)
def test_what_cannot_be_is_one_line_and_nothing_is_written(tracked, tmp_path, options, words):
    with pytest.raises(TrackerError, match=words) as caught:
        run("frame", str(tracked), *options, "--output", str(tmp_path / "none"))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (["loss", "--frame", "3"], "--frame"),
        (["loss", "RESULT"], '"RESULT"'),
        (["--view", "front"], "--view"),
        (["similarity", "--person", "anna"], "--person"),
        (["jobs", "--overwrite"], "--overwrite"),
        (["model", "--schema", "--output", "here"], "--output"),
    ],
)
def test_options_of_a_frame_are_refused_elsewhere(arguments, option):
    with pytest.raises(TrackerError, match=f"{option}: .* has none; bodytrack show frame RESULT --frame 12"):
        run(*arguments)


def test_a_recording_that_is_gone_is_told(tracked: Path, tmp_path: Path) -> None:
    sequence, moved = tracked.parent / "sequence", tracked.parent / "moved"
    sequence.rename(moved)
    try:
        with pytest.raises(TrackerError):
            run("frame", str(tracked), "--frame", "1", "--output", str(tmp_path / "none"))
    finally:
        moved.rename(sequence)
    assert not (tmp_path / "none").exists()
