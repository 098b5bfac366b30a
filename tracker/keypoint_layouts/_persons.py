"""The persons that a JSON file tells of one image, as detectors write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tracker.arrays import Array
from tracker.errors import SequenceError
from tracker.keypoint_layouts._numbers import numbers, with_gaps

_PEOPLE = ("people", "bodies", "instances", "predictions")
"""What lists of persons are called by OpenPose and Pose2Sim, by AlphaPose (`--format cmu`), by MMPose."""

_KEYPOINTS = ("pose_keypoints_2d", "joints", "keypoints")
"""What their keypoints are called, in the same order; `keypoints` also in results of COCO."""

_EXPECTED = 'expected {"people": [{"pose_keypoints_2d": [x, y, c, ...]}]}'


def tells_persons(content: Any) -> bool:
    """Whether this has a list of persons, even of nobody."""
    return isinstance(content, dict) and any(key in content for key in _PEOPLE)


def persons_of(content: Any, path: Path) -> list[Array]:
    """(K, 3) pixel and confidence of everybody of whom something was found; NaN for keypoints that were not found.

    Raises:
        SequenceError: this is nothing that a detector is known to write.
    """
    if isinstance(content, dict):
        listed = next((content[key] for key in _PEOPLE if key in content), None)
        if listed is None and not tells_persons(content) and any(isinstance(v, list | dict) for v in content.values()):
            raise SequenceError(f"{path}: not as OpenPose writes it, {_EXPECTED}")
        content = listed
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
        values = numbers(person[key])
        scores = numbers(person.get("keypoint_scores") or [])
    except (ValueError, TypeError, RecursionError) as error:
        raise SequenceError(f"{path}: {key} has an entry that is no number") from error
    return with_gaps(_with_confidence(values, scores, f"{path}: {key}"))


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
