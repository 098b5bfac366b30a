"""Every reader of the product, with files that it reads."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import tomli_w

from fuzzing import samples
from fuzzing.image_readers import image_readers
from fuzzing.mutations import BINARY, TEXT
from fuzzing.trial import Reader
from tracker.bodies.body.description import load_body, read_description
from tracker.bodies.keypoint_layouts import open_keypoints
from tracker.bodies.scene import Person, Scene
from tracker.cameras.calibration import read_points
from tracker.cameras.rig_layouts import read_rig, save_rig
from tracker.foundation.configuration.tables import read_config
from tracker.foundation.resources import model_path
from tracker.results.evaluation.comparison import evaluate
from tracker.results.marker_layouts import read_markers
from tracker.results.recognition.library import bundled_library, load_library
from tracker.results.result import load_result
from tracker.running.jobs import INPUTS, check_inputs, check_same, load_job
from tracker.running.jobs.acquire import acquisition_from
from tracker.tracking.initialization.given import GivenInitialization

RIGS = {
    "anipose": "rig.toml",
    "caliscope": "camera_array.toml",
    "easymocap": "rig",
    "json": "rig.json",
    "opencv": "rig",
    "pose2sim": "Calib.toml",
    "qualisys": "rig.qca.txt",
}
"""Layouts that are written, and where to."""

MIDDLEBURY = "2\n" + "".join(f"{k}.png 60 0 32 0 60 24 0 0 1 1 0 0 0 1 0 0 0 1 {k} 0 1\n" for k in range(2))

_CAMERA = {"resolution": [64, 48], "K": [[60, 0, 32], [0, 60, 24], [0, 0, 1]], "distCoef": [0.1, 0, 0, 0, 0]}
"""What all cameras of `PANOPTIC` have."""

PANOPTIC = json.dumps(
    {
        "cameras": [
            {"name": str(k), **_CAMERA, "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [[k * 90], [0], [300]]}
            for k in range(2)
        ]
    }
)
VICON = """<?xml version="1.0"?>
<Cameras VERSION="1.2">
 <Camera DEVICEID="1" PIXEL_ASPECT_RATIO="1" SENSOR_SIZE="64 48" SKEW="0" TYPE="Vue_VIDEO"><KeyFrames>
  <KeyFrame FOCAL_LENGTH="60" ORIENTATION="0.6 0 0 0.8" POSITION="0 -2000 900" PRINCIPAL_POINT="32 24"
   VICON_RADIAL2="Vicon3Parameter 32 24 1e-6 0 0"/></KeyFrames></Camera>
</Cameras>"""


def readers() -> tuple[Reader, ...]:
    """All of them."""
    return (*_rigs(), *_configurations(), *_tables(), *image_readers(), *_results())


def _text(name: str, content: str, read: Callable[[Path], object], file: str) -> Reader:
    """A reader of one text file that needs no others."""

    def sample(folder: Path) -> None:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(content)

    return Reader(name, sample, read, TEXT, (file,))


def _rigs() -> list[Reader]:
    found = [_rig(layout, target) for layout, target in RIGS.items()]

    def read(folder: Path) -> object:
        return read_rig(folder / "a_par.txt", samples.SIZE)

    def session(folder: Path) -> object:
        return read_rig(folder)

    pickles = tuple(f"Videos/{view}/{samples.PICKLE}" for view in samples.VIEWS)
    return [
        *found,
        _text("rig middlebury", MIDDLEBURY, read, "a_par.txt"),
        Reader("rig opencap", samples.write_pickles, session, BINARY, pickles),
        _freemocap(),
        _text("rig panoptic", PANOPTIC, lambda folder: read_rig(folder / "p.json"), "p.json"),
        _text("rig vicon", VICON, lambda folder: read_rig(folder / "v.xcp"), "v.xcp"),
    ]


def _freemocap() -> Reader:
    def sample(folder: Path) -> None:
        path = folder / "a_camera_calibration.toml"
        save_rig(samples.sample_rig(), path, "anipose")
        tables = tomllib.loads(path.read_text())
        tables["metadata"] |= {
            "charuco_square_size": 39.0,
            "path_to_recorded_videos": "x",
            "groundplane_calibration": True,
        }
        path.write_text(tomli_w.dumps(tables))

    def read(folder: Path) -> object:
        return read_rig(folder / "a_camera_calibration.toml")

    return Reader("rig freemocap", sample, read, TEXT, ("a_camera_calibration.toml",))


def _rig(layout: str, target: str) -> Reader:
    files = {"easymocap": ("rig/intri.yml", "rig/extri.yml"), "opencv": ("rig/left.yml",)}.get(layout, (target,))

    def sample(folder: Path) -> None:
        save_rig(samples.sample_rig(), folder / target, layout)

    def read(folder: Path) -> object:
        return read_rig(folder / target)

    return Reader(f"rig {layout}", sample, read, TEXT, files)


def _configurations() -> list[Reader]:
    def acquire(folder: Path) -> object:
        return acquisition_from(read_config(folder / "run.toml"), "run.toml", folder, "run")

    def job(use: str) -> Callable[[Path], object]:
        return lambda folder: load_job(use, folder / "run.toml")

    def model(folder: Path) -> object:
        return load_body(folder / "model.toml")

    def resumed(folder: Path) -> None:
        check_same({"name": "sample"}, folder)

    tables = {"track": samples.RUN, **samples.OTHER_JOBS}
    return [
        *(
            _text(f"configuration {use}", content, acquire if use == "acquire" else job(use), "run.toml")
            for use, content in tables.items()
        ),
        Reader("model", lambda folder: samples.write_model(folder / "model.toml"), model, TEXT, ("model.toml",)),
        _text("resumed configuration", 'name = "sample"\n', resumed, "config.toml"),
    ]


def _tables() -> list[Reader]:
    body, rig = load_body(model_path("gavrila22")), samples.sample_rig()
    scene = Scene((Person("anna", body, body.rest()),), rig)

    def start(folder: Path) -> object:
        return GivenInitialization(poses=folder / "poses.csv").check(scene, (None, None))

    def keypoints(file: str) -> Callable[[Path], object]:
        return lambda folder: [open_keypoints(folder / file).at(frame) for frame in (0, 1)]

    def points(folder: Path) -> object:
        return read_points(folder / "points.csv", samples.VIEWS)

    return [
        Reader("start poses", samples.write_result, start, TEXT, ("poses.csv",)),
        _text("keypoints openpose", samples.KEYPOINTS, keypoints("json"), "json/a_000000.json"),
        _text("keypoints alphapose", samples.ALPHAPOSE, keypoints("a.json"), "a.json"),
        _text("keypoints deeplabcut", samples.DEEPLABCUT, keypoints("dlc.csv"), "dlc.csv"),
        _text("keypoints sleap", samples.SLEAP, keypoints("sleap.csv"), "sleap.csv"),
        _text("measured points", samples.POINTS, points, "points.csv"),
        _text("markers trc", samples.TRC, lambda folder: read_markers(folder / "a.trc"), "a.trc"),
        Reader(
            "markers c3d",
            lambda folder: samples.write_markers(folder / "a.c3d"),
            lambda folder: read_markers(folder / "a.c3d"),
            BINARY,
            ("a.c3d",),
        ),
        _library(),
    ]


def _library() -> Reader:
    def sample(folder: Path) -> None:
        (folder / "library" / "wave").mkdir(parents=True)
        (folder / "library" / "wave" / "movement.toml").write_text(samples.MOVEMENT)
        tables = sorted(bundled_library().glob("*/*.csv"), key=lambda path: path.stat().st_size)
        shutil.copyfile(tables[0], folder / "library" / "wave" / "anna.csv")

    def read(folder: Path) -> object:
        return load_library((folder / "library",))

    return Reader("movements", sample, read, TEXT, ("library/wave/movement.toml", "library/wave/anna.csv"))


def _results() -> list[Reader]:
    def inputs(folder: Path) -> None:
        check_inputs(folder, {"a.mp4": "5 bytes, sha256 00"})

    def truth(folder: Path) -> object:
        return evaluate(folder, folder / "truth_joints.csv")

    def description(folder: Path) -> object:
        return read_description(folder / "models" / "anna.toml").build()

    return [
        Reader("result", samples.write_result, load_result, TEXT, ("run.json", "steps.jsonl", "rig.toml")),
        Reader("inputs", samples.write_result, inputs, TEXT, (INPUTS,)),
        Reader(
            "evaluation",
            samples.write_result,
            truth,
            TEXT,
            ("truth_joints.csv", "joints.csv", "poses.csv", "run.json", "truth_poses.csv"),
            share=1,
        ),
        Reader("scaled model", samples.write_result, description, TEXT, ("models/anna.toml",)),
    ]
