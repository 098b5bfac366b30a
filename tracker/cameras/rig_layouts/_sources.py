"""Files as text and tables, bounded in size, every fault one sentence; their content shows the format."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from tracker.foundation.errors import CalibrationError, shortened
from tracker.foundation.source_files import each_once

_LARGEST_BYTES = 2**20
"""A camera takes 0.3 to 1 kB in every layout: a thousand cameras fit."""

_LARGEST_FILE = 2**25
"""Largest file that also has the points of its calibration, bytes."""

_LONGEST_LINE = 10_000
"""Longest line of a TOML file: the time of Python's parser for a dotted key grows with the square of its length."""

_POINTS = re.compile(r"^(\s*[\w-]+\s*=\s*)\[[\[\]\d\s.,eE+\-naif]*\]\s*$")
"""A line of TOML that has a list of numbers alone: as long as that no camera has one."""

_TOML = re.compile(r"^[ \t]*(?:matrix|size|distortions|translation)[ \t]*=", re.MULTILINE)
"""Entries of a camera in TOML, where the file's name does not say that it is TOML."""

_ROOT = re.compile(r"<([A-Za-z_][\w.:-]*)")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_PLACE = re.compile(r"\(at line (\d+), column \d+\)")


def text_of(path: Path, errors: str = "strict") -> str:
    """The content of a text file in UTF-8; long lists of points in TOML are empty in it.

    Args:
        path: the file.
        errors: as of `bytes.decode`.

    Raises:
        CalibrationError: it cannot be read, is empty or no text, or is larger than any calibration.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST_FILE + 1)
        text = content.decode("utf-8-sig", errors)
    except OSError as error:
        raise CalibrationError(f"cannot read the calibration: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise CalibrationError("cannot read the calibration: not a text file") from error
    if len(content) > _LONGEST_LINE:
        text = "\n".join(_POINTS.sub(r"\1[]", line) if len(line) > _LONGEST_LINE else line for line in text.split("\n"))
    if len(text) > _LARGEST_BYTES:
        raise CalibrationError("larger than 1 MiB, expected a calibration: some hundred bytes a camera")
    return text


def lenient_text(path: Path) -> str:
    """Text at the begin of a file, to recognize it; empty without text."""
    try:
        return text_of(path, "replace") if path.is_file() else ""
    except CalibrationError:
        return ""


def written_in(path: Path) -> str:
    """Format of a file: `toml`, `json`, `xml`, `yaml` (OpenCV's), or nothing of these.

    The content decides; the name does if the content is damaged or not text.
    """
    if not path.is_file():
        return ""
    text = lenient_text(path).lstrip()
    for kind, begin in (("xml", "<"), ("yaml", "%YAML"), ("json", "{")):
        if text.startswith(begin):
            return kind
    if _TOML.search(text):
        return "toml"
    return {".toml": "toml", ".json": "json"}.get(path.suffix.lower(), "")


def xml_tag(path: Path) -> str:
    """The name of the outermost element of an XML file; empty of other files."""
    if written_in(path) != "xml":
        return ""
    found = _ROOT.search(_COMMENT.sub("", lenient_text(path)))
    return found[1] if found else ""


def xml_root(path: Path) -> ElementTree.Element:
    """The outermost element of an XML file; one with a document type, which could name other files, is refused."""
    text = text_of(path, "replace")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CalibrationError("a document type in it, which a calibration does not need")
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise CalibrationError(f"not XML: {line_fault(text, error.position[0])}") from error
    except ValueError as error:
        raise CalibrationError("not XML: it says that it is written in another alphabet than it is") from error


def toml_table(path: Path) -> dict[str, Any]:
    """The content of a TOML file; entries that are the word "null", as rtoml writes None, are as if not there.

    Except a name: a camera may be called so.
    """
    text = text_of(path)
    longest = max((len(line) for line in text.splitlines()), default=0)
    if longest > _LONGEST_LINE:
        raise CalibrationError(f"not a TOML file of cameras: a line of {longest} characters in it")
    try:
        return _without_null(tomllib.loads(text))
    except RecursionError as error:
        raise CalibrationError("not a TOML file: nested too deeply") from error
    except ValueError as error:  # also of numbers too long to convert
        place = _PLACE.search(str(error))
        raise CalibrationError(f"not a TOML file: {line_fault(text, int(place[1]) if place else 0)}") from error


def json_content(path: Path) -> Any:
    """The content of a JSON file, whatever it is."""
    text = text_of(path)
    try:
        return json.loads(text, object_pairs_hook=each_once(CalibrationError))
    except RecursionError as error:
        raise CalibrationError("not a JSON file: nested too deeply") from error
    except ValueError as error:
        raise CalibrationError(f"not a JSON file: {line_fault(text, getattr(error, 'lineno', 0))}") from error


def json_table(path: Path) -> dict[str, Any]:
    """The content of a JSON file that is a table."""
    content = json_content(path)
    if not isinstance(content, dict):
        raise CalibrationError("expected a table of cameras")
    return content


def line_fault(text: str, number: int) -> str:
    """Place of a fault: a line by its number, from 1; 0 if unknown."""
    lines = text.splitlines()
    if not 1 <= number <= len(lines):
        return "it ends too early" if number > len(lines) else "a number or a sign in it cannot be read"
    return f"line {number} cannot be read: {shortened(lines[number - 1].strip())!r}"


def _without_null(table: dict[str, Any]) -> dict[str, Any]:
    return {
        key: _without_null(value) if isinstance(value, dict) else value
        for key, value in table.items()
        if value != "null" or key == "name"
    }


_BY_HAND = "write its cameras into a rig.toml: size, matrix, distortions, rotation, translation (docs/formats.md)"
_ANEW = "calibrate with `bodytrack calibrate`"
_NO_UNIT = (
    f"its lengths have no unit and its axes no floor: {_ANEW}, or {_BY_HAND} and tell one measured length by "
    "`rig convert --scale`"
)
_LENS_ALONE = "a lens and no pose, so that no camera can be placed"

_MOST_FILES = 300
"""Largest number of a folder's entries to look at."""

_MAGIC = {
    b"MATLAB 5.0": "a MATLAB file",
    b"\x89HDF": "an HDF5 file, as MATLAB from version 7.3 on writes",
    b"\x93NUMPY": "an array of numpy",
    b"PK\x03\x04": "an archive (.zip, .npz, .psz)",
}
"""First bytes of binary calibrations of other programs; Python's pickles have an ending."""

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
"""Layouts of single files: a folder of the first is the layout `opencv`."""


def other_program(path: Path) -> str:
    """Name of another program's file or folder that no layout reads, and advice; empty for others."""
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
"""Files of which several, in a folder, make one calibration; the second kind without any of the first."""


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
