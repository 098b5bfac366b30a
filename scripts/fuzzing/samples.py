"""Good files to spoil: small, of every kind that the product reads."""

from __future__ import annotations

import json
import pickle
import shutil
from pathlib import Path

import av
import cv2
import ezc3d
import numpy as np

from tracker.bodies.body.description import load_body, read_description, save_description
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import save_rig
from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Image
from tracker.foundation.resources import model_path
from tracker.results.recording import RunContext
from tracker.results.recording.csv_table import CsvTable
from tracker.results.recording.journal import Journal
from tracker.results.recording.run_json import RunJson
from tracker.results.result import replayed
from tracker.running.jobs import INPUTS
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Replay

SIZE = 64, 48
"""Of images, px."""

N_FRAMES = 8
"""Of a video."""

VIEWS = "left", "right"


def sample_rig() -> Rig:
    """Two cameras around a person."""
    places = (3.0, 0.0, 1.2), (0.0, 3.0, 1.4)
    towards = np.array([0.0, 0.0, 1.0])
    pairs = zip(VIEWS, places, strict=True)
    return Rig(tuple(Camera.looking_at(name, SIZE, 60.0, place, towards) for name, place in pairs))


def picture(k: int = 0) -> Image:
    """A picture (h, w, 3) with something in it."""
    rng = np.random.default_rng(k)
    image: Image = rng.integers(0, 60, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    cv2.circle(image, (32, 24), 9, (200, 180, 160), -1)
    return image


def write_picture(path: Path, k: int = 0) -> None:
    """The picture in the format that the name tells."""
    _, content = cv2.imencode(path.suffix, picture(k))
    path.write_bytes(content.tobytes())


def write_video(path: Path) -> None:
    """Eight frames."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"preset": "ultrafast", "g": "4"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for k in range(N_FRAMES):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(k), format="bgr24")))
        container.mux(stream.encode(None))


def write_model(path: Path) -> None:
    """A body model as results hold it."""
    save_description(read_description(model_path("gavrila22")), path)


def write_result(folder: Path) -> None:
    """The tables of a run of three frames."""
    body, rig = load_body(model_path("gavrila22")), sample_rig()
    scene = Scene((Person("anna", body, body.rest()),), rig)
    ones = np.ones(len(body.parts))
    account = Account(1.5, np.ones(len(rig)), ones, 40 * ones, 30 * ones, ones)
    estimate = Estimate(body.rest(), 1e-4 * np.eye(body.dof), account, 0.0, 7)
    context = RunContext("sample", folder, scene, 25.0, 0.04, 3)
    recorders = [recording.begin(context) for recording in (CsvTable(), RunJson(), Journal())]
    for step in replayed(scene, [Replay(k, 0.04 * k, (estimate,), {"search": 0.01}, None) for k in range(3)]):
        for recorder in recorders:
            recorder.write(step)
    for recorder in recorders:
        recorder.finish()
    save_rig(rig, folder / "rig.toml")
    write_model(folder / "models" / "anna.toml")
    shutil.copyfile(folder / "joints.csv", folder / "truth_joints.csv")
    shutil.copyfile(folder / "poses.csv", folder / "truth_poses.csv")
    (folder / INPUTS).write_text(json.dumps({"a.mp4": "5 bytes, sha256 00"}))


def write_pickles(folder: Path) -> None:
    """Cameras as OpenCap pickles them."""
    for camera in sample_rig().cameras:
        motion, (width, height) = camera.camera_from_world, camera.size
        table = {
            "distortion": camera.told_distortion[None],
            "intrinsicMat": camera.matrix,
            "imageSize": np.array([[height], [width]]),
            "rotation": motion[:3, :3],
            "translation": 1000 * motion[:3, 3:],
        }
        (folder / "Videos" / camera.name).mkdir(parents=True)
        (folder / "Videos" / camera.name / PICKLE).write_bytes(pickle.dumps(table))


PICKLE = "cameraIntrinsicsExtrinsics.pickle"


def write_markers(path: Path) -> None:
    """Three markers in ten frames, C3D."""
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    content["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    content["parameters"]["POINT"]["LABELS"]["value"] = ["HEAD", "LWRI", "RWRI"]
    content["data"]["points"] = np.random.default_rng(0).uniform(10, 2000, (4, 3, 10))
    content.write(str(path))


TRC = """PathFileType\t4\t(X/Y/Z)\ta.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
100\t100\t3\t2\tmm\t100\t1\t3
Frame#\tTime\tHEAD\t\t\tLWRI\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2
1\t0.00\t10.5\t1700.2\t30.1\t400.0\t900.0\t20.0
2\t0.01\t10.6\t1700.3\t30.1\tNaN\tNaN\tNaN
3\t0.02\t10.7\t1700.4\t30.2\t400.5\t900.2\t20.1
"""

MOVEMENT = """about = "waving"
repeats = true
source = "made here"
"""

RUN = """name = "sample"
persons = [{ name = "anna", model = "human", stature_m = 1.68 }]

[reading]
use = "video"
path = "{view}.mp4"
rig = "rig.toml"
background = "median"
offsets = { left = 1 }
start = 0
stop = 8

[estimation]
search_below = 0.9

[initialization]
use = "given"
poses = "start.csv"

[recordings]
overlay = false
report = { pictures = 3 }
c3d = true
"""

OTHER_JOBS = {
    "calibrate": """name = "bar"
[reading]
use = "video"
path = "{view}.mp4"
views = ["left", "right"]
[calibration]
use = "reference_bar"
length_m = 0.6
""",
    "follow": """[reading]
use = "images"
path = "{view}/{frame}.png"
rig = "rig.toml"
fps = 25
[surface.growth]
step_px = 7
[filters]
""",
    "acquire": """persons = [{ name = "anna" }]
[reading]
use = "video"
path = "{view}.mp4"
rig = "rig.toml"
[acquisition]
person = "anna"
""",
}

_POINTS = ", ".join(["12.5, 30.1, 0.9"] * 25)
"""Pixel and confidence."""

KEYPOINTS = f'{{"version": 1.3, "people": [{{"person_id": [-1], "pose_keypoints_2d": [{_POINTS}]}}]}}'
"""A frame of OpenPose's 25 points."""

ALPHAPOSE = f'[{{"image_id": "0.jpg", "category_id": 1, "keypoints": [{_POINTS}], "score": 2.5, "idx": 1}}]'
"""Of a video of one image."""

DEEPLABCUT = """scorer,DLC,DLC,DLC,DLC,DLC,DLC
bodyparts,nose,nose,nose,left_elbow,left_elbow,left_elbow
coords,x,y,likelihood,x,y,likelihood
0,12.5,30.1,0.98,40.2,20.1,0.5
1,12.7,30.4,0.97,40.0,20.3,0.6
"""

SLEAP = """track,frame_idx,instance.score,nose.x,nose.y,nose.score,tail.x,tail.y,tail.score
one,0,0.9,12.5,30.1,0.98,40.2,20.1,0.5
one,1,0.9,12.7,30.4,0.97,40.0,20.3,0.6
"""

POINTS = """x,y,z,left_u,left_v,right_u,right_v
0.0,0.0,1.0,31.5,23.5,31.5,26.0
0.4,0.0,1.0,31.0,22.5,24.0,26.0
0.0,0.4,1.2,40.1,20.2,31.0,22.0
0.3,0.1,0.9,33.0,25.0,26.0,27.5
"""
