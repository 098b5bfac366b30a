"""Calibrations as other programs write them: their keys, their order, their ways with numbers; the numbers are ours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig

NORTH = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
"""Rotation of a camera on the x axis that looks at the origin, z up."""

FISHEYE = (0.7313, 0.0891, 0.0, 0.0, 9e-4, 1.0643, 0.2454, 9.2e-3)
"""Distortion of a lens whose distances from the axis are near to its angle."""


def sample_rig(*names: str, lens: tuple[float, ...] = (-0.2, 0.05, 0.001, -0.002, 0.0)) -> Rig:
    """What every sample says: cameras on the x axis, side by side."""
    matrix = np.array([[900.0, 0, 640], [0, 905, 360], [0, 0, 1]])
    motions = [np.eye(4) for _ in names]
    for k, motion in enumerate(motions):
        motion[:3, :3], motion[:3, 3] = NORTH, (-1.5 * k, 0.25, 5)
    return Rig(tuple(Camera(n, (1280, 720), matrix, np.array(lens), m) for n, m in zip(names, motions, strict=True)))


def tables() -> dict[str, dict[str, Any]]:
    """Two cameras in the exchanged TOML layout, as other programs write it."""
    common = {
        "size": [1280.0, 720.0],
        "matrix": [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]],
        "distortions": [-0.2, 0.05, 0.001, -0.002],
        "rotation": Rotation.from_matrix(NORTH).as_rotvec().tolist(),
        "fisheye": False,
    }
    return {
        "cam_1": {"name": "north", **common, "translation": [0.0, 0.0, 5.0]},
        "cam_2": {"name": "south", **common, "translation": [-1.5, 0.0, 5.0], "error": 0.31},
        "metadata": {"adjusted": False, "error": 0.0},
    }


def entries() -> list[dict[str, Any]]:
    """Two cameras in the JSON layout."""
    common = {
        "size": [720, 576],
        "K": [[850.0, 0, 360], [0, 850.0, 288], [0, 0, 1]],
        "dist": [0.1, 0.02, 0, 0, 0.003],
        "R": NORTH.tolist(),
    }
    return [{"name": "FRONT", **common, "t": [0, 0, 4.0]}, {"name": "SIDE", **common, "t": [1.0, 0, 4.0]}]


def written(folder: Path, content: Any, suffix: str) -> Path:
    """The file of a table."""
    path = folder / f"rig{suffix}"
    path.write_text(tomli_w.dumps(content) if suffix == ".toml" else json.dumps(content))
    return path


def assert_equal(one: Rig, other: Rig, tolerance: float) -> None:
    """Two rigs with the same cameras in the same order."""
    assert one.names == other.names
    for a, b in zip(one.cameras, other.cameras, strict=True):
        assert a.size == b.size
        np.testing.assert_allclose(a.matrix, b.matrix, atol=tolerance)
        np.testing.assert_allclose(a.distortion, b.distortion, atol=tolerance)
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=tolerance)


_RODRIGUES = ", ".join(repr(float(value)) for value in Rotation.from_matrix(NORTH).as_rotvec())

ANIPOSE = f"""[cam_0]
name = "A"
size = [ 1280, 720,]
matrix = [ [ 900.0, 0.0, 640.0,], [ 0.0, 905.0, 360.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.2, 0.05, 0.001, -0.002, 0.0,]
rotation = [ {_RODRIGUES},]
translation = [ 0.0, 0.25, 5.0,]

[cam_1]
name = "B"
size = [ 1280, 720,]
matrix = [ [ 900.0, 0.0, 640.0,], [ 0.0, 905.0, 360.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.2, 0.05, 0.001, -0.002, 0.0,]
rotation = [ {_RODRIGUES},]
translation = [ -1.5, 0.25, 5.0,]

[metadata]
adjusted = false
error = 0.4132
"""

FREEMOCAP = (
    ANIPOSE.replace("0.25, 5.0", "250.0, 5000.0")
    .replace("-1.5,", "-1500.0,")
    .replace(
        "adjusted = false\nerror = 0.4132\n",
        'charuco_square_size = 58.0\ncharuco_board_object = "CharucoBoardDefinition(...)"\n'
        'path_to_recorded_videos = "C:\\\\videos"\ndate_time_calibrated = "2025-03-11T14:19:33"\n'
        "groundplane_calibration = true\n",
    )
)
"""Millimetres, after the recording in FreeMoCap's repository."""

POSE2SIM = f"""[cam_01]
name = "cam01"
size = [ 1280.0, 720.0]
matrix = [ [ 900.0, 0.0, 640.0], [ 0.0, 905.0, 360.0], [ 0.0, 0.0, 1.0]]
distortions = [ -0.2, 0.05, 0.001, -0.002]
rotation = [ {_RODRIGUES}]
translation = [ 0.0, 0.25, 5.0]
fisheye = false

[cam_02]
name = "cam02"
size = [ 1280.0, 720.0]
matrix = [ [ 900.0, 0.0, 640.0], [ 0.0, 905.0, 360.0], [ 0.0, 0.0, 1.0]]
distortions = [ -0.2, 0.05, 0.001, -0.002]
rotation = [ {_RODRIGUES}]
translation = [ -1.5, 0.25, 5.0]
fisheye = false

[metadata]
adjusted = false
error = 0.0
"""

CALISCOPE = f"""[cameras.0]
cam_id = 0
size = [1280, 720]
rotation_count = 0
error = 0.366
matrix = [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002, 0.0]
translation = [0.0, 0.25, 5.0]
rotation = [{_RODRIGUES}]
grid_count = 39
fisheye = false

[cameras.1]
cam_id = 1
size = [1280, 720]
rotation_count = 1
error = 0.401
matrix = [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002, 0.0]
translation = [-1.5, 0.25, 5.0]
rotation = [{_RODRIGUES}]
grid_count = 33
fisheye = false

[cameras.2]
cam_id = 2
size = [1280, 720]
rotation_count = 0
error = 0.5
matrix = [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002, 0.0]
grid_count = 20
fisheye = false
"""
"""The third camera was never placed."""

_MATRIX = ", ".join(str(row.tolist()) for row in NORTH)

CALISCOPE_OLD = f"""[cameras.1]
port = 1
rotation_count = 0
error = 0.01
exposure = "null"
grid_count = 20
ignore = false
size = [1280, 720]
matrix = [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002, 0.0]
verified_resolutions = [[640, 480], [1280, 720]]
translation = [0.0, 0.25, 5.0]
rotation = [{_MATRIX}]

[cameras.10]
port = 10
rotation_count = 0
error = 0.01
exposure = -7
grid_count = 20
ignore = false
size = [1280, 720]
matrix = [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002, 0.0]
translation = [-1.5, 0.25, 5.0]
rotation = [{_MATRIX}]

[cameras.2]
port = 2
ignore = true
size = [1280, 720]
matrix = "null"
translation = "null"
rotation = "null"

[cameras.3]
port = 3
ignore = false
size = [1280, 720]
matrix = [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002, 0.0]
translation = "null"
rotation = "null"
"""

_QTM_TURN = 'r11="0" r12="1" r13="0" r21="0" r22="0" r23="1" r31="1" r32="0" r33="0"'


def qtm_camera(serial: str, x: float, y: float, **attributes: str) -> str:
    """A camera as QTM writes it."""
    window = 'left="0" top="0" right="1279" bottom="719"'
    told = {"active": "1", "calibrated": "true", "message": "", "viewrotation": "0", **attributes}
    words = " ".join(f'{key}="{value}"' for key, value in told.items())
    return f"""  <camera {words} point-count="2241" avg-residual="0.402" serial="{serial}" model="Miqus Video">
   <fov_marker {window}/><fov_marker_max {window}/><fov_video {window}/><fov_video_max {window}/>
   <transform x="{x}" y="{y}" z="250.000000" {_QTM_TURN}/>
   <intrinsic focallength="9.27" sensorMinU="0.000000" sensorMaxU="81919.000000" sensorMinV="0.000000"
    sensorMaxV="46079.000000" focalLengthU="57600.000000" focalLengthV="57920.000000" centerPointU="40960.000000"
    centerPointV="23040.000000" skew="0.000000" radialDistortion1="-0.200000" radialDistortion2="0.050000"
    radialDistortion3="0.000000" tangentalDistortion1="0.001000" tangentalDistortion2="-0.002000"/>
  </camera>"""


def qtm(*cameras: str) -> str:
    """A calibration as QTM exports it."""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<calibration calibrated="true" source="today.qca" created="2025-06-11 16:00:43" qtm-version="2024.3 (build 14360)"
 type="regular" wandLength="601.100000" maximumFrames="1500" shortArmEnd="365.000000" longArmEnd="566.000000">
 <results std-dev="1.1" min-max-diff="9.4"/>
 <cameras>
{chr(10).join(cameras)}
 </cameras>
</calibration>
"""


QUALISYS = qtm(qtm_camera("26578", 5000.0, 0.0), qtm_camera("26580", 5000.0, 1500.0))


def easymocap() -> tuple[str, str]:
    """The two files as EasyMocap writes them: its own YAML writer, six decimals, lines that end as on Windows."""

    def matrix(key: str, rows: list[list[float]]) -> list[str]:
        numbers = ", ".join(f"{value:.6f}" for row in rows for value in row)
        head = [f"{key}: !!opencv-matrix", f"  rows: {len(rows)}", f"  cols: {len(rows[0])}"]
        return [*head, "  dt: d", f"  data: [{numbers}]"]

    names = ["names:", '  - "01"', '  - "02"']
    intri, extri = ["%YAML:1.0", "---", *names], ["%YAML:1.0", "---", *names]
    for name, camera in zip(("01", "02"), sample_rig("01", "02").cameras, strict=True):
        intri += matrix(f"K_{name}", camera.matrix.tolist()) + matrix(f"dist_{name}", [camera.distortion.tolist()])
        intri += [f"H_{name}: 720", f"W_{name}: 1280"]
        motion = camera.camera_from_world
        extri += matrix(f"R_{name}", camera.rotation_vector()[:, None].tolist())
        extri += matrix(f"Rot_{name}", motion[:3, :3].tolist()) + matrix(f"T_{name}", motion[:3, 3:].tolist())
    return "\r\n".join(intri) + "\r\n", "\r\n".join(extri) + "\r\n"
