"""Overlay video: the recovered model in white over all views, as in the paper's figure 9."""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np
import pydantic
from av.container import OutputContainer
from av.video.stream import VideoStream

from tracker.components import component
from tracker.recording import RunContext
from tracker.recording._drawing import draw_step
from tracker.trajectory import Step

_FRAGMENT = 10
"""Frames that are written together."""


@component
class Overlay:
    """`overlay.mp4`, H.264, playable in browsers, also after a kill."""

    width_px: int = pydantic.Field(default=1280, ge=160)
    """Width of the video with all views, px."""

    quality: int = pydantic.Field(default=23, ge=0, le=51)
    """Constant rate factor: lower is better and larger."""

    stick_figure: bool = False
    """Also draw the bones."""

    def begin(self, run: RunContext) -> OverlayRecorder:
        """Opens the video."""
        return OverlayRecorder(run, self)


class OverlayRecorder:
    """The open video; its size is known with the first frame."""

    def __init__(self, run: RunContext, settings: Overlay) -> None:
        self._run, self._settings = run, settings
        # Fragments: what was written before a kill stays playable.
        fragmented = {"movflags": "frag_keyframe+empty_moov+default_base_moof", "flush_packets": "1"}
        self._container: OutputContainer = av.open(str(run.folder / "overlay.mp4"), "w", options=fragmented)
        self._stream: VideoStream | None = None

    def write(self, step: Step) -> None:
        """Adds one frame."""
        picture = draw_step(step, self._run.scene, self._settings.width_px, self._settings.stick_figure)
        if self._stream is None:
            self._stream = self._open_stream(picture.shape[1], picture.shape[0])
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="bgr24")
        self._container.mux(self._stream.encode(frame))

    def _open_stream(self, width: int, height: int) -> VideoStream:
        rate = Fraction(self._run.fps).limit_denominator(1001)
        # Without look-ahead every frame leaves the encoder at once, and a kill loses at most one fragment.
        options = {"crf": str(self._settings.quality), "preset": "veryfast", "tune": "zerolatency", "g": str(_FRAGMENT)}
        stream = self._container.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        return stream

    def finish(self) -> None:
        """Flushes the encoder and closes the file."""
        if self._stream is not None:
            self._container.mux(self._stream.encode(None))
        self._container.close()
