"""Overlay video: the recovered model in white over all views, as in the paper's figure 9."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import av
import pydantic
from av.container import OutputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from tracker.foundation.configuration.components import component
from tracker.foundation.files import Successor
from tracker.results.recording import RunContext
from tracker.results.recording._drawing import draw_step, film_frame
from tracker.tracking.trajectory import Step

_FRAGMENT = 10
"""Number of frames written together."""

_TICKS = 90_000
"""Time stamps a second: the clock of MPEG, in which every common frame rate is a whole number."""

_LEAST_TICKS = 4
"""Least time between two frames: the fastest cameras have more frames a second than that clock has stamps."""


@component
class Overlay:
    """`overlay.mp4`, H.264, playable in browsers, also after a kill."""

    width_px: int = pydantic.Field(default=960, ge=160)
    """Width of the video with all views, px."""

    quality: int = pydantic.Field(default=23, ge=0, le=51)
    """Constant rate factor: lower is better and larger."""

    stick_figure: bool = False
    """Also draw the bones."""

    def begin(self, run: RunContext) -> OverlayRecorder:
        """Opens the video."""
        return OverlayRecorder(run, self)


class OverlayRecorder:
    """The open video; the first frame sets its size and the time of its start."""

    def __init__(self, run: RunContext, settings: Overlay) -> None:
        self._run, self._settings = run, settings
        self._file = Successor(run.folder / "overlay.mp4", waits=bool(run.resumed))
        self._container: OutputContainer | None = None
        self._stream: VideoStream | None = None
        self._start_s = 0.0
        self._ticks = _TICKS * max(1, math.ceil(_LEAST_TICKS / (run.interval_s * _TICKS)))

    def write(self, step: Step) -> None:
        """Adds one frame at its own time."""
        picture = draw_step(step, self._run.scene, self._settings.width_px, self._settings.stick_figure)
        if self._container is None or self._stream is None:
            # Fragments: frames written before a kill stay playable.
            fragmented = {"movflags": "frag_keyframe+empty_moov+default_base_moof", "flush_packets": "1"}
            self._container = av.open(str(self._file.path), "w", options=fragmented)
            self._stream = self._open_stream(self._container, picture.shape[1], picture.shape[0])
            self._start_s = step.frame.time_s
        frame = film_frame(picture)
        frame.time_base = Fraction(1, self._ticks)
        frame.pts = round((step.frame.time_s - self._start_s) * self._ticks)
        self._mux(self._container, self._stream.encode(frame))
        if step.frame.index not in self._run.resumed:
            self._file.take_place()

    def _open_stream(self, container: OutputContainer, width: int, height: int) -> VideoStream:
        rate = Fraction(1 / self._run.interval_s).limit_denominator(1001)
        # Without look-ahead every frame leaves the encoder at once, and a kill loses at most one fragment.
        options = {
            "crf": str(self._settings.quality),
            "preset": "ultrafast",
            "tune": "zerolatency",
            "g": str(_FRAGMENT),
        }
        stream = container.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, self._ticks)
        return stream

    def _mux(self, container: OutputContainer, packets: list[Packet[VideoStream]]) -> None:
        for packet in packets:
            # A frame is shown until the next one; of the last one, and of the last before a kill, this is all there is.
            packet.duration = round(self._run.interval_s * self._ticks)
            container.mux(packet)

    def finish(self) -> tuple[Path, ...]:
        """Flushes the encoder and closes the file."""
        if self._container is None or self._stream is None:
            return ()
        self._mux(self._container, self._stream.encode(None))
        self._container.close()
        return (self._file.take_place(),)
