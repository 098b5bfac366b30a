"""`bodytrack detect`: a detector's keypoints go where a run looks for them; what is there is not found again."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from detected import NAMES, detected, written
from recordings import cycle_for, small_simulation
from typer.testing import CliRunner

from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.keypoint_layouts.views import KeypointViews
from tracker.foundation.arrays import Array, Image
from tracker.foundation.configuration.components import available, find
from tracker.foundation.errors import ConfigError
from tracker.running.cli import app
from tracker.running.detections import USUAL, detect, wanted
from tracker.running.drafts.configuration import draft
from tracker.running.jobs import described, job_from
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.keypoints import KeypointInitialization
from tracker.tracking.initialization.pca import PcaInitialization


@dataclass(frozen=True)
class Fake:
    """A detector that finds one person, where the image is brightest, and counts how often it is asked."""

    called: str = "fake 1"
    layout = "coco_17"
    asked: list[tuple[int, ...]] | None = None

    def open(self) -> Callable[[Image], Array]:
        def find_(image: Image) -> Array:
            if self.asked is not None:
                self.asked.append(image.shape)
            y, x = np.unravel_index(np.argmax(image.sum(axis=2)), image.shape[:2])
            person = np.array([[float(x), float(y), 0.75]] * len(NAMES))
            person[0] = np.nan  # no nose
            return person[None]

        return find_

    def about(self) -> str:
        return self.called


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("detect") / "sequence"
    write_sequence(Recipe("arm_swing", seconds=0.12, size=(180, 144)), folder)
    return folder


@pytest.fixture
def config(recording, tmp_path) -> Path:
    shutil.copytree(recording, tmp_path / "sequence")
    return tmp_path / "sequence" / "config.toml"


def found(config: Path, fake: Fake, **options):
    asked = wanted(config, "mediapipe")
    return detect(asked.reading, fake, asked.pattern, **options)


def test_keypoints_are_written_where_a_run_reads_them_in_pixels_of_the_recorded_images(config):
    fake = Fake(asked=[])
    left = found(config, fake)
    assert (left.n_images, left.n_new, set(fake.asked)) == (12, 12, {(144, 180, 3)})
    assert left.somebody == dict.fromkeys(("FRONT", "LEFT", "RIGHT", "BACK"), 1.0) or set(left.somebody.values()) == {
        1.0
    }
    sequence = wanted(config, "mediapipe").reading.open()
    views = KeypointViews.open(str(config.parent / USUAL), sequence.rig.names)
    assert views.order.layout == "coco_17"
    for frame in sequence.frames():
        for image, persons in zip(frame.images, views.at(frame, sequence.rig), strict=True):
            y, x = np.unravel_index(np.argmax(image.sum(axis=2)), image.shape[:2])
            assert np.isnan(persons[0, 0]).all()
            assert persons[0, 1:] == pytest.approx(np.tile([x, y, 0.75], (16, 1)))
    assert cv2.imread(str(left.files[0])) is not None
    assert [file.name for file in left.files] == ["detected.jpg"]


def test_only_what_is_missing_is_looked_at_again_and_gives_the_same(config):
    whole = {path: path.read_bytes() for path in _files(config, found(config, Fake()))}
    some = sorted(whole)[::3]
    for path in some:
        path.unlink()
    again, fake = None, Fake(asked=[])
    again = found(config, fake)
    assert (len(fake.asked), again.n_new, again.n_images) == (len(some), len(some), 12)
    assert {path: path.read_bytes() for path in whole} == whole


def _files(config: Path, left) -> list[Path]:
    return sorted(Path(left.pattern).parent.glob("*_json/*.json"))


def test_another_detector_or_another_video_is_refused_before_anything_is_written(config):
    before = {path: path.read_bytes() for path in _files(config, found(config, Fake()))}
    with pytest.raises(
        ConfigError, match=re.escape("by fake 1, not by fake 2: choose another --output, or --overwrite")
    ):
        found(config, Fake("fake 2"))
    shutil.copy(config.parent / "LEFT.mp4", config.parent / "FRONT.mp4")
    with pytest.raises(ConfigError, match=r"FRONT\.mp4 is another file than when its keypoints were found"):
        found(config, Fake())
    assert {path: path.read_bytes() for path in before} == before
    fake = Fake("fake 2", asked=[])
    found(config, fake, overwrite=True)
    assert len(fake.asked) == 12


def test_files_of_another_program_stay(config):
    folder = config.parent / "keypoints" / "FRONT_json"
    folder.mkdir(parents=True)
    (folder / "FRONT_000000.json").write_text('{"people": []}')
    with pytest.raises(ConfigError, match="holds files of another program"):
        found(config, Fake())
    assert [path.name for path in folder.parent.iterdir()] == ["FRONT_json"]


def test_a_film_of_all_images_can_be_asked_for(config):
    left = found(config, Fake(), film=True)
    film = cv2.VideoCapture(str(left.files[1]))
    assert (left.files[1].name, film.get(cv2.CAP_PROP_FRAME_COUNT)) == ("detected.mp4", 3)
    assert not list(left.files[1].parent.glob(".*"))


def test_a_pattern_that_is_no_folder_for_each_view_is_refused(config):
    asked = wanted(config, "mediapipe", "keypoints/{view}.csv")
    with pytest.raises(ConfigError, match="expected a folder for each view"):
        detect(asked.reading, Fake(), asked.pattern)


@pytest.mark.parametrize("use", available("detection"))
def test_a_detector_whose_package_is_missing_says_what_to_install(use, config):
    if importlib.util.find_spec(use) is not None:
        pytest.skip(f"{use} is installed")
    told = CliRunner().invoke(app, ["detect", str(config), "--with", use])
    assert isinstance(told.exception, ConfigError)
    assert re.match(rf'detector "{use}" needs the Python package {use}: pip install {use}', str(told.exception))
    assert not (config.parent / "keypoints").exists()


@pytest.mark.parametrize("use", available("detection"))
def test_a_detectors_keypoints_have_a_layout_that_is_read(use):
    assert find("detection", use).layout in LAYOUTS


def test_mediapipe_finds_a_person_and_nobody_where_nobody_is(data):
    pytest.importorskip("mediapipe", reason="needs the extra: pip install mediapipe==0.10.21")
    import av

    folder = data("room/V-Dance")
    image = next(av.open(str(folder / "FRONT.mp4")).decode(video=0)).to_ndarray(format="bgr24")
    finder = find("detection", "mediapipe")().open()
    persons = finder(image)
    given = json.loads((folder / "keypoints" / "FRONT_json" / "FRONT_000000.json").read_text())["people"][0]
    theirs = np.array(given["pose_keypoints_2d"]).reshape(-1, 3)
    ours = persons[0, [11, 12, 23, 24]]
    assert np.linalg.norm(ours[:, :2] - theirs[[5, 6, 11, 12], :2], axis=1).max() < 8
    assert finder(np.zeros_like(image)).shape == (0, 33, 3)


# What a run makes of them


def table(config: Path, **more) -> dict:
    return {**tomllib.loads(config.read_text()), **more}


def test_a_run_looks_at_keypoints_beside_the_rest_and_tells_so(config):
    sections = table(config, keypoints={"path": "keypoints/{view}_json"})
    job = job_from("track", sections, "run.toml", config.parent, "run")
    assert [type(one).__name__ for one in job.evidence.of] == ["AutoEvidence", "KeypointEvidence"]
    assert job.initialization.keypoints.path == str(config.parent / "keypoints" / "{view}_json")
    assert job_from("track", described(job), "config.toml", Path("/elsewhere"), "run") == job
    sections |= {"evidence": {"use": "contours"}, "initialization": {"use": "pca"}}
    with pytest.raises(ConfigError, match="neither uses them: leave one of them to `auto`"):
        job_from("track", sections, "run.toml", config.parent, "run")


def test_a_start_is_by_keypoints_and_by_the_images_where_they_show_nobody(tmp_path, monkeypatch):
    simulation, said = small_simulation(n_frames=1), []
    cycle, frame = cycle_for(simulation), next(simulation.frames())
    scene, stages = simulation.scene, replace(cycle.stages, progress=lambda what, *_, **__: said.append(what))
    monkeypatch.setattr(PcaInitialization, "start", lambda *_: "by the images")
    patterns = {
        name: written(views, scene.rig.names, tmp_path / name)
        for name, views in (("all", detected(scene)), ("none", [view[:0] for view in detected(scene)]))
    }
    starts = {name: KeypointInitialization(path=pattern) for name, pattern in patterns.items()}
    found = {name: AutoInitialization(keypoints=one).start(frame, scene, stages) for name, one in starts.items()}
    assert found["none"] == "by the images"
    assert [line.split(",")[0] for line in said if "not by keypoints" in line] == ["start: not by keypoints"]
    assert np.array_equal(found["all"].poses[0], starts["all"].start(frame, scene, stages).poses[0])


def test_init_finds_keypoints_and_proposes_them(config):
    folder = config.parent
    for view in ("FRONT", "LEFT", "RIGHT", "BACK"):
        (folder / "pose" / f"{view}_json").mkdir(parents=True)
        (folder / "pose" / f"{view}_json" / f"{view}_000000.json").write_text('{"people": []}')
    made = draft(folder, folder / "run.toml")
    assert tomllib.loads(made.text)["keypoints"] == {"path": "pose/{view}_json"}
    shutil.rmtree(folder / "pose" / "LEFT_json")
    made = draft(folder, folder / "run.toml")
    assert "keypoints" not in tomllib.loads(made.text)
    assert "# keypoints =" in made.text
    assert made.keypoints == ""


def test_a_detector_is_given_settings_by_set(config):
    asked = wanted(config, "mediapipe", overrides=("detection.least_confidence=0.8", "reading.stop=2"))
    assert (asked.detection.least_confidence, asked.reading.stop) == (0.8, 2)
    assert asked.pattern == str(config.resolve().parent / USUAL)
    assert replace(asked, named=True) != asked
