"""A small video of all views with the model's contours, kept in memory."""

from __future__ import annotations

import io

import av
import cv2
import numpy as np
from av.container import OutputContainer
from av.video.stream import VideoStream

from tracker.bodies.contours import ViewContours
from tracker.foundation.arrays import Array, Image, Mask
from tracker.results.recording import RunContext
from tracker.results.recording._drawing import doubted_parts
from tracker.tracking.trajectory import Step

FPS = 25
"""Of the video: one of its frames is one of the player's, whatever their real times are."""

_QUALITY = 32
"""Constant rate factor: contours stay sharp at 640 px."""

_FRAME_BYTES = 700
"""Most that a frame takes on average over two seconds: 1000 frames are 0.9 MB of text in the page."""

_BETWEEN_KEYS = 12
"""Frames from one key frame to the next: what jumping to a frame decodes at the most."""

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
        frame = av.VideoFrame.from_ndarray(self.drawn(step), format="bgr24")
        self._container.mux(self._stream.encode(frame))

    def drawn(self, step: Step) -> Image:
        """All views side by side: what was doubted is orange, a missing image is grey."""
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
    """Where each view lies in a picture of all: upright ones in a row, others in two columns.

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
