"""A first configuration: what lies in a folder of videos is found, what is missing is said."""

from __future__ import annotations

import json
import shutil
import struct
import tomllib
from dataclasses import replace
from pathlib import Path

import av
import cv2
import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.errors import ConfigError, SequenceError
from tracker.running.cli import app
from tracker.running.drafts.configuration import draft
from tracker.running.jobs import load_job
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

MEASURED = ("persons.0.stature_m=1.75",)


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("init") / "sequence"
    write_sequence(Recipe("arm_swing", seconds=0.12, size=(360, 288)), folder)
    return folder


@pytest.fixture
def study(recording, tmp_path) -> Path:
    """Videos called as people call them, the calibration and plates in folders beside them."""
    for folder in ("videos", "Calibration", "background"):
        (tmp_path / folder).mkdir()
    for view in ("FRONT", "LEFT", "RIGHT", "BACK"):
        shutil.copy(recording / f"{view}.mp4", tmp_path / "videos" / f"trial1_{view}.mp4")
        shutil.copy(recording / "background" / f"{view}.png", tmp_path / "background" / f"{view}_empty.png")
    shutil.copy(recording / "rig.toml", tmp_path / "Calibration" / "Calib.toml")
    (tmp_path / "other.toml").write_text("something = 'else'")
    return tmp_path


def test_views_cameras_and_plates_are_found(study, monkeypatch):
    monkeypatch.chdir(study)
    told = CliRunner().invoke(app, ["init", "videos"])
    assert told.exit_code == 0, told.output
    assert "FRONT: 360x288 px, 25 frames/s, 3 frames" in told.output
    reading = tomllib.loads(Path("run.toml").read_text())["reading"]
    assert reading == {
        "use": "video",
        "path": "videos/trial1_{view}.mp4",
        "rig": "Calibration/Calib.toml",
        "background": "background/{view}_empty.png",
    }
    with pytest.raises(ConfigError, match="stands there until the person is measured: set the height with shoes"):
        load_job("track", study / "run.toml")
    job = load_job("track", study / "run.toml", MEASURED)
    sequence = job.open().sequence
    assert (job.name, sequence.n_frames, len(sequence.rig)) == (study.name, 3, 4)
    again = CliRunner().invoke(app, ["init", "videos"])
    assert isinstance(again.exception, ConfigError)


def test_the_schema_that_a_draft_names_lies_beside_it(study, monkeypatch):
    monkeypatch.chdir(study)
    assert CliRunner().invoke(app, ["init", "videos"]).exit_code == 0
    first = Path("run.toml").read_text().splitlines()[0]
    assert first == "#:schema ./bodytrack.schema.json"
    told = jsonschema.Draft7Validator(json.loads(Path("bodytrack.schema.json").read_text()))
    faults = [one.message for one in told.iter_errors(tomllib.loads(Path("run.toml").read_text()))]
    assert faults == ["'measure' is not of type 'number'"], "which the person who measures replaces"
    assert CliRunner().invoke(app, ["init", "videos", "--output", "again.toml"]).exit_code == 0
    Path("bodytrack.schema.json").write_text('{"title": "mine"}')
    refused = CliRunner().invoke(app, ["init", "videos", "--output", "other_run.toml"])
    assert "bodytrack.schema.json is not a schema of bodytrack" in str(refused.exception)
    assert Path("bodytrack.schema.json").read_text() == '{"title": "mine"}'
    assert not Path("other_run.toml").exists()


def test_paths_start_where_the_configuration_lies(study):
    (study / "configs").mkdir()
    found = draft(study / "videos", study / "configs" / "run.toml")
    assert tomllib.loads(found.text)["reading"]["path"] == "../videos/trial1_{view}.mp4"
    assert found.remarks == ()


def test_what_is_missing_or_does_not_fit_is_said(study):
    shutil.rmtree(study / "background")
    (study / "videos" / "trial1_BACK.mp4").rename(study / "videos" / "notes.mp4")
    found = draft(study / "videos", study / "run.toml")
    assert found.remarks[0] == "cameras without a recording: BACK; `views` names the others"
    assert found.remarks[1] == "left out, because their names follow another pattern: notes.mp4"
    assert "no plates found" in found.remarks[2]
    assert "# background" in found.text
    shutil.rmtree(study / "Calibration")
    found = draft(study / "videos", study / "run.toml")
    assert "no calibration found" in found.remarks[0]
    assert found.rig is None
    assert "rig" not in tomllib.loads(found.text)["reading"]


def test_what_is_written_for_fewer_views_than_cameras_can_be_opened(study):
    (study / "videos" / "trial1_BACK.mp4").unlink()
    (study / "background" / "LEFT_empty.png").unlink()
    found = draft(study / "videos", study / "run.toml")
    assert any(
        line.endswith("else the recording makes plates") and "no plate of LEFT" in line for line in found.remarks
    )
    (study / "run.toml").write_text(found.text)
    assert tomllib.loads(found.text)["reading"]["views"] == ["FRONT", "RIGHT", "LEFT"]
    assert load_job("track", study / "run.toml", MEASURED).reading.open().rig.names == ("FRONT", "RIGHT", "LEFT")


@pytest.mark.parametrize("names", ["1234", "abcd"])
def test_short_names_are_found_in_words_that_hold_them_too(study, names):
    rig = (study / "Calibration" / "Calib.toml").read_text()
    for view, name in zip(("FRONT", "LEFT", "RIGHT", "BACK"), names, strict=True):
        rig = rig.replace(f'"{view}"', f'"{name}"')
        (study / "videos" / f"trial1_{view}.mp4").rename(study / "videos" / f"{name}_trial1_abcd.mp4")
        (study / "background" / f"{view}_empty.png").rename(study / "background" / f"{name}_background_1.png")
    (study / "Calibration" / "Calib.toml").write_text(rig)
    found = draft(study / "videos", study / "run.toml")
    assert found.remarks == ()
    reading = tomllib.loads(found.text)["reading"]
    assert reading["path"] == "videos/{view}_trial1_abcd.mp4"
    assert reading["background"] == "background/{view}_background_1.png"


def test_numbered_images_of_no_view_are_told_where_to_lie(tmp_path, monkeypatch):
    for n in range(3):
        cv2.imwrite(str(tmp_path / f"{n:04d}.png"), np.zeros((24, 32, 3), dtype=np.uint8))
    monkeypatch.chdir(tmp_path)
    found = draft(Path(), tmp_path / "run.toml")
    assert found.footage == ()
    assert "left out, because their names follow another pattern: {frame}.png" in found.remarks
    assert tomllib.loads(found.text)["reading"] == {"use": "images", "path": "{view}/{frame}.png"}


def test_a_calibration_that_cannot_be_used_says_why(study):
    path = study / "Calibration" / "Calib.toml"
    path.write_text(path.read_text().replace("FRONT", "FR\\\\ONT"))
    first, second, *_ = draft(study / "videos", study / "run.toml").remarks
    assert "Calib.toml" in first
    assert "no calibration found" in second


def test_images_of_another_size_than_calibrated_are_said(study, recording, tmp_path):
    large = tmp_path / "large"
    write_sequence(Recipe("arm_swing", seconds=0.08, size=(720, 576)), large)
    save_rig(load_rig(large / "rig.toml"), study / "Calibration" / "Calib.toml")
    found = draft(study / "videos", study / "run.toml")
    assert found.remarks[0] == "trial1_BACK.mp4: 360x288 px, but calibrated at 720x576"


def test_videos_that_their_metadata_turn_are_as_large_as_they_are_read(study):
    """A phone held upright: its header tells the size of the sensor."""
    for path in (study / "videos").iterdir():
        content, unit = path.read_bytes(), 0x10000
        upright = struct.pack(">9i", unit, 0, 0, 0, unit, 0, 0, 0, 0x40000000)
        turned = struct.pack(">9i", 0, unit, 0, -unit, 0, 0, 0, 0, 0x40000000)
        place = content.index(upright, content.index(b"tkhd"))
        path.write_bytes(content[:place] + turned + content[place + 36 :])
    assert {one.size for one in draft(study / "videos", study / "run.toml").footage} == {(288, 360)}


def test_a_folder_without_videos_is_one_clear_line(tmp_path):
    with pytest.raises(SequenceError, match="no videos there; expected one a view"):
        draft(tmp_path, tmp_path / "run.toml")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "a.mp4").touch()
    with pytest.raises(SequenceError, match=r"did you mean .*inner"):
        draft(tmp_path, tmp_path / "run.toml")
    with pytest.raises(SequenceError, match="expected a folder of videos"):
        draft(tmp_path / "nowhere", tmp_path / "run.toml")
    (tmp_path / "a.mp4").write_bytes(b"nothing")
    with pytest.raises(SequenceError, match=r"a\.mp4 is not a video that can be read"):
        draft(tmp_path, tmp_path / "run.toml")


@pytest.fixture(
    params=["{view}/{frame}.png", "{view}_{frame}.png", "{view}/img_{view}.{frame}.png", "a1{view}/f{frame}.jpg"]
)
def pictures(recording, tmp_path, request) -> tuple[Path, str]:
    """Numbered images as people call them."""
    for view in load_rig(recording / "rig.toml").names:
        with av.open(str(recording / f"{view}.mp4")) as video:
            for k, frame in enumerate(video.decode(video=0)):
                path = tmp_path / "images" / request.param.format(view=view, frame=f"{k + 7:04d}")
                path.parent.mkdir(parents=True, exist_ok=True)
                cv2.imwrite(str(path), frame.to_ndarray(format="bgr24"))
    shutil.copy(recording / "rig.toml", tmp_path)
    return tmp_path, request.param


def test_numbered_images_are_found(pictures):
    folder, pattern = pictures
    found = draft(folder / "images", folder / "run.toml")
    assert [(one.view, one.size, one.n_frames) for one in found.footage] == [
        (view, (360, 288), 3) for view in ("BACK", "FRONT", "LEFT", "RIGHT")
    ]
    assert found.remarks[0] == "images have no frame rate: set `fps`"
    reading = tomllib.loads(found.text)["reading"]
    assert reading == {"use": "images", "path": f"images/{pattern}", "rig": "rig.toml"}
    (folder / "run.toml").write_text(found.text)
    with pytest.raises(ConfigError, match='"fps" is missing'):
        load_job("track", folder / "run.toml", MEASURED)
    (folder / "run.toml").write_text(found.text.replace("# fps", "fps"))
    assert load_job("track", folder / "run.toml", MEASURED).open().sequence.n_frames == 3
    (folder / "rig.toml").unlink()
    assert tomllib.loads(draft(folder / "images", folder / "a.toml").text)["reading"]["path"].count("{view}") >= 1


def test_all_calibrations_and_plates_that_could_be_meant_are_told(study):
    """First the calibration whose image sizes are those of the videos."""
    rig = load_rig(study / "Calibration" / "Calib.toml")
    large = Rig(tuple(replace(camera, size=(720, 576)) for camera in rig.cameras))
    save_rig(large, study / "Calibration" / "A.toml")
    shutil.copytree(study / "background", study / "plates_of_yesterday")
    found = draft(study / "videos", study / "run.toml")
    assert found.rig == study / "Calibration" / "Calib.toml"
    rigs, plates = found.remarks
    assert rigs.startswith("other calibrations there:")
    assert "A.toml; --rig chooses one" in rigs
    assert "other plates there" in plates
    assert "plates_of_yesterday" in plates
    assert '# rig = "Calibration/A.toml"   # another one' in found.text
    assert "floor z = 0" in found.world


@pytest.mark.parametrize(
    ("names", "files", "guessed"),
    [
        (("cam_0", "cam_1", "cam_2", "cam_3"), ("camera-00", "camera-01", "camera-02", "camera-03"), False),
        (("Front", "Left", "Right", "Back"), ("FRONT", "LEFT", "RIGHT", "BACK"), False),
        (("c1", "c2", "c3", "c10"), ("GX9_a", "GX9_b", "GX9_c", "GX10_a"), True),
    ],
)
def test_files_that_are_not_called_after_the_cameras_are_written_as_a_table(study, names, files, guessed):
    views, path = ("FRONT", "LEFT", "RIGHT", "BACK"), study / "Calibration" / "Calib.toml"
    rig = load_rig(path).select(views)
    save_rig(Rig(tuple(replace(one, name=name) for one, name in zip(rig.cameras, names, strict=True))), path)
    for view, file in zip(views, files, strict=True):
        (study / "videos" / f"trial1_{view}.mp4").rename(study / "videos" / f"{file}.mp4")
    found = draft(study / "videos", study / "run.toml")
    line = next(line for line in found.remarks if "are not named after the cameras" in line)
    assert ("GUESSED" in line, "GUESSED" in found.text) == (guessed, guessed)
    assert tomllib.loads(found.text)["reading"]["path"] == {
        name: f"videos/{file}.mp4" for name, file in zip(names, files, strict=True)
    }
    (study / "run.toml").write_text(found.text)
    assert load_job("track", study / "run.toml", MEASURED).reading.open().rig.names == names


def test_a_table_of_files_names_each_view_once(study):
    found = draft(study / "videos", study / "run.toml")
    (study / "run.toml").write_text(found.text)
    files = [f"reading.path={{{pairs}}}" for pairs in ("FRONT='videos/trial1_FRONT.mp4'", "A='a', B='a'")]
    for one, message in zip(files, ('no file of view "', 'no file of view "'), strict=True):
        with pytest.raises(SequenceError, match=message):
            load_job("track", study / "run.toml", [*MEASURED, one]).reading.open()
    twice = ", ".join(f"{view} = 'videos/trial1_LEFT.mp4'" for view in ("FRONT", "LEFT", "RIGHT", "BACK"))
    with pytest.raises(SequenceError, match=r"are both .*trial1_LEFT\.mp4"):
        load_job("track", study / "run.toml", [*MEASURED, f"reading.path={{{twice}}}"]).reading.open()


@pytest.mark.parametrize("place", ["beside", "among", "clips"])
def test_plates_that_are_clips_or_lie_beside_the_videos_are_found(study, place):
    folder = {"beside": study, "among": study / "videos", "clips": study / "background"}[place]
    suffix = ".mp4" if place == "clips" else ".png"
    for view in ("FRONT", "LEFT", "RIGHT", "BACK"):
        if place == "clips":
            shutil.copy(study / "videos" / f"trial1_{view}.mp4", folder / f"{view}_empty.mp4")
            (folder / f"{view}_empty.png").unlink()
        else:
            (study / "background" / f"{view}_empty.png").rename(folder / f"{view}_empty.png")
    found = draft(study / "videos", study / "run.toml")
    assert found.plates == str(folder / ("{view}_empty" + suffix))
    assert found.remarks == ()
    assert len(found.footage) == 4


def test_plates_of_another_size_are_said(study):
    cv2.imwrite(str(study / "background" / "LEFT_empty.png"), np.zeros((24, 32, 3), dtype=np.uint8))
    (line,) = draft(study / "videos", study / "run.toml").remarks
    assert line.endswith("LEFT_empty.png: 32x24 px, but the images of LEFT have 360x288")


@pytest.mark.parametrize("inner", ["{view}/trial.mp4", "{view}/InputMedia/trial/{view}.mp4", "cam_{view}/a.mp4"])
def test_videos_in_a_folder_each_camera_are_found(study, inner):
    for view in ("FRONT", "LEFT", "RIGHT", "BACK"):
        path = study / "videos" / inner.format(view=view)
        path.parent.mkdir(parents=True)
        (study / "videos" / f"trial1_{view}.mp4").rename(path)
    found = draft(study / "videos", study / "run.toml")
    assert tomllib.loads(found.text)["reading"]["path"] == f"videos/{inner}"
    assert found.remarks == ()
    shutil.rmtree(study / "Calibration")
    assert len(draft(study / "videos", study / "run.toml").footage) == 4


def test_one_view_is_too_few(study):
    for view in ("LEFT", "RIGHT", "BACK"):
        (study / "videos" / f"trial1_{view}.mp4").unlink()
    found = draft(study / "videos", study / "run.toml")
    assert "one view: at least two are needed, for one does not show how far away a person is" in found.remarks
    (study / "run.toml").write_text(found.text)
    with pytest.raises(ConfigError, match="one view: at least two are needed"):
        load_job("track", study / "run.toml", MEASURED).open()


def test_a_world_whose_floor_is_elsewhere_is_told(study):
    path = study / "Calibration" / "Calib.toml"
    save_rig(load_rig(path).with_up("z", 2.4), path)
    assert any("below the floor" in line for line in draft(study / "videos", study / "run.toml").remarks)


@pytest.mark.parametrize("inner", ["videos", "synchronized_videos"])
def test_a_trials_folder_is_read_by_its_folder_of_videos(inner, study, tmp_path):
    """`bodytrack init .` where Pose2Sim, or FreeMoCap, has its trial."""
    trial = tmp_path / "trial"
    shutil.copytree(study / "videos", trial / inner)
    made, direct = (draft(folder, trial / "run.toml") for folder in (trial, trial / inner))
    assert made == direct
    assert f"{inner}/" in made.text
