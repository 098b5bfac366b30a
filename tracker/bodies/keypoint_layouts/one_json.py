"""One JSON file a video: AlphaPose's results, those and data sets of COCO, and what MMPose saves of a video."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tracker.bodies.keypoint_layouts._numbers import last_number
from tracker.bodies.keypoint_layouts._persons import is_person, persons_of, tells_persons
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError, shortened
from tracker.foundation.source_files import json_of

_FRAME = ("frame_id", "frame_idx", "frame_index", "frame")
"""What a frame's number is called beside its persons; `frame_id` by MMPose."""

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
"""A frame's number, the name of its image (empty where there is none), and what holds its persons."""


def _counted(frames: Any, path: Path, first: int) -> Iterator[_Entry]:
    """Frames that tell their number, from 0 on."""
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
