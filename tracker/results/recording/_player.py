"""What the report's player needs: the bodies, their movements, the cameras and a video, as text for the page."""

from __future__ import annotations

import base64
import gzip
import json
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tracker.bodies.body.surface import surface_of
from tracker.bodies.scene import Person
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Integers
from tracker.results.recording import RunContext
from tracker.results.recording._motion import Motion, Motions
from tracker.results.recording._preview import FPS, Preview
from tracker.tracking.doubt import in_words
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step

_SHEET, _WIDEST = 17, 4.0
"""Points along each side of the picture of a bent view; 76 degrees from the axis, beyond which no picture is drawn."""

_N_ETA, _N_OMEGA = 9, 12
"""Latitudes and longitudes of a part's mesh: 100 kB a body."""

_SURE, _UNSURE, _LOST = 0, 1, 2
"""What is known of a part in a frame, as player.js colours it."""


class Player:
    """The frames so far; of runs that are longer than `most_frames` every second, third, ..."""

    def __init__(self, run: RunContext, most_frames: int) -> None:
        self._run, self._every = run, max(1, -(-run.n_frames // most_frames))
        self._motions, self._preview = Motions(run), Preview(run)
        self._known: list[list[NDArray[np.uint8]]] = []
        self._frames: list[int] = []
        self._why: list[str] = []
        self._n_added = 0

    def add(self, step: Step) -> None:
        """Takes one frame."""
        self._n_added += 1
        if (self._n_added - 1) % self._every:
            return
        self._frames.append(step.frame.index)
        self._motions.add(step)
        self._known.append([_known(p, e) for p, e in zip(step.scene.persons, step.estimates, strict=True)])
        self._why.append(_why(step))
        self._preview.add(step)

    def content(self) -> dict[str, str]:
        """Texts for the page: the scene as JSON, the video and the libraries."""
        motions = self._motions.all()
        scene = {
            "frames": self._frames,
            "why": self._why,
            "times": [round(float(time_s), 4) for time_s in motions[0].times_s],
            "interval": self._run.interval_s * self._every,
            "fps": FPS,
            "persons": [self._person(k, motion) for k, motion in enumerate(motions)],
            "cameras": [
                _camera(camera, window)
                for camera, window in zip(self._run.scene.rig.cameras, self._preview.windows, strict=True)
            ],
        }
        folder = files("tracker.results.recording") / "_report"
        return {
            "scene": json.dumps(scene, separators=(",", ":")).replace("<", "\\u003c"),
            "video": base64.b64encode(self._preview.finish()).decode(),
            "three": base64.b64encode((folder / "three.min.js.gz").read_bytes()).decode(),
            "script": (folder / "player.js").read_text(encoding="utf-8"),
        }

    def _person(self, k: int, motion: Motion) -> dict[str, Any]:
        """Mesh, placements of the segments and what is known of the parts of a person."""
        surface = surface_of(motion.body, _N_ETA, _N_OMEGA)
        joints = np.array([segment.joint for segment in motion.body.segments])
        placed = motion.segments(motion.filled)
        turns = Rotation.from_matrix(placed[..., :3, :3].reshape(-1, 3, 3)).as_quat().reshape(*placed.shape[:2], 4)
        return {
            "name": motion.name,
            "segments": [segment.name for segment in motion.body.segments],
            "parts": [part.name for part in motion.body.parts],
            "segments_of_parts": motion.body.segments_of_parts.tolist(),
            "points": _text(surface.points - joints[surface.segments], "<f4"),
            "normals": _text(surface.normals, "<f4"),
            "parts_of_points": _text(surface.parts, "u1"),
            "faces": _text(surface.faces, "<u4"),
            "placed": _text(np.concatenate([placed[..., :3, 3], turns], axis=-1), "<f4"),
            "known": _text(np.array([known[k] for known in self._known]), "u1"),
        }


def _known(person: Person, estimate: Estimate) -> NDArray[np.uint8]:
    """(P,) what is known of each part."""
    state = _LOST if estimate.lost else _UNSURE if estimate.doubtful else _SURE
    known = np.full(len(person.body.parts), state, dtype=np.uint8)
    for group in () if estimate.lost else estimate.ambiguous:
        known[person.body.parts_of(group)] = _UNSURE
    return known


def _why(step: Step) -> str:
    """What is in doubt in a frame, with names where there are several persons."""
    pairs = zip(step.scene.persons, step.estimates, strict=True)
    told = {person.name: why for person, one in pairs if (why := in_words(one.reasons))}
    return " - ".join(told.values() if len(step.estimates) == 1 else (f"{name}: {why}" for name, why in told.items()))


def _camera(camera: Camera, window: Array) -> dict[str, Any]:
    """Where a camera stands, its image as a sheet at a metre, bent as its lens is, and where that lies in the video."""
    width, height = camera.size
    n = _SHEET if camera.distortion.any() else 2
    columns, rows = np.meshgrid(np.linspace(-0.5, width - 0.5, n), np.linspace(-0.5, height - 0.5, n))
    sheet = camera.undistort(np.stack([columns, rows], axis=-1), clamped=True).clip(-_WIDEST, _WIDEST)
    return {
        "name": camera.name,
        "world_from_camera": np.linalg.inv(camera.camera_from_world).round(6).tolist(),
        "sheet": sheet.round(5).tolist(),
        "window": [round(float(value), 6) for value in window],
    }


def _text(values: Array | Integers | NDArray[np.uint8], dtype: str) -> str:
    """An array's bytes, compressed, as text."""
    return base64.b64encode(gzip.compress(np.ascontiguousarray(values, dtype=dtype).tobytes(), mtime=0)).decode()
