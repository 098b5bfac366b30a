"""Files of keypoints from detectors; one reader for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from tracker.bodies.keypoint_layouts.one_json import files_of, json_files, persons_in, read_one_json
from tracker.bodies.keypoint_layouts.orders import Order, last_number, order_of, order_told
from tracker.bodies.keypoint_layouts.tables import read_table
from tracker.bodies.keypoints import Detections
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError

_SAMPLE = 20
"""Frames with persons that show the layout and the unit, spread over all, because persons who come in are cut off."""

_EXPECTED = (
    "expected a folder of OpenPose's JSON files, one JSON file a video as AlphaPose writes it, "
    "or a CSV table of DeepLabCut or SLEAP"
)

_OTHERS = {
    ".h5": "HDF of DeepLabCut, Anipose or SLEAP is not read: write CSV (deeplabcut.analyze_videos_converth5_to_csv)",
    ".slp": "SLEAP's project is not read: export its analysis CSV, one a video",
    ".npy": "arrays, as FreeMoCap writes them for all cameras at once, do not say what is in them: write a CSV table",
    ".npz": "arrays do not say what is in them: write a CSV table",
    ".pkl": "pickles, as OpenCap and MMPose's test write them, can run programs: write JSON, or a CSV table",
    ".pickle": "pickles, as DeepLabCut's detections are, can run programs: write JSON, or a CSV table",
    ".txt": "labels, as YOLO writes them, are not read: write JSON, or a CSV table",
    ".xlsx": "a spreadsheet is not read: save it as CSV",
}
"""Other outputs of detectors, and the way out."""


@dataclass(frozen=True)
class KeypointSource:
    """The keypoints of one view."""

    path: Path
    numbers: tuple[int, ...]
    """Numbers of the images in the file, in their order."""

    persons: Callable[[int], Sequence[Array]]
    """(K, 3) of each person in an image of a number."""

    named: bool
    """Whether the names of the images give the numbers, or they count from the first image on."""

    order: Order | None = None
    """None without names and without any person."""

    def at(self, number: int) -> Detections:
        """Detections in an image, by the number in its name or its position; empty if the file has none.

        Raises:
            SequenceError: it is not a detector's file, or a person has another number of keypoints.
        """
        order = self.order or Order(())
        read = [order.read(person, f"{self.path}, image {number}") for person in self.persons(number)]
        return Detections(order.names, _stacked(read, order))

    @cached_property
    def sample(self) -> Array:
        """(N, K, 3) persons of some images, spread over all; see `at`."""
        order = self.order or Order(())
        return _stacked([order.read(person, str(self.path)) for person in self.some_persons], order)

    @cached_property
    def some_persons(self) -> tuple[Array, ...]:
        """(K, 3) of each person in some images, spread over all; of the first with a person if these show none."""
        spread = self.numbers[:: max(1, len(self.numbers) // _SAMPLE)]
        found = tuple(person for number in spread for person in self.persons(number))
        return found or tuple(next((one for one in map(self.persons, self.numbers) if len(one)), ()))


def open_keypoints(path: Path, names: tuple[str, ...] = (), layout: str | None = None) -> KeypointSource:
    """The keypoints of one view.

    Args:
        path: a folder of JSON files as OpenPose and Pose2Sim write them, one JSON file a video as AlphaPose and MMPose
            do, or a CSV table as DeepLabCut and SLEAP do.
        names: of the keypoints in JSON files, an empty one for a keypoint to leave out.
        layout: of those, one of `LAYOUTS`; without names and layout, their number decides.

    Raises:
        SequenceError: the file is missing or of an unknown kind, or names and layout do not fit it.
    """
    order = order_told(names, layout)
    if path.suffix.lower() == ".csv":
        return _table(path, order)
    if path.is_dir() and len(alone := json_files(path)) == 1 and last_number(alone[0].stem) is None:
        path = alone[0]  # AlphaPose's folder of a video holds alphapose-results.json
    if path.is_dir():
        files = files_of(path)
        source = KeypointSource(path, tuple(sorted(files)), lambda n: persons_in(files[n]) if n in files else [], True)
    elif path.suffix.lower() == ".json" and path.exists():
        found, named = read_one_json(path)
        source = KeypointSource(path, tuple(sorted(found)), lambda n: found.get(n, []), named)
    else:
        told = f"is neither a folder nor a .json nor a .csv file; {_EXPECTED}"
        told = _OTHERS.get(path.suffix.lower(), told) if path.exists() else f"does not exist; {_EXPECTED}"
        raise SequenceError(f"{path}: {told}")
    if order is None and source.some_persons:
        order = order_of(len(source.some_persons[0]), path)
    source = replace(source, order=order)
    _ = source.sample  # a person of another number of keypoints is told before the first frame
    return source


def _table(path: Path, order: Order | None) -> KeypointSource:
    if order is not None:
        raise SequenceError(f"{path}: a table names its keypoints itself, leave names and layout out")
    names, found, named = read_table(path)
    return KeypointSource(path, tuple(sorted(found)), lambda n: list(found.get(n, ())), named, Order(names))


def _stacked(persons: Sequence[Array], order: Order) -> Array:
    """(N, K, 3) of the persons with any keypoint left."""
    seen = [person for person in persons if np.isfinite(person).any()]
    return np.array(seen).reshape(len(seen), len(order.names), 3)
