"""Data of the report's player: the bodies, their movements, the cameras and a video, as text for the page."""

from __future__ import annotations

import base64
import gzip
import io
import json
from importlib.resources import files
from typing import Any

import av
import cv2
import numpy as np
from av.container import OutputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tracker.bodies.body.surface import surface_of
from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Person
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.results.recording import RunContext
from tracker.results.recording._drawing import doubted_parts, film_frame
from tracker.results.recording._motion import Motion, Motions
from tracker.tracking.doubt import in_words
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step

FPS = 25
"""Frame rate of the video: one of its frames is one of the player's, at any real time."""

_QUALITY = 32
"""Constant rate factor: contours stay sharp at 640 px."""

_FRAME_BYTES = 700
"""Largest mean size of a frame over two seconds: 1000 frames are 0.9 MB of text in the page."""

_BETWEEN_KEYS = 12
"""Frames between two key frames: jumping to a frame decodes at most these."""

# BGR, and binary digits after the point in OpenCV's drawing.
_WHITE, _ORANGE, _SUBPIXEL = (255, 255, 255), (40, 140, 255), 3


class Preview:
    """The video so far."""

    def __init__(self, run: RunContext, width_px: int = 640) -> None:
        cameras = run.scene.rig.cameras
        self.names = run.scene.rig.names
        self.windows, self.size = windows_of([camera.size for camera in cameras], width_px)
        self._scales = [
            (window[2] - window[0]) * self.size[0] / camera.size[0]
            for window, camera in zip(self.windows, cameras, strict=True)
        ]
        self._buffer = io.BytesIO()
        self._container: OutputContainer | None = None
        self._stream: VideoStream | None = None

    def add(self, step: Step) -> None:
        """Adds one frame."""
        if self._container is None or self._stream is None:
            self._container = av.open(self._buffer, "w", format="mp4")
            bits = 8 * _FRAME_BYTES * FPS
            options = {"crf": str(_QUALITY), "maxrate": str(bits), "bufsize": str(2 * bits), "preset": "superfast"}
            self._stream = self._container.add_stream(
                "libx264", rate=FPS, options={**options, "g": str(_BETWEEN_KEYS), "bf": "0"}
            )
            self._stream.width, self._stream.height = self.size
            self._stream.pix_fmt = "yuv420p"
        self._container.mux(self._stream.encode(film_frame(self.drawn(step))))

    def drawn(self, step: Step) -> Image:
        """All views side by side: doubtful parts are orange, a missing image is grey."""
        width, height = self.size
        picture = np.zeros((height, width, 3), dtype=np.uint8)
        doubted = doubted_parts(step)
        corners = np.round(self.windows * [width, height, width, height]).astype(int)
        for v, (left, top, right, bottom) in enumerate(corners.tolist()):
            window, image = picture[top:bottom, left:right], step.frame.images[v]
            if image is None:
                window[:] = 60
            else:
                # averaging areas takes eight times as long, 5 ms a frame of four views
                cv2.resize(image, (right - left, bottom - top), dst=window, interpolation=cv2.INTER_LINEAR)
            contours = step.fitted.of(v)
            _draw(window, contours, self._scales[v], doubted[contours.parts])
        return picture

    def finish(self) -> bytes:
        """Closes the video; nothing without a frame."""
        if self._container is None or self._stream is None:
            return b""
        self._container.mux(self._stream.encode(None))
        self._container.close()
        return self._buffer.getvalue()


def windows_of(sizes: list[tuple[int, int]], width_px: int) -> tuple[Array, tuple[int, int]]:
    """Place of each view in a picture of all: upright ones in a row, others in two columns.

    Args:
        sizes: width and height of the views, px.
        width_px: of the picture.

    Returns:
        (V, 4) left, top, right and bottom as shares of the picture; its even width and height, px.
    """
    upright = sizes[0][1] > sizes[0][0]
    n_columns = len(sizes) if upright or len(sizes) == 1 else 2
    width = width_px // n_columns
    height = max(round(h * width / w) for w, h in sizes)
    whole = width * n_columns // 2 * 2, height * -(-len(sizes) // n_columns) // 2 * 2
    windows = []
    for v, (w, h) in enumerate(sizes):
        scale = min(width / w, height / h)
        left, top = width * (v % n_columns), height * (v // n_columns)
        right, bottom = min(left + round(w * scale), whole[0]), min(top + round(h * scale), whole[1])
        windows.append([left / whole[0], top / whole[1], right / whole[0], bottom / whole[1]])
    return np.array(windows), whole


def _draw(picture: Image, contours: ViewContours, scale: float, unsure: Mask) -> None:
    """The contours' samples as short lines, at a picture's scale."""
    along = np.stack([-contours.normals[:, 1], contours.normals[:, 0]], axis=1)
    half = contours.weights[:, None] / 2
    ends = np.stack([contours.pixels - half * along, contours.pixels + half * along], axis=1)
    lines = np.round(((ends + 0.5) * scale - 0.5) * 2**_SUBPIXEL).astype(np.int32)
    for shade, chosen in ((_WHITE, ~unsure & ~contours.between), (_ORANGE, unsure & ~contours.between)):
        cv2.polylines(picture, list(lines[chosen]), False, shade, 1, cv2.LINE_AA, _SUBPIXEL)


_SHEET, _WIDEST = 17, 4.0
"""Points along each side of the picture of a bent view; angle from the axis beyond which no picture is drawn."""

_N_ETA, _N_OMEGA = 9, 12
"""Latitudes and longitudes of a part's mesh: 100 kB a body."""

_SURE, _UNSURE, _LOST = 0, 1, 2
"""State of a part in a frame, as player.js colours it."""


class Player:
    """The frames so far; beyond `most_frames` every second, third, ... frame."""

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
        """Mesh, placements of the segments and states of the parts of a person."""
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
    """(P,) state of each part."""
    state = _LOST if estimate.lost else _UNSURE if estimate.doubtful else _SURE
    known = np.full(len(person.body.parts), state, dtype=np.uint8)
    for group in () if estimate.lost else estimate.ambiguous:
        known[person.body.parts_of(group)] = _UNSURE
    return known


def _why(step: Step) -> str:
    """The doubts in a frame, with names if there are several persons."""
    pairs = zip(step.scene.persons, step.estimates, strict=True)
    told = {person.name: why for person, one in pairs if (why := in_words(one.reasons))}
    return " - ".join(told.values() if len(step.estimates) == 1 else (f"{name}: {why}" for name, why in told.items()))


def _camera(camera: Camera, window: Array) -> dict[str, Any]:
    """Position of a camera, its image as a sheet at a metre, bent as its lens is, and its place in the video."""
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
