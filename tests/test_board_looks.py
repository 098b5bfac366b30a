"""Boards that are not those of the configuration: which board the pictures show is said, or found out."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_prints import SQUARE_M, charuco, chessboard, filmed, held, shown_about, two_cameras
from modules import ROOT
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.cameras.calibration import report_text
from tracker.cameras.calibration._board_looks import shown_share, told_of
from tracker.cameras.calibration._board_start import BoardSearch, patterns_of
from tracker.cameras.calibration._boards import Pattern, find_board, find_corners, goes_on
from tracker.cameras.calibration.chessboard import ChessboardCalibration
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Image
from tracker.foundation.errors import CalibrationError
from tracker.foundation.progress import silent
from tracker.running.cli import app
from tracker.running.jobs.calibrate import load_calibration

pytestmark = pytest.mark.usefixtures("markers_once")

CHARUCO = Pattern(5, 6, 0.75, "4x4_50")


def seen(board: Image) -> Image:
    """A print, tilted before a camera."""
    tilted = Rotation.from_rotvec([-np.pi / 2, 0, 0]) * Rotation.from_rotvec([0.3, 0.3, 0.1])
    return filmed(board, two_cameras()[0], held(board, (0, 0.9, 0), tilted))


def mirrored(image: Image) -> Image:
    return np.ascontiguousarray(image[:, ::-1])


@pytest.mark.parametrize(
    ("board", "wanted", "words"),
    [
        (charuco(5, 6, legacy=True), CHARUCO, "with legacy = true"),
        (charuco(5, 6), replace(CHARUCO, legacy=True), "with legacy = false"),
        (charuco(5, 6), replace(CHARUCO, columns=6, rows=5), "with columns = 5, rows = 6, each on a line of its own"),
        (charuco(5, 6), replace(CHARUCO, columns=4, rows=5), "with columns = 5, rows = 6"),
        (charuco(5, 6, cv2.aruco.DICT_5X5_250), CHARUCO, 'with dictionary = "5x5_50"'),
        (255 - charuco(5, 6), CHARUCO, "with inverted = true"),
        (mirrored(charuco(5, 6)), CHARUCO, "mirror image is seen.*both_sides = true"),
        (
            255 - charuco(6, 5, cv2.aruco.DICT_6X6_50, legacy=True),
            CHARUCO,
            'columns = 6, rows = 5, dictionary = "6x6_50", inverted = true',
        ),
        (charuco(5, 6), Pattern(9, 6), 'columns = 5, dictionary = "4x4_50", marker_m = the side'),
        (chessboard(9, 6), CHARUCO, "plain chessboard is seen: columns = 9, rows = 6, without marker_m"),
        (chessboard(9, 6), Pattern(10, 7), "54 of its corners are seen in a picture with columns = 9, rows = 6"),
        (chessboard(9, 6), Pattern(8, 6), "with columns = 9"),
        (chessboard(9, 6), Pattern(5, 3), "with columns = 9, rows = 6"),
        (255 - chessboard(9, 6), Pattern(9, 6), "with inverted = true"),
        (charuco(5, 6), Pattern(5, 6), 'dictionary = "4x4_50", marker_m = the side'),
        (np.full((300, 300), 90, np.uint8), CHARUCO, "^$"),
    ],
)
def test_another_board_is_named_as_a_configuration_names_it(board: Image, wanted: Pattern, words: str) -> None:
    picture = seen(board)
    assert len(find_board(picture, wanted)[0]) < 6
    told = told_of([picture], wanted)
    assert re.search(words, told), told


def test_pictures_that_show_nothing_are_passed_over() -> None:
    picture = seen(charuco(5, 6))
    wanted = replace(CHARUCO, legacy=True)
    assert told_of([np.full_like(picture, 120), picture], wanted) == told_of([picture], wanted) != ""


def test_the_board_of_the_page_is_that_of_its_configuration(tmp_path: Path, monkeypatch) -> None:
    """The worked example: what its command draws are the columns, rows, markers and sizes of its lines."""
    page = (ROOT / "docs" / "calibration.md").read_text(encoding="utf-8")
    example = page.partition("## With a ChArUco board")[2]
    (tmp_path / "charuco.toml").write_text(re.search(r"```toml\n(.*?)```", example, re.DOTALL)[1])  # type: ignore[index]
    calibration = load_calibration(tmp_path / "charuco.toml", "chessboard").calibration
    words = re.search(r"bodytrack (calibrate board .*?) *#", example)[1].split()  # type: ignore[index]
    monkeypatch.chdir(tmp_path)
    drawn = tomllib.loads(CliRunner().invoke(app, words).output.partition("board.pdf")[0])
    for key in ("columns", "rows", "dictionary"):
        assert drawn[key] == getattr(calibration, key)
    for key in ("square_m", "marker_m"):
        assert drawn[key] == pytest.approx(getattr(calibration, key), rel=0.01), "as measured"


def test_markers_without_corners_are_told() -> None:
    """Markers that stand far apart, on no board."""
    picture = np.full((360, 480), 255, np.uint8)
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for k, (x, y) in enumerate([(20, 30), (210, 70), (380, 20), (60, 250), (330, 230)]):
        picture[y : y + 60, x : x + 60] = cv2.aruco.generateImageMarker(markers, k, 60)
    assert "5 markers of 4x4_50 are seen in a picture, 0 to 4, and no corners" in told_of([picture], CHARUCO)
    noise = np.random.default_rng(0).integers(0, 255, (180, 240)).astype(np.uint8)
    assert told_of([noise], CHARUCO) == ""


def test_a_part_of_a_larger_chessboard_is_not_taken_for_one() -> None:
    """OpenCV sees one in some pictures: with corners that are now these, now others."""
    picture = seen(chessboard(9, 6))
    corners = find_corners(picture, (9, 6))
    assert corners is not None
    assert not goes_on(picture, corners, (9, 6))
    part = corners.reshape(6, 9, 2)[:, :8].reshape(-1, 2)
    assert goes_on(picture, part, (8, 6))
    search = BoardSearch(("left",), [Pattern(8, 6)], SQUARE_M, False)
    with pytest.raises(CalibrationError, match=r'"left": more inner corners than 8 x 6: .*with columns = 9'):
        search._is_whole(0, picture, part)


def test_the_pictures_tell_the_side_of_a_marker() -> None:
    board, near = charuco(4, 3), Camera.looking_at("near", (480, 360), 800.0, (0.0, 0.0, 0.0), (0.0, 0.9, 0.0))
    pictures = [filmed(board, near, pose) for pose in shown_about(board, 5)]
    share = shown_share(pictures[0], Pattern(4, 3, 0.6, "4x4_50"))
    assert share == pytest.approx(0.75, abs=0.03)
    search = BoardSearch(("left",), [Pattern(4, 3, 0.6, "4x4_50")], SQUARE_M, False)
    for k, picture in enumerate(pictures[:4]):
        search.look(0, k, picture)
    with pytest.raises(CalibrationError, match=r"is 0\.60 of square_m, and in the pictures 0\.7.*about 0\.03"):
        search.look(0, 4, pictures[4])
    assert len(search.seen) == 4


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"columns": 12, "rows": 9, "marker_m": 0.03}, '54 markers.*"4x4_50" has 50; dictionary = "4x4_100"'),
        ({"legacy": True}, "legacy = true is of use with a ChArUco board only"),
        ({"both_sides": True}, "both_sides = true is of use with a ChArUco board only"),
    ],
)
def test_boards_that_cannot_be_are_refused(fields: dict[str, object], words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        ChessboardCalibration(square_m=0.05, **fields)._patterns()  # type: ignore[arg-type]


def test_only_boards_with_even_rows_may_be_of_old() -> None:
    assert [one.legacy for one in patterns_of(CHARUCO, None)] == [False, True]
    assert [one.legacy for one in patterns_of(replace(CHARUCO, rows=5), None)] == [False]
    assert [one.legacy for one in patterns_of(CHARUCO, True)] == [True]


CONFIG = """[reading]
use = "images"
fps = 1.0
path = "{view}/{frame}.png"
views = ["left", "right"]
[calibration]
use = "chessboard"
square_m = 0.05
estimated = ["camera_constant"]
"""


def recording(folder: Path, board: Image, poses: list[np.ndarray], table: str) -> Path:
    """Pictures of a board before two cameras, and a configuration."""
    for camera in two_cameras():
        (folder / camera.name).mkdir()
        for k, pose in enumerate(poses):
            cv2.imwrite(str(folder / camera.name / f"{k}.png"), filmed(board, camera, pose))
    path = folder / "run.toml"
    path.write_text(CONFIG + table)
    return path


def test_a_legacy_board_is_found_by_itself(tmp_path: Path) -> None:
    board = charuco(5, 6, legacy=True)
    table = "columns = 5\nrows = 6\nmarker_m = 0.0375\n"
    path = recording(tmp_path, board, shown_about(board, 10), table)
    job = load_calibration(path, "chessboard")
    found = job.calibration.calibrate(job.open(), silent)
    assert found.n_objects == 10
    assert "legacy = true" in report_text("old", found)
    distance = np.linalg.norm(found.rig.cameras[0].centre - found.rig.cameras[1].centre)
    assert distance == pytest.approx(np.linalg.norm([0.5, 0, 0.05]), rel=0.01)
    job = load_calibration(path, "chessboard", ["calibration.legacy=false"])
    with pytest.raises(CalibrationError, match=r'view "left": the board is seen in 0 frames.*with legacy = true'):
        job.calibration.calibrate(job.open(), silent)


def test_a_view_that_sees_nothing_beside_others_that_do_is_told() -> None:
    search = BoardSearch(("left", "right"), [Pattern(6, 4)], SQUARE_M, False)
    for frame in range(3):
        search.look(0, frame, seen(chessboard(6, 4)))
        search.look(1, frame, np.full((360, 480), 90, np.uint8))
    with pytest.raises(CalibrationError, match=r'"right": the board is seen in 0 .*never whole before this camera'):
        search.finish()


def test_a_checkered_floor_does_not_end_the_search() -> None:
    """The board may come later; at the end the floor is told, for want of another."""
    search = BoardSearch(("left",), [Pattern(9, 6)], SQUARE_M, False)
    for frame in range(16):
        search._keep(0, seen(chessboard(4, 4)) if frame % 4 == 3 else np.full((360, 480), 90, np.uint8))
    search.after(16)
    with pytest.raises(CalibrationError, match="with columns = 4, rows = 4"):
        search.finish()


def test_another_board_is_told_before_the_recording_has_ended(tmp_path: Path) -> None:
    board = chessboard(6, 4)
    path = recording(tmp_path, board, shown_about(board, 4), "columns = 7\nrows = 5\n")
    job = load_calibration(path, "chessboard")
    views = job.open()
    search = BoardSearch(views.names, job.calibration._patterns(), 0.05, False)
    for k in range(16):
        frame = next(iter(views.frames()))
        for v, image in enumerate(frame.images):
            search.look(v, k, image)
        if k < 15:
            search.after(k + 1)
    with pytest.raises(CalibrationError, match=r"no view shows the board in 16 frames; .*with columns = 6, rows = 4"):
        search.after(16)
