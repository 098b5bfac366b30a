"""One JSON file a video: AlphaPose's results, those and data sets of COCO, and what MMPose saves of a video."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tracker.bodies.keypoint_layouts.orders import last_number, numbers, with_gaps
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError, shortened
from tracker.foundation.source_files import json_of, text_of

_PEOPLE = ("people", "bodies", "instances", "predictions", "annots")
"""Keys of lists of persons in OpenPose and Pose2Sim, AlphaPose (`--format cmu`), MMPose (two), EasyMocap."""

_KEYPOINTS = ("pose_keypoints_2d", "pose_keypoints", "joints", "keypoints")
"""Keys of their keypoints: in OpenPose today and before 1.3, in AlphaPose, and in all the others."""

_SCORES = ("score", "visibility", "confidence", "visible")
"""Keys of confidence in points that are objects: in TensorFlow.js, MediaPipe, others, Ultralytics."""

_EXPECTED_PERSONS = 'expected {"people": [{"pose_keypoints_2d": [x, y, c, ...]}]}'


def tells_persons(content: Any) -> bool:
    """Whether this has a list of persons, even an empty one."""
    return isinstance(content, dict) and any(key in content for key in _PEOPLE)


def is_person(value: Any) -> bool:
    """Whether this has keypoints of one person."""
    return isinstance(value, dict) and any(key in value for key in _KEYPOINTS)


def persons_of(content: Any, path: Path) -> list[Array]:
    """(K, 3) pixel and confidence of each person with any detection; NaN for missing keypoints.

    Raises:
        SequenceError: no known detector writes this.
    """
    if isinstance(content, dict):
        if not tells_persons(content) and is_person(content):
            content = {"people": [content]}  # of one person
        if not tells_persons(content) and any(isinstance(value, list | dict) for value in content.values()):
            raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED_PERSONS}")
        content = next((content[key] for key in _PEOPLE if key in content), None)
    if not content:
        return []
    if not isinstance(content, list):
        raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED_PERSONS}")
    # an image's persons within a list of one image: what MMPose's inferencer returns
    inner = content[0] if len(content) == 1 and isinstance(content[0], list) else content
    found = (_keypoints(person, path) for person in inner)
    return [person for person in found if np.isfinite(person).any()]


def _keypoints(person: Any, path: Path) -> Array:
    """(K, 3) of one person; empty without keypoints."""
    if not person:
        return np.zeros((0, 3))
    if not isinstance(person, dict):
        raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED_PERSONS}")
    key = next((key for key in _KEYPOINTS if key in person), None)
    if key is None and not any(other.endswith("keypoints_2d") for other in person):  # hands and faces alone
        raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED_PERSONS}")
    if key is None or not person[key]:
        return np.zeros((0, 3))
    try:
        values, scores = numbers(_listed(person[key])), numbers(person.get("keypoint_scores") or [])
    except (ValueError, TypeError, RecursionError) as error:
        raise SequenceError(f"{path}: {key} has an entry that is no number") from error
    return with_gaps(_with_confidence(values, scores, f"{path}: {key}"))


def _listed(points: Any) -> Any:
    """Points that are objects, as TensorFlow.js writes them, or an object of lists, as Ultralytics does, as lists."""
    if isinstance(points, list) and all(isinstance(point, dict) for point in points):
        return [[point.get("x"), point.get("y"), _score(point, 1.0)] for point in points]
    if isinstance(points, dict):
        x, y = points.get("x") or [], points.get("y") or []
        return [list(point) for point in zip(x, y, _score(points, [1.0] * len(x)), strict=True)]
    return points


def _score(point: dict[str, Any], otherwise: Any) -> Any:
    return next((point[key] for key in _SCORES if key in point), otherwise)


def _with_confidence(values: Array, scores: Array, where: str) -> Array:
    """(K, 3) of a flat list or of one of points, with confidences within or beside it."""
    if values.ndim == 1:
        width = 2 if scores.size else 3
        if values.size % width:
            raise SequenceError(f"{where} has {values.size} numbers, expected x, y, confidence of each keypoint")
        values = values.reshape(-1, width)
    if values.ndim != 2 or values.shape[1] not in (2, 3) or scores.size not in (0, len(values)):
        raise SequenceError(f"{where}: expected x, y, confidence of each keypoint, or x, y and a score beside it")
    if values.shape[1] == 3 and scores.size:
        raise SequenceError(f"{where} has points in space, expected pixels: run the 2-D part of the detector alone")
    if values.shape[1] == 3:
        return values
    told = scores.ravel() if scores.size else np.ones(len(values))
    return np.column_stack([values, told])


_FRAME = ("frame_id", "frame_idx", "frame_index", "frame")
"""Keys of a frame's number beside its persons; `frame_id` in MMPose."""

_EXPECTED = (
    "expected AlphaPose's results (a list of image_id and keypoints, or images' names with bodies or people), "
    "or MMPose's of a video (a list of frame_id and instances); a folder of JSON files, one a frame, is read as well"
)


def read_one_json(path: Path) -> tuple[dict[int, list[Array]], bool]:
    """Persons by frame; and whether frames are numbers in names of images, not counted from 0 on.

    Raises:
        SequenceError: it is not one of those, or its images have no numbers.
    """
    content = json_of(path, SequenceError)
    if isinstance(content, dict) and "instance_info" in content:
        # MMPose's demonstrations count a video's frames from 1 on, its inferencer from 0
        return _grouped(_counted(content["instance_info"], path, first=1), path), False
    if isinstance(content, list) and all(isinstance(one, dict) for one in content):
        if all("image_id" in one for one in content):
            return _grouped((_image(one["image_id"], [one], path) for one in content), path), True
        if all(any(key in one for key in _FRAME) for one in content):
            return _grouped(_counted(content, path, first=0), path), False
    if isinstance(content, dict) and {"images", "annotations"} <= content.keys():
        return _grouped(_annotated(content["images"], content["annotations"], path), path), True
    if isinstance(content, dict) and content and all(map(_of_image, content.values())):
        return _grouped((_image(name, one, path) for name, one in content.items()), path), True
    if tells_persons(content):
        raise SequenceError(f"{path}: the persons of one image, expected the folder of such files, one a frame")
    keys = ", ".join(f'"{shortened(str(key))}"' for key in list(content)[:4]) if isinstance(content, dict) else "a list"
    raise SequenceError(f"{path}: keypoints of no known form ({keys}), {_EXPECTED}")


def _of_image(value: Any) -> bool:
    """Whether these are the persons of one image; a plain list in what AlphaPose's PoseFlow writes."""
    return tells_persons(value) or (isinstance(value, list) and all(map(is_person, value)))


_Entry = tuple[int, str, Any]
"""A frame's number, the name of its image (empty without one), and its persons."""


def _counted(frames: Any, path: Path, first: int) -> Iterator[_Entry]:
    """Frames with numbers, from 0 on."""
    if not isinstance(frames, list) or not all(isinstance(one, dict) for one in frames):
        raise SequenceError(f"{path}: instance_info is no list of frames, {_EXPECTED}")
    for one in frames:
        number = next((one[key] for key in _FRAME if key in one), None)
        if not isinstance(number, int) or number < first:
            told = shortened(str(number))
            raise SequenceError(f"{path}: {told} as the number of a frame, expected whole ones from {first} on")
        yield number - first, "", one


def _image(name: Any, persons: Any, path: Path) -> _Entry:
    """An image's persons; AlphaPose calls the images of a video 0.jpg, 1.jpg, ..."""
    number = name if isinstance(name, int) else last_number(Path(str(name)).stem)
    if number is None or number < 0:
        raise SequenceError(f'{path}: no number in the image name "{shortened(str(name))}", expected e.g. 000012.jpg')
    return number, str(name), persons


def _annotated(images: Any, annotations: Any, path: Path) -> Iterator[_Entry]:
    """A data set of COCO: annotations name images by their `id`."""
    try:
        names = {image["id"]: image["file_name"] for image in images}
        told = [(names[one["image_id"]], one) for one in annotations]
    except (KeyError, TypeError) as error:
        raise SequenceError(
            f"{path}: no data set of COCO: an image without id, or an annotation without one"
        ) from error
    return (_image(name, [one], path) for name, one in told)


def _grouped(entries: Iterator[_Entry], path: Path) -> dict[int, list[Array]]:
    """The persons of all frames; several entries of an image are several persons."""
    found: dict[int, list[Array]] = {}
    called: dict[int, str] = {}
    for number, name, persons in entries:
        if called.setdefault(number, name) != name:
            raise SequenceError(
                f'{path}: the images "{shortened(called[number])}" and "{shortened(name)}" have the same number, '
                "expected one view a file"
            )
        found.setdefault(number, []).extend(persons_of(persons, path))
    return found


# Folders of JSON files, one a frame, as OpenPose, Pose2Sim, AlphaPose and MMPose write them.


def json_files(folder: Path) -> list[Path]:
    """The JSON files of a folder in their order, without those that a system keeps beside them."""
    return [path for path in sorted(folder.glob("*.json")) if not path.name.startswith(".")]


def files_of(folder: Path) -> dict[int, Path]:
    """The files of a folder; the last number in a file's name is that of its frame.

    Raises:
        SequenceError: there are none, or two of one number.
    """
    files: dict[int, Path] = {}
    for path in json_files(folder):
        number = last_number(path.stem)
        if number is None:
            raise SequenceError(f"{path}: no number in the file's name, expected e.g. {folder.name}_000000.json")
        if number in files:
            raise SequenceError(f"{path}: {files[number].name} has the same number in its name")
        files[number] = path
    if not files:
        others = sorted({path.suffix for path in folder.iterdir() if path.suffix and not path.name.startswith(".")})
        instead = f" (but {', '.join(others[:4])})" if others else ""
        raise SequenceError(
            f"{folder}: no .json file in it{instead}, expected one a frame, as OpenPose and Pose2Sim write"
        )
    return files


def persons_in(path: Path) -> list[Array]:
    """(K, 3) keypoints of each person in a file; none in an empty one.

    Raises:
        SequenceError: the file is not a detector's.
    """
    return persons_of(json_of(path, SequenceError), path) if text_of(path, SequenceError).strip() else []
