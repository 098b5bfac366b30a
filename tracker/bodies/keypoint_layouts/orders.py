"""Keypoints without names: their orders in detectors' files, and numbers for missing ones."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.bodies.keypoints import plain_name
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError, nearest
from tracker.foundation.source_files import is_gap


def number(value: Any) -> float:
    """A number of a file; NaN for none, a ValueError or TypeError for another entry."""
    if value is None:
        return np.nan
    if isinstance(value, str):
        word = value.strip()
        return np.nan if is_gap(word) else float(word)
    try:
        return float(value)
    except OverflowError:
        return np.nan


def numbers(values: Any) -> Array:
    """An array of numbers, of a list or of equally long lists of them; see `number`."""
    try:
        return np.array(values, dtype=np.float64)
    except (ValueError, TypeError, OverflowError):  # words, or too large a number
        return np.array(_numbers(values), dtype=np.float64)


def _numbers(values: Any) -> Any:
    return [_numbers(one) if isinstance(one, list) else number(one) for one in values]


def with_gaps(found: Array) -> Array:
    """Keypoints (..., 3) with NaN throughout where one was not found.

    A number is missing or not finite, the confidence is not above 0, or the point is (0, 0) or (-1, -1): these stand
    for none in many programs, and no joint is there to the last digit.
    """
    x, y = found[..., 0], found[..., 1]
    lost = ~np.isfinite(found).all(axis=-1) | (found[..., 2] <= 0) | ((x == y) & ((x == 0) | (x == -1)))
    return np.where(lost[..., None], np.nan, found)


def last_number(name: str) -> int | None:
    """The last whole number in a name of a file or an image, which is the frame's; None if there is none."""
    digits = _DIGITS.findall(name)
    return int(digits[-1]) if digits and len(digits[-1]) <= _MOST_DIGITS else None


_DIGITS = re.compile(r"\d+")

_MOST_DIGITS = 18
"""Longer ones are no frame's number; Python converts none of some thousand digits."""


_COCO = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow"),
    *("right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle"),
    "right_ankle",
)
_FEET = ("left_toe", "left_small_toe", "left_heel", "right_toe", "right_small_toe", "right_heel")
_OPENPOSE_ARMS = ("right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist")
_OPENPOSE_LEGS = ("right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle")
_OPENPOSE_FACE = ("right_eye", "left_eye", "right_ear", "left_ear")
_BODY_25 = ("nose", "neck", *_OPENPOSE_ARMS, "pelvis", *_OPENPOSE_LEGS, *_OPENPOSE_FACE, *_FEET)
_BODY_25B = (*_COCO, "", "head_top", *_FEET)
_HALPE = (
    *(*_COCO, "head_top", "neck", "pelvis", "left_toe", "right_toe", "left_small_toe", "right_small_toe"),
    *("left_heel", "right_heel"),
)
_BLAZEPOSE = (
    *("nose", "", "left_eye", "", "", "right_eye", "", "left_ear", "right_ear", "", "", "left_shoulder"),
    *("right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", *[""] * 6, "left_hip", "right_hip"),
    *("left_knee", "right_knee", "left_ankle", "right_ankle", "left_heel", "right_heel", "left_toe", "right_toe"),
)
"""Without corners of eyes and mouth, and the six of the fingers; its `foot_index` is the big toe."""

_MPII_16 = (
    *("right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "pelvis", "", "", "head_top"),
    *("right_wrist", "right_elbow", "right_shoulder", "left_shoulder", "left_elbow", "left_wrist"),
)
_H36M = (
    *("pelvis", *_OPENPOSE_LEGS, "", "", "", "head_top", "left_shoulder", "left_elbow", "left_wrist"),
    *("right_shoulder", "right_elbow", "right_wrist"),
)
LAYOUTS: dict[str, tuple[str, ...]] = {
    "coco_17": _COCO,
    "h36m_17": _H36M,
    "coco_18": ("nose", "neck", *_OPENPOSE_ARMS, *_OPENPOSE_LEGS, *_OPENPOSE_FACE),
    "body_25": _BODY_25,
    "body_25b": _BODY_25B,
    "halpe_26": _HALPE,
    "blazepose_33": _BLAZEPOSE,
    "halpe_68": (*_HALPE, *[""] * 42),
    "wholebody_133": (*_COCO, *_FEET, *[""] * 110),
    "body_135": (*_BODY_25B, *[""] * 110),
    "halpe_136": (*_HALPE, *[""] * 110),
    "mpii_15": ("head_top", "", *_OPENPOSE_ARMS, *_OPENPOSE_LEGS, ""),
    "mpii_16": _MPII_16,
}
"""Names of the keypoints in their order; the first of a number is the usual one. `toe` is the big toe.

Nameless, and not read, are keypoints of hands and within the face, and those of the trunk with a place of
each detector's own: MPII's thorax and upper neck (also in BODY_25B), Human3.6M's spine, thorax and neck. Sources:
OpenPose, src/openpose/pose/poseParameters.cpp (coco_18, body_25, mpii_15) and openpose_train, experimental models
(body_25b, body_135); MMPose, configs/_base_/datasets (coco_17, h36m_17, mpii_16, wholebody_133); Halpe-FullBody, README
(halpe_26, halpe_136); MediaPipe, PoseLandmark; Pose2Sim, skeletons.py (halpe_68).
"""

_ALSO_CALLED = {"coco133": "wholebody_133", "wholebody": "wholebody_133", "blazepose": "blazepose_33"}
"""Names in Pose2Sim and MediaPipe."""


@dataclass(frozen=True)
class Order:
    """Order of keypoints in a file."""

    all_names: tuple[str, ...]
    """Names of all K keypoints of a person; empty for those left out."""

    layout: str = ""
    """Its name in `LAYOUTS`; empty if the file or the user gives names."""

    by_number: bool = False
    """Whether the number of keypoints alone decided."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the keypoints that are read."""
        return tuple(name for name in self.all_names if name)

    def read(self, person: Array, where: str) -> Array:
        """The keypoints (K, 3) of a person that are read.

        Raises:
            SequenceError: there are more or fewer.
        """
        if len(person) != len(self.all_names):
            called = f"{self.layout} has" if self.layout else "the names given are"
            raise SequenceError(f"{where}: {len(person)} keypoints, {called} {len(self.all_names)}")
        return person[[bool(name) for name in self.all_names]]

    @property
    def others(self) -> tuple[str, ...]:
        """Other layouts of as many keypoints."""
        return tuple(k for k, names in LAYOUTS.items() if len(names) == len(self.all_names) and k != self.layout)

    @property
    def taken_for(self) -> str:
        """The keypoints, and the source of their order."""
        if not self.layout:
            return "what the file or names call them"
        return f"{self.layout}, told by their number" if self.by_number else self.layout

    def __str__(self) -> str:
        """The number of keypoints of a person, and their order."""
        also = f", as many as {' and '.join(self.others)}" if self.by_number and self.others else ""
        return f"{len(self.all_names)} a person{f' ({self.taken_for}{also})' if self.layout else ''}"


def order_told(names: tuple[str, ...], layout: str | None) -> Order | None:
    """The order given by names or by a layout's name; None without either.

    Raises:
        SequenceError: no layout has the name, a name repeats, or both are given.
    """
    if names and layout is not None:
        raise SequenceError(f'names and layout = "{layout}" both give the order of keypoints: leave one of them out')
    if names:
        check_names(names, "names")
        return Order(names)
    if layout is None:
        return None
    plain = {_plain(known): known for known in LAYOUTS} | _ALSO_CALLED
    if _plain(layout) not in plain:
        raise SequenceError(f'layout = "{layout}": no such layout of keypoints; {nearest(layout, LAYOUTS)}')
    known = plain[_plain(layout)]
    return Order(LAYOUTS[known], known)


def _plain(layout: str) -> str:
    return "".join(sign for sign in layout.lower() if sign.isalnum())


def order_of(n_keypoints: int, where: Path) -> Order:
    """The usual order of a number of keypoints.

    Raises:
        SequenceError: no known detector writes that many.
    """
    fitting = [layout for layout, names in LAYOUTS.items() if len(names) == n_keypoints]
    if not fitting:
        known = ", ".join(f"{len(names)} ({layout})" for layout, names in LAYOUTS.items())
        raise SequenceError(f"{where}: {n_keypoints} keypoints a person, expected {known}, or give their names")
    return Order(LAYOUTS[fitting[0]], fitting[0], by_number=True)


def check_names(names: tuple[str, ...], where: str) -> None:
    """Refuses equal names of keypoints, in any spelling; empty ones are left out.

    Raises:
        SequenceError: two are equal.
    """
    seen: dict[str, str] = {}
    for name in filter(None, names):
        if (other := seen.setdefault(plain_name(name), name)) is not name or names.count(name) > 1:
            both = f'"{name}" is there twice' if other == name else f'"{other}" and "{name}" are the same'
            raise SequenceError(f"{where}: {both}, expected each keypoint once")
