"""The moving back whose surface is known exactly: its images, and points with where they truly go."""

from __future__ import annotations

import copy
import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np

from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.arrays import Array, Image, Mask
from tracker.points.following.births import chosen_evenly, points_of_surface
from tracker.points.following.points import NewPoints
from tracker.points.surfaces.growth import Growth
from tracker.points.surfaces.surface import SurfaceMeasurement, measure_surface

VIEWS = ("left", "centre", "right")
# The middle one of three cameras in line holds the templates.
CENTRE = 1

Change = Callable[[int, tuple[Image, ...]], tuple[Image, ...]]
"""What is done to the images of a frame, by its number."""


@dataclass(frozen=True)
class Start:
    """Points on the surface at frame 0, and where they truly go."""

    new: NewPoints
    material: Any
    positions: Array
    """(T, N, 3) metres."""

    visible: Mask
    """(T, V, N)"""


class Back:
    """The recording, its truth, and points to start from."""

    def __init__(self, folder: Path, n_frames: int) -> None:
        self.folder, self.n_frames = folder / "back", n_frames
        self.truth = _truth_of(folder).Truth(self.folder)
        self.rig: Rig = load_rig(self.folder / "calibration.json")
        self._starts: dict[tuple[int, int], Start] = {}

    def first(self, n_frames: int) -> Back:
        """Its first frames, with the same points."""
        shorter = copy.copy(self)
        shorter.n_frames = min(self.n_frames, n_frames)
        return shorter

    def images(self, index: int) -> tuple[Image, ...]:
        """Grey images of a frame."""
        paths = (self.folder / "images" / f"{view}_{index:03d}.jpg" for view in VIEWS)
        return tuple(np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8) for path in paths)

    def frames(self, change: Change | None = None) -> Iterator[Frame]:
        """All frames, changed."""
        for index in range(self.n_frames):
            images = self.images(index)
            yield Frame(index, index / 50, images if change is None else change(index, images))

    def start(self, n_points: int, step_px: int = 3, cloth: bool = True) -> Start:
        """Points of a measured surface whose truth is known."""
        if (n_points, step_px) not in self._starts:
            measurement = SurfaceMeasurement(growth=Growth(step_px=step_px))
            new = points_of_surface(measure_surface(measurement, Frame(0, 0.0, self.images(0)), self.rig))
            material = self.truth.material(new.pixels[CENTRE], CENTRE, 0)
            known = (material[0] >= 0) & (self.truth.on_cloth(material) | (not cloth))
            rows = np.flatnonzero(known)
            rows = rows[chosen_evenly(len(rows), n_points)]
            self._starts[n_points, step_px] = self.known(new.select(rows), tuple(part[rows] for part in material))
        return self._starts[n_points, step_px]

    def known(self, new: NewPoints, material: Any) -> Start:
        """Points with where they truly go."""
        positions, visible = [], []
        for index in range(self.n_frames):
            positions.append(self.truth.where(material, index))
            visible.append([self.truth.visible(material, index, view, 0.006) for view in range(len(VIEWS))])
            self.truth._cache.clear()
        return Start(new, material, np.array(positions), np.array(visible))


def _truth_of(folder: Path) -> Any:
    """The module beside the recording, its kernel compiled anew: a folder of recordings is no place for a cache."""
    sys.path.insert(0, str(folder))
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    truth: Any = importlib.import_module("truth")
    sys.dont_write_bytecode = written
    truth._raster = numba.njit(nogil=True, error_model="numpy")(truth._raster.py_func)
    return truth
