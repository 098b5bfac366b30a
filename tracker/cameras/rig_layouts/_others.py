"""Files of other programs that are not read: what they are, and what to do instead."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tracker.cameras.rig_layouts._sources import lenient_text, xml_tag

_BY_HAND = "write its cameras into a rig.toml: size, matrix, distortions, rotation, translation (docs/formats.md)"
_ANEW = "calibrate with `bodytrack calibrate`"
_NO_UNIT = (
    f"its lengths have no unit and its axes no floor: {_ANEW}, or {_BY_HAND} and tell one measured length by "
    "`rig convert --scale`"
)
_LENS_ALONE = "a lens and no pose, so that no camera can be placed"

_MOST_FILES = 300
"""Of a folder that are looked at."""

_MAGIC = {
    b"MATLAB 5.0": "a MATLAB file",
    b"\x89HDF": "an HDF5 file, as MATLAB from version 7.3 on writes",
    b"\x93NUMPY": "an array of numpy",
    b"PK\x03\x04": "an archive (.zip, .npz, .psz)",
}
"""How binary files begin that hold calibrations of other programs; Python's pickles are told by their ending."""

_ENDINGS = {
    **dict.fromkeys((".c3d", ".trc", ".mot"), "a file of movements, which has no cameras"),
    **dict.fromkeys((".mp4", ".avi", ".mov", ".mkv", ".png", ".jpg", ".jpeg"), "a film or an image, expected a file of "
    "numbers: to calibrate by films, `bodytrack calibrate`"),
    **dict.fromkeys((".pkl", ".pickle"), f"a Python pickle, which may hold a program and is not opened: {_BY_HAND}"),
    **dict.fromkeys((".cal", ".mcal"), f"the calibration of OptiTrack's Motive, it seems: {_BY_HAND}"),
}  # fmt: skip


@dataclass(frozen=True)
class _Other:
    told: str
    signs: tuple[str, ...]
    """Regular expressions that all occur in the file, at the beginning of lines where they begin with ^."""

    tags: tuple[str, ...] = ()
    """Names of the outermost XML element; none of other files."""

    def made(self, text: str, tag: str) -> bool:
        """Whether a file with this text is one."""
        fits = tag in self.tags if self.tags else not tag
        return fits and all(re.search(sign, text, re.MULTILINE) for sign in self.signs)


_OTHERS = (
    _Other(f"COLMAP's reconstruction: {_NO_UNIT}", (r"\A# (?:Camera|Image) list\b",)),
    _Other(f"Bundler's reconstruction: {_NO_UNIT}", (r"\A# Bundle file",)),
    _Other(
        f"a transforms.json of NeRF programs (instant-ngp, Nerfstudio): {_NO_UNIT}",
        (r"\A\s*\{", r'"frames"\s*:', r'"transform_matrix"\s*:'),
    ),
    _Other(f"OpenMVG's reconstruction: {_NO_UNIT}", (r'"sfm_data_version"\s*:',)),
    _Other(f"Meshroom's reconstruction: {_NO_UNIT}", (r'"views"\s*:', r'"intrinsics"\s*:', r'"poses"\s*:')),
    _Other(f"Metashape's cameras: {_NO_UNIT}", (r"<chunk\b",), ("document",)),
    _Other(f"Metashape's lens: {_LENS_ALONE}: {_ANEW}", (r"<projection>",), ("calibration",)),
    _Other(
        "OpenPose's camera parameters (XML of OpenCV), which tell no image size: "
        f"{_BY_HAND}: CameraMatrix is rotation and translation, Intrinsics the matrix",
        ("<CameraMatrix", "<Intrinsics"),
        ("opencv_storage",),
    ),
    _Other("OpenCV's XML: save it as .yml, one file a camera in a folder", (), ("opencv_storage",)),
    _Other(f"Captury's calibration (Skeletool): {_BY_HAND}", (r"\ASkeletool Camera Calibration",)),
    _Other(
        "Kalibr's camchain, whose world is the first camera: "
        f"{_BY_HAND}: T_cn_cnm1 leads from the camera before to each, distortion_coeffs of radtan are k1 k2 p1 p2, of "
        "equidistant those of fisheye = true",
        (r"^\s+camera_model\s*:", r"^\s+intrinsics\s*:"),
    ),
    _Other(f"ROS's camera_info: {_LENS_ALONE}: {_ANEW}", (r"^camera_matrix\s*:", r"^distortion_model\s*:")),
    _Other(
        "the lenses of OpenCV's stereo_calib, which tell no image size: write two files, left.yml and right.yml, with "
        "image_width, image_height, camera_matrix (M1, M2) and distortion_coefficients (D1, D2); rotation and "
        "translation of the right one are R and T of extrinsics.yml, in the unit of the board's squares",
        (r"^M1\s*:", r"^M2\s*:", r"^D1\s*:"),
    ),
    _Other(
        "the poses of OpenCV's stereo_calib: give the folder, which has the lenses (intrinsics.yml) too",
        (r"^R\s*:", r"^T\s*:", r"\A%YAML(?![\s\S]*^(?:K|\w*[Mm]atrix\w*)\s*:)"),
    ),
    _Other("keypoints as OpenPose writes them, expected cameras", (r"\A\s*\{", r'"people"\s*:\s*\[')),
    _Other(
        "a configuration of bodytrack: the calibration is what `rig` in it names",
        (r"^\[reading(?:\.\w+)?\]", r"^rig\s*=|^(?:model|persons?)\b|^\[(?:model|persons?|evidence)"),
    ),
    _Other(
        "Pose2Sim's configuration: its calibration is Calib*.toml in the folder calibration (or calib-*)",
        (r"^\[project\]", r"^\[(?:pose|calibration|triangulation)\b"),
    ),
)

_ALONE = (
    _Other(
        "one camera in OpenCV's YAML: give the folder that has such a file a camera",
        (r"\A%YAML", r"^(?:K|D|\w*[Mm]atrix\w*)\s*:"),
    ),
    _Other(
        f"DLT coefficients, eleven a camera, which tell no lens and no image size: {_ANEW}",
        (r"\A(?:[-+.\deE]+(?:[,;\t ]+[-+.\deE]+)*\s*\n){10}[-+.\deE]+(?:[,;\t ]+[-+.\deE]+)*\s*\Z",),
    ),
)
"""Of a file alone: a folder of the first is the layout `opencv`."""


def other_program(path: Path) -> str:
    """What a file or folder is that another program made and no layout reads, and what to do; empty if it is none."""
    if not path.is_dir():
        return _file(path)
    inside = path / "sparse" / "0" if (path / "sparse" / "0").is_dir() else path
    if (inside / "cameras.bin").is_file() and (inside / "images.bin").is_file():
        return f"COLMAP's reconstruction: {_NO_UNIT}"
    there = sorted(inside.iterdir())[:_MOST_FILES]
    # where there is YAML it is the calibration, and the layout opencv would read it
    kinds = next((kinds for kinds in _IN_FOLDERS if any(file.suffix.lower() in kinds for file in there)), ())
    files = [file for file in there if file.suffix.lower() in kinds]
    looks = [(lenient_text(file), xml_tag(file)) for file in files]
    return next((other.told for other in _OTHERS for look in looks if other.made(*look)), "")


_IN_FOLDERS = (".yml", ".yaml"), (".txt", ".xml", ".calib")
"""Files of which several, in a folder, make one calibration; the second where there is none of the first."""


def _file(path: Path) -> str:
    if path.name in ("cameras.bin", "images.bin"):
        return f"COLMAP's reconstruction: {_NO_UNIT}"
    try:
        with path.open("rb") as file:
            begin = file.read(16)
    except OSError:
        return ""  # whoever reads it says so
    if not begin and path.stat().st_size == 0:
        return "an empty file, expected a calibration"
    for magic, what in _MAGIC.items():
        if begin.startswith(magic):
            return f"{what}: {_BY_HAND}"
    if path.suffix.lower() in _ENDINGS and path.name != "cameraIntrinsicsExtrinsics.pickle":
        return _ENDINGS[path.suffix.lower()]
    look = lenient_text(path), xml_tag(path)
    return next((other.told for other in (*_OTHERS, *_ALONE) if other.made(*look)), "")
