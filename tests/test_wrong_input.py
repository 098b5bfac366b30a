"""Wrong input of several commands: one line that names what is wrong, or a word on the terminal; never a traceback."""

from __future__ import annotations

import logging
from pathlib import Path

import cv2
import numpy as np
import pytest
from numbered_pictures import N_FRAMES, VIEWS, images, picture, shown
from rig_samples import sample_rig
from typer.testing import CliRunner

from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.errors import CalibrationError, ConfigError, SequenceError
from tracker.foundation.source_files import json_of, rows_of
from tracker.running.cli import app
from tracker.running.drafts.configuration import draft
from tracker.synthesis.simulation.filming import plan
from tracker.synthesis.simulation.room import background_plates, default_rig, room_around
from tracker.synthesis.simulation.sequence import Recipe

SMALL = default_rig((160, 128))


def told(*arguments: object) -> str:
    """What a command prints, or its error."""
    done = CliRunner().invoke(app, list(map(str, arguments)))
    if isinstance(done.exception, (CalibrationError, ConfigError, SequenceError)):
        return str(done.exception)
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


@pytest.mark.parametrize("name", ["Käm", "a.b"])
def test_names_that_easymocap_cannot_have(tmp_path: Path, name: str) -> None:
    with pytest.raises(CalibrationError, match=f'camera "{name}": no name for this layout'):
        save_rig(sample_rig(name), tmp_path / "folder", "easymocap")


@pytest.mark.parametrize(
    ("place", "heading_deg", "message"),
    [
        ((100.0, 100.0), None, "--place 100 100: far from all cameras, expected metres, x from -15.8 to 15.8"),
        ((800.0, float("nan")), None, "--place 800 nan: far"),
        (None, float("nan"), "--heading-deg nan: expected degrees"),
    ],
)
def test_places_and_headings_that_cannot_be(place: tuple[float, float], heading_deg: float, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        plan(Recipe("squat"), SMALL, place, heading_deg)


def test_a_hall_has_walls_as_well() -> None:
    """Their textures have fewer pixels than the posters of a room are large."""
    assert background_plates(SMALL, room=room_around(SMALL, (60.0, 0.0)))[0].std() > 3


def test_a_place_that_no_camera_sees_is_told_once(tmp_path: Path) -> None:
    save_rig(SMALL, tmp_path / "rig.toml")
    asked = ("--rig", tmp_path / "rig.toml", "--output", tmp_path / "out", "--seconds", "0.2", "--no-track")
    found = told("simulate", *asked, "--place", "8", "0")
    assert "two cameras do not see the whole body at --place" in found
    assert "nowhere" not in found
    assert "cameras would do" not in found


@pytest.mark.parametrize("fps", ["inf", "nan", "1e-300", "0.0"])
def test_frame_rates_that_cannot_be(copied: Path, fps: str) -> None:
    text = f'[reading]\nuse = "images"\npath = "a/{{view}}_{{frame}}.png"\nrig = "rig.toml"\nfps = {fps}\n'
    (copied / "run.toml").write_text('persons = [{ name = "anna", model = "human" }]\n' + text)
    assert f"fps = {fps}: expected" in told("run", copied / "run.toml")


def test_a_view_that_cannot_be_opened_is_named(copied: Path, caplog: pytest.LogCaptureFixture) -> None:
    (copied / "images" / "north").rename(copied / "images" / "nord")
    with caplog.at_level(logging.WARNING, "tracker"):
        assert len(shown(images(copied, on_missing="skip"))) == N_FRAMES
    assert 'view "north" is left out of all frames: view "north": no folder' in caplog.text


def test_two_images_of_one_number_are_refused(copied: Path) -> None:
    (copied / "images" / "north" / "img_5.png").write_bytes(b"")
    with pytest.raises(SequenceError, match=r'"north": img_0005\.png and img_5\.png in .* are both number 5'):
        images(copied).open()


def test_a_plate_of_another_size_is_named(copied: Path) -> None:
    cv2.imwrite(str(copied / "plate_west.png"), np.tile(picture(2, 0), (2, 2, 1)))
    with pytest.raises(CalibrationError, match=r"the background .*plate_west\.png has 128x96 px, .* as large as the"):
        images(copied, background=str(copied / "plate_{view}.png")).open()


@pytest.mark.parametrize(("sign", "words"), [(";", "semicolons"), ("\t", "tabs")])
def test_cells_that_something_else_separates(tmp_path: Path, sign: str, words: str) -> None:
    (tmp_path / "poses.csv").write_text("frame,person\n0,anna\n".replace(",", sign))
    with pytest.raises(SequenceError, match=f"cells are separated by {words}, expected commas"):
        rows_of(tmp_path / "poses.csv", SequenceError)


def test_a_rig_whose_cameras_no_recording_is_called_after(copied: Path) -> None:
    save_rig(sample_rig("A", "B"), copied / "other.toml")
    with pytest.raises(CalibrationError, match=r"named after one of its cameras \(A, B\): east\.mp4"):
        draft(copied, copied / "run.toml", copied / "other.toml")
    assert tuple(one.view for one in draft(copied, copied / "run.toml").footage) == VIEWS


def test_epipolar_lines_need_a_picture_of_each_view(copied: Path) -> None:
    arguments = "rig", "check", copied / "rig.toml", "--images", copied / "plate_east.png"
    assert "no {view} in it, so all 3 views would show the same" in told(*arguments)
    save_rig(sample_rig("A"), copied / "one.toml")
    assert "nan mm" not in told("rig", "check", copied / "one.toml")


def test_frames_are_those_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "pairs.toml").write_text("[[pairs]]\n")
    said = told("acquire", tmp_path / "pairs.toml", "--frames", "0:5")
    assert said == f"--frames 0:5: needs the configuration of a run; {tmp_path / 'pairs.toml'} has no [reading]"


FOREIGN = {
    "Config.toml": "[project]\n[pose]\n[triangulation]\n[filtering]\n",
    "config.toml": 'project = "a"\nnesting = 1\n[triangulation]\n',
    "a_run.toml": 'persons = [{ name = "anna" }]\n[reading]\nuse = "video"\npath = "{view}.mp4"\n',
    "boards.toml": '[reading]\nuse = "video"\n[calibration]\nuse = "chessboard"\n',
    "model.toml": "[[segments]]\nname = 'a'\n",
    "film.mp4": "\0",
}


@pytest.mark.parametrize(
    ("command", "file", "message"),
    [
        ("run", "Config.toml", "Pose2Sim's Config.toml, expected a configuration of bodytrack: `bodytrack init"),
        ("acquire", "Config.toml", "Pose2Sim's Config.toml"),
        ("run", "config.toml", "Anipose's config.toml"),
        ("calibrate chessboard", "a_run.toml", "another command: `bodytrack run"),
        ("follow", "a_run.toml", "another command: `bodytrack run"),
        ("run", "boards.toml", "another command: `bodytrack calibrate chessboard"),
        ("run", "model.toml", "a body model, expected a configuration: name it there"),
        ("run", "film.mp4", "a video, expected a configuration: `bodytrack init"),
        ("run", "result", "the folder of a result, expected a configuration; its own is"),
        ("run", "videos", "a folder, expected a configuration: `bodytrack init"),
        ("run", "rig.toml", "a calibration of 4 cameras, expected a configuration: `bodytrack init VIDEOS --rig"),
        ("calibrate points", "rig.json", "a calibration of 4 cameras"),
        ("result smooth", "a_run.toml", "a file, expected the folder of a run"),
        ("init", "film.mp4", "expected a folder of videos: did you mean"),
    ],
)
def test_another_file_than_was_asked_for_is_told_for_what_it_is(
    tmp_path: Path, command: str, file: str, message: str
) -> None:
    for name, text in FOREIGN.items():
        (tmp_path / name).write_text(text)
    for name in ("rig.toml", "rig.json"):
        save_rig(SMALL, tmp_path / name)
    (tmp_path / "videos").mkdir()
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "config.toml").touch()
    found = told(*command.split(), tmp_path / file)
    assert found.startswith(str(tmp_path / file))
    assert message in found


def test_an_entry_that_is_there_twice_is_refused_in_json(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"cameras": {"FRONT": 1, "LEFT": 2, "FRONT": 3}}')
    with pytest.raises(ConfigError, match=r'a\.json: two entries are called "FRONT", expected different names$'):
        json_of(tmp_path / "a.json", ConfigError)
