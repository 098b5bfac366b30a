"""The persons that a JSON file tells of one image, as detectors write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tracker.bodies.keypoint_layouts._numbers import numbers, with_gaps
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError

_PEOPLE = ("people", "bodies", "instances", "predictions", "annots")
"""What lists of persons are called by OpenPose and Pose2Sim, AlphaPose (`--format cmu`), MMPose (two), EasyMocap."""

_KEYPOINTS = ("pose_keypoints_2d", "pose_keypoints", "joints", "keypoints")
"""What their keypoints are called: by OpenPose today and before 1.3, by AlphaPose, and by all the others."""

_SCORES = ("score", "visibility", "confidence", "visible")
"""What confidence is called where a point is an object: by TensorFlow.js, MediaPipe, others, Ultralytics."""

_EXPECTED = 'expected {"people": [{"pose_keypoints_2d": [x, y, c, ...]}]}'


def tells_persons(content: Any) -> bool:
    """Whether this has a list of persons, even of nobody."""
    return isinstance(content, dict) and any(key in content for key in _PEOPLE)


def is_person(value: Any) -> bool:
    """Whether this has keypoints of one person."""
    return isinstance(value, dict) and any(key in value for key in _KEYPOINTS)


def persons_of(content: Any, path: Path) -> list[Array]:
    """(K, 3) pixel and confidence of everybody of whom something was found; NaN for keypoints that were not found.

    Raises:
        SequenceError: this is nothing that a detector is known to write.
    """
    if isinstance(content, dict):
        if not tells_persons(content) and is_person(content):
            content = {"people": [content]}  # of one person
        if not tells_persons(content) and any(isinstance(value, list | dict) for value in content.values()):
            raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED}")
        content = next((content[key] for key in _PEOPLE if key in content), None)
    if not content:
        return []
    if not isinstance(content, list):
        raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED}")
    # an image's persons within a list of one image: what MMPose's inferencer returns
    inner = content[0] if len(content) == 1 and isinstance(content[0], list) else content
    found = (_keypoints(person, path) for person in inner)
    return [person for person in found if np.isfinite(person).any()]


def _keypoints(person: Any, path: Path) -> Array:
    """(K, 3) of one person; nothing of one who has none."""
    if not person:
        return np.zeros((0, 3))
    if not isinstance(person, dict):
        raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED}")
    key = next((key for key in _KEYPOINTS if key in person), None)
    if key is None and not any(other.endswith("keypoints_2d") for other in person):  # hands and faces alone
        raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED}")
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
