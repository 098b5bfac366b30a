"""What comes before a calibration: the board that recordings show is found, and boards are printed."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_prints import charuco, chessboard, filmed, shown_about, two_cameras
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numbered_pictures import write_video
from typer.testing import CliRunner

from tracker.cameras.calibration import BoardPrint, board_pattern, found_board
from tracker.cameras.calibration._board_print import PAPERS, dark_cells, largest_square_mm, page_figures
from tracker.cameras.calibration._boards import Pattern, charuco_detector, find_board
from tracker.foundation.arrays import Image
from tracker.foundation.errors import CalibrationError, ConfigError, SequenceError
from tracker.images.footage import spread_pictures
from tracker.running.cli import app
from tracker.running.jobs.calibrate import load_calibration

pytestmark = pytest.mark.usefixtures("markers_once")

CHARUCO = Pattern(5, 6, 0.75, "4x4_50")
BOARDS = {
    "4x4": (charuco(5, 6), CHARUCO),
    "legacy": (charuco(5, 6, legacy=True), replace(CHARUCO, legacy=True)),
    "odd": (charuco(7, 5), replace(CHARUCO, columns=7, rows=5)),
    "apriltag": (charuco(6, 5, cv2.aruco.DICT_APRILTAG_36h11), Pattern(6, 5, 0.75, "apriltag_36h11")),
    "inverted": (255 - charuco(4, 5, cv2.aruco.DICT_5X5_250), Pattern(4, 5, 0.75, "5x5_50", inverted=True)),
    "chessboard": (chessboard(7, 5), Pattern(7, 5)),
    "inverted chessboard": (255 - chessboard(8, 5), Pattern(8, 5, inverted=True)),
}


def views_of(board: Image, n: int = 2) -> dict[str, list[Image]]:
    poses = shown_about(board, n)
    return {camera.name: [filmed(board, camera, pose) for pose in poses] for camera in two_cameras()}


def mirrored(pictures: list[Image]) -> list[Image]:
    return [np.ascontiguousarray(picture[:, ::-1]) for picture in pictures]


@pytest.mark.parametrize("kind", BOARDS)
def test_any_board_is_found_without_being_told(kind: str) -> None:
    board, expected = BOARDS[kind]
    found = found_board(views_of(board))
    share = found.pattern.marker
    assert replace(found.pattern, marker=expected.marker) == expected
    assert (share is None) == (expected.marker is None)
    assert share is None or share == pytest.approx(0.75, abs=0.03)
    assert min(found.n_seen.values()) >= 1
    assert not found.both_sides


def test_a_board_of_which_no_picture_shows_all_markers_is_as_large_as_all_show() -> None:
    """Each picture lacks the last rows or the first ones."""
    pictures = [filmed(charuco(5, 6), two_cameras()[0], pose) for pose in shown_about(charuco(5, 6), 4, 0.1, 0.05)]
    for k, picture in enumerate(pictures):
        found = np.nonzero(picture != 120)[0]
        middle = int(np.median(found))
        picture[: middle - 20 if k % 2 else 0] = 120
        picture[middle + 20 if k % 2 == 0 else len(picture) :] = 120
    assert found_board({"left": pictures}).pattern.size == (5, 6)


def test_a_camera_that_sees_the_back_tells_both_sides() -> None:
    views = views_of(charuco(5, 6))
    found = found_board({"left": views["left"], "right": mirrored(views["right"])})
    assert found.both_sides
    assert found.n_mirrored == {"left": 0, "right": 2}
    alone = found_board({"left": mirrored(views["left"])})
    assert not alone.both_sides
    assert alone.n_mirrored == {"left": 2}


def test_pictures_without_a_board_are_one_line() -> None:
    with pytest.raises(
        CalibrationError, match="no board is seen in 2 pictures; expected a chessboard or a ChArUco board"
    ):
        found_board({"left": [np.full((240, 320), 90, np.uint8)] * 2})


def recorded(folder: Path, board: Image, n: int = 3) -> Path:
    folder.mkdir()
    for name, pictures in views_of(board, n).items():
        write_video(folder / f"{name}.mp4", [cv2.cvtColor(one, cv2.COLOR_GRAY2BGR) for one in pictures])
    return folder


def run(*words: str | Path) -> str:
    told = CliRunner().invoke(app, ["calibrate", *map(str, words)])
    if told.exception is not None:
        raise told.exception
    return told.output


def test_a_configuration_is_written_that_calibrate_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(tmp_path / "film", charuco(5, 6, legacy=True))
    monkeypatch.chdir(tmp_path)
    told = run("init", "film", "--square", "0.05")
    assert "left: 480x360 px, the board in 3 of 3 pictures" in told
    job = load_calibration(tmp_path / "calibration.toml", "chessboard")
    found = job.calibration
    assert (found.columns, found.rows, found.square_m, found.dictionary) == (5, 6, 0.05, "4x4_50")
    assert found.legacy is True
    assert found.marker_m == pytest.approx(0.0375, rel=0.05)
    assert job.open().names == ("left", "right")
    assert (tmp_path / "bodytrack.schema.json").is_file()
    with pytest.raises(ConfigError, match="is there already"):
        run("init", "film")


def test_a_length_that_no_picture_tells_is_left_to_be_measured(tmp_path: Path) -> None:
    recorded(tmp_path / "film", charuco(5, 6))
    told = run("init", tmp_path / "film", "--output", tmp_path / "c.toml")
    assert "no picture shows how long a square is" in told
    with pytest.raises(ConfigError, match="square_m"):
        load_calibration(tmp_path / "c.toml", "chessboard")


def test_numbered_images_of_a_board_are_read(tmp_path: Path) -> None:
    for name, pictures in views_of(chessboard(7, 6)).items():
        (tmp_path / "board" / name).mkdir(parents=True)
        for k, picture in enumerate(pictures):
            cv2.imwrite(str(tmp_path / "board" / name / f"img_{k + 9}.png"), picture)
    run("init", tmp_path / "board", "--output", tmp_path / "c.toml", "--square", "0.05")
    job = load_calibration(tmp_path / "c.toml", "chessboard")
    assert (job.calibration.columns, job.calibration.rows) == (7, 6)
    assert job.calibration.marker_m is None
    assert job.open().n_frames == 2


def test_what_is_called_a_calibration_is_taken_where_something_else_lies_beside_it(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "film", charuco(5, 6))
    for name in ("left", "right"):
        (folder / f"{name}.mp4").rename(folder / f"calib_{name}.mp4")
        write_video(folder / f"{name}.mp4", [np.zeros((360, 480, 3), np.uint8)] * 3)
    run("init", folder, "--output", tmp_path / "c.toml", "--square", "0.05")
    assert load_calibration(tmp_path / "c.toml", "chessboard").reading.path.endswith("film/{view}.mp4")
    assert 'views = ["calib_left", "calib_right"]' in (tmp_path / "c.toml").read_text()


def test_the_board_of_a_real_recording_is_found(data: Callable[[str], Path]) -> None:
    """White on black, the same on its back as if seen through."""
    found = found_board({f"cam_{k}": spread_pictures(data("calib4") / f"cam_{k}.mp4", 4) for k in range(4)})
    assert replace(found.pattern, marker=0.75) == Pattern(4, 5, 0.75, "4x4_50", inverted=True)
    assert found.both_sides


def test_pictures_are_spread_over_a_film(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mp4", [np.full((48, 64, 3), 10 * k, np.uint8) for k in range(20)], gop=2)
    greys = [float(picture.mean()) for picture in spread_pictures(tmp_path / "a.mp4", 3)]
    assert len(greys) == 3
    assert greys[0] < 15 < 60 < greys[1] < 130 < 150 < greys[2]
    (tmp_path / "b.mp4").write_bytes(b"none")
    with pytest.raises(SequenceError, match=r"b\.mp4 is not a video"):
        spread_pictures(tmp_path / "b.mp4", 3)


PRINTED = {
    "charuco": board_pattern((5, 7), 0.75, "4x4_50"),
    "even": board_pattern((5, 6), 0.6, "5x5_50"),
    "apriltag": board_pattern((6, 5), 0.75, "apriltag_36h11"),
    "inverted": board_pattern((4, 5), 0.75, "DICT_4X4_50", inverted=True),
    "plain": board_pattern((9, 6), None, ""),
}


@pytest.mark.parametrize("kind", ["charuco", "even", "apriltag"])
def test_a_printed_board_is_opencvs(kind: str) -> None:
    """The cells, drawn on OpenCV's grid of pixels, are its picture of the board."""
    pattern, side = PRINTED[kind], 80
    x, y, dark = dark_cells(pattern)
    places = (np.arange(side * pattern.columns) + 0.5) / side, (np.arange(side * pattern.rows) + 0.5) / side
    drawn = dark[np.searchsorted(y, places[1])[:, None] - 1, np.searchsorted(x, places[0]) - 1]
    expected = charuco_detector(pattern).getBoard().generateImage((side * pattern.columns, side * pattern.rows))
    assert ((expected < 128) != drawn).mean() < 0.01, "edges of cells that lie between pixels"


@pytest.mark.parametrize("kind", PRINTED)
def test_a_printed_page_shows_the_board_true_to_scale(kind: str) -> None:
    board = BoardPrint(PRINTED[kind], largest_square_mm(PRINTED[kind], "a4"), "a4", back=kind == "inverted")
    pages = list(page_figures(board))
    assert len(pages) == (2 if kind == "inverted" else 1)
    for k, page in enumerate(pages):
        canvas = FigureCanvasAgg(page)
        canvas.draw()
        picture = np.asarray(canvas.buffer_rgba())[..., :3].mean(axis=2).astype(np.uint8)
        width_mm = sorted(PAPERS["a4"])[picture.shape[1] > picture.shape[0]]
        numbers, pixels = find_board(mirrored([picture])[0] if k else picture, board.pattern)
        plan = board.pattern.plan[numbers, :2]
        assert len(numbers) == len(board.pattern.plan)
        sides_px = np.linalg.norm(pixels[1:] - pixels[:-1], axis=1) / np.linalg.norm(np.diff(plan, axis=0), axis=1)
        assert np.median(sides_px) * width_mm / picture.shape[1] == pytest.approx(board.square_mm, rel=0.01)


def test_a_pdf_is_as_large_as_the_paper_and_tells_the_configuration(tmp_path: Path) -> None:
    told = run("board", tmp_path / "b.pdf", "--paper", "A3", "--columns", "4", "--rows", "5", "--both-sides")
    content = (tmp_path / "b.pdf").read_bytes()
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)
    assert [[float(side) * 25.4 / 72 for side in box] for box in boxes] == [pytest.approx([297, 420], abs=0.01)] * 2
    for line in ("columns = 4", "rows = 5", "square_m = 0.067", 'dictionary = "4x4_50"', "both_sides = true"):
        assert line in told
    with pytest.raises(ConfigError, match="is there already"):
        run("board", tmp_path / "b.pdf")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["b.pdf", "--square", "0.1"], "does not fit a4, expected 0.035 m at most for 5 x 7 squares"),
        (["b.pdf", "--paper", "a5"], "--paper a5"),
        (["b.png"], "expected a .pdf"),
        (["b.pdf", "--dictionary", "9x9"], 'dictionary = "9x9"'),
        (["b.pdf", "--columns", "20", "--rows", "20"], "has 200 markers, and dictionary"),
        (["b.pdf", "--plain", "--both-sides"], "looks the same from both sides"),
    ],
)
def test_boards_that_cannot_be_printed_are_refused(words: list[str], told: str, tmp_path: Path) -> None:
    with pytest.raises((ConfigError, CalibrationError), match=re.escape(told)):
        run("board", tmp_path / words[0], *words[1:])
    assert not list(tmp_path.iterdir())
