"""The images of a finished run."""

from __future__ import annotations

import dataclasses
import json
import threading
from collections.abc import Iterable, Iterator
from collections.abc import Sequence as SequenceOf
from copy import deepcopy
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image
from tracker.foundation.configuration.tables import override_table
from tracker.foundation.errors import ConfigError, TrackerError
from tracker.images.reading import Sequence
from tracker.results.result import Result
from tracker.results.smoothed_result import FOLDER as SMOOTHED
from tracker.running.jobs import CONFIG, job_from, load_job

IN_STEP = "in_step"
"""Folder in a result: its poses at one moment, see `tracker.running.aligned_result`."""


def images_of(result: Result) -> Iterator[Frame]:
    """The frames of a result's recording, as bright and smooth as in tracking.

    Plates are neither needed nor made.

    Raises:
        TrackerError: the recording is gone.
    """
    return without_plates(reading_of(result, chosen_images(result))).frames()


def without_plates(reading: Any) -> Sequence:
    """A recording that is opened without plates.

    Raises:
        TrackerError: the recording does not exist.
    """
    # still pictures are never looked through for plates, nor do they have masks
    none = {"background": "none", "masks": None, "occluders": None, "align_background": False}
    opened: Sequence = dataclasses.replace(
        reading, **(none if hasattr(reading, "masks") else {"background": None})
    ).open()
    return opened


def single_frame(reading: Any, number: int) -> tuple[Sequence, Frame]:
    """The opened recording, and one frame of it.

    Raises:
        ConfigError: the recording has no such frame.
        TrackerError: the recording does not exist.
    """
    ends = {"start": number, "stop": number + 1}
    opened = without_plates(dataclasses.replace(reading, **{k: v for k, v in ends.items() if hasattr(reading, k)}))
    frame = next(opened.frames(), None)
    if frame is None or frame.index != number:
        raise ConfigError(f"frame {number}: the recording has none; it begins at {0 if frame is None else frame.index}")
    return opened, frame.unpacked()


def chosen_images(result: Result) -> list[str]:
    """The run's own choices for its images, as overrides of its configuration, which leaves them open."""
    chosen: Any = result.details.get("images", {})
    if not isinstance(chosen, dict):
        raise ConfigError(f"{result.folder / 'run.json'}: damaged: images = {chosen!r}, expected their settings")
    return [f"reading.{name}={_as_toml(value)}" for name, value in chosen.items()]


def _as_toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(key)} = {json.dumps(one)}" for key, one in value.items()) + " }"
    return json.dumps(value)


def reading_of(result: Result, overrides: SequenceOf[str] = ()) -> Any:
    """The reading of a result's recording; see `job_of`."""
    return job_of(result, overrides).reading


def job_of(result: Result, overrides: SequenceOf[str] = ()) -> Any:
    """The job of a result.

    Raises:
        ConfigError: its configuration is damaged or missing.
    """
    path, told = _config_of(result.folder), result.details.get("config")
    if path.is_file() or not isinstance(told, dict):
        return load_job("track", path, overrides)
    table = deepcopy(told)  # of poses changed after the run and written elsewhere
    override_table(table, overrides)
    return job_from("track", table, "run.json", result.folder, result.name)


def _config_of(folder: Path) -> Path:
    """The configuration beside a result; changed poses may have it in the folder of the raw ones."""
    folder = folder.resolve()
    while folder.name in (SMOOTHED, IN_STEP) and not (folder / CONFIG).is_file():
        folder = folder.parent
    return folder / CONFIG


_WIDTH_PX = 400
"""Width of a kept image: 12 KB."""

_MOST_FRAMES = 2000
"""Number of frames with kept images, 100 MB of four views; of longer recordings every second, third, ... frame."""

_QUALITY = 75
"""JPEG quality of a kept image."""


class Pictures:
    """The images so far, by frame; without lens distortion, the principal point in the middle."""

    def __init__(self, rig: Rig, n_frames: int, width_px: int = _WIDTH_PX) -> None:
        """Nothing is kept yet.

        Args:
            rig: the cameras.
            n_frames: largest number of frames; of very many, only some are kept.
            width_px: largest width of a kept image.
        """
        self._lenses = [_Lens(camera, width_px) for camera in rig.cameras]
        self._every = max(1, -(-n_frames // _MOST_FRAMES))
        self._kept: dict[int, tuple[NDArray[np.uint8] | None, ...]] = {}
        self._n_seen = 0
        self._stopped = threading.Event()
        self._reader: threading.Thread | None = None
        self.fault = ""
        """Why there are no more images; empty if there are."""

    def add(self, frame: Frame) -> None:
        """Keeps the images of a frame, unless there are too many frames."""
        self._n_seen += 1
        if (self._n_seen - 1) % self._every == 0:
            views = zip(self._lenses, frame.images, strict=True)
            self._kept[frame.index] = tuple(None if image is None else lens.kept(image) for lens, image in views)
        if len(self._kept) > _MOST_FRAMES:  # of cameras that film now nobody knows how many there will be
            self._kept = {index: self._kept[index] for index in sorted(self._kept)[::2]}
            self._every *= 2

    def read(self, frames: Iterable[Frame]) -> None:
        """Keeps the images of a recording, in its own thread, until `stop`."""

        def reading() -> None:
            try:
                for frame in frames:
                    if self._stopped.is_set():
                        return
                    self.add(frame)
            except TrackerError as error:
                self.fault = str(error)

        self._reader = threading.Thread(target=reading, daemon=True)
        self._reader.start()

    def stop(self) -> None:
        """Stops reading; waits for the present frame."""
        self._stopped.set()
        if self._reader is not None:
            # who still reads while Python ends finds its threads gone, and complains
            self._reader.join()

    @property
    def n_kept(self) -> int:
        """Frames whose images are there."""
        return len(self._kept)

    def of(self, index: int) -> tuple[Image | None, ...] | None:
        """The images (h, w, 3) BGR of a frame; None if they are missing (so far)."""
        kept = self._kept.get(index)
        return None if kept is None else tuple(None if one is None else _decoded(one) for one in kept)


class _Lens:
    """Maps that make a camera's images small and straight."""

    def __init__(self, camera: Camera, width_px: int) -> None:
        width, height = camera.size
        self.scale = min(1.0, width_px / width)
        self.size = max(1, round(width * self.scale)), max(1, round(height * self.scale))
        straight = np.diag([camera.matrix[0, 0], camera.matrix[1, 1], 1.0])
        straight[:2] *= self.scale
        straight[:2, 2] = (np.array(self.size) - 1) / 2
        self.maps = cv2.initUndistortRectifyMap(
            camera.matrix, camera.distortion, np.eye(3), straight, self.size, cv2.CV_16SC2
        )

    def kept(self, image: Image) -> NDArray[np.uint8]:
        """The straight image as JPEG."""
        blurred = cv2.blur(image, (round(1 / self.scale),) * 2) if self.scale <= 0.5 else image
        small = cv2.remap(blurred, *self.maps, cv2.INTER_LINEAR)
        _, content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        return np.asarray(content, dtype=np.uint8)


def _decoded(content: NDArray[np.uint8]) -> Image:
    image = cv2.imdecode(content, cv2.IMREAD_COLOR)
    return np.asarray(image, dtype=np.uint8)
