"""A small recording whose pictures tell their view and number, as videos and as images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.arrays import Image
from tracker.images.reading.images import ImageReading
from tracker.images.reading.video import VideoReading

Recording = VideoReading | ImageReading

WIDTH, HEIGHT, N_FRAMES, FPS = 64, 48, 20, 25

VIEWS = ("east", "north", "west")


def picture(view: int, number: int) -> Image:
    """The left half's grey tells the frame, the right half's the view; codecs change either by a level or two."""
    image = np.full((HEIGHT, WIDTH, 3), 10 + 10 * number, dtype=np.uint8)
    image[:, WIDTH // 2 :] = 40 + 60 * view
    return image


def seen(image: Image | None) -> tuple[int, int] | None:
    """View and frame that a picture shows."""
    if image is None:
        return None
    left, right = np.median(image[:, : image.shape[1] // 3]), np.median(image[:, -image.shape[1] // 3 :])
    return round((float(right) - 40) / 60), round((float(left) - 10) / 10)


def write_video(path: Path, pictures: list[Image], fps: int = FPS, gop: int = 12) -> None:
    """H.264 with its header at the front of the file."""
    options = {"movflags": "faststart"} if path.suffix == ".mp4" else {}
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.gop_size = gop
        for image in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())


def pictures_of(view: int, numbers: range = range(N_FRAMES)) -> list[Image]:
    return [picture(view, number) for number in numbers]


def write_images(folder: Path, view: int, numbers: range = range(N_FRAMES), first: int = 0) -> None:
    folder.mkdir(parents=True)
    for number in numbers:
        cv2.imwrite(str(folder / f"img_{number + first:04d}.png"), picture(view, number))


def record(root: Path) -> Path:
    """Three views as videos and as images, with clean plates and the rig."""
    cameras = []
    for v, name in enumerate(VIEWS):
        place = (4 * np.cos(v), 4 * np.sin(v), 1.5)
        cameras.append(Camera.looking_at(name, (WIDTH, HEIGHT), 60.0, place, np.array([0, 0, 1.0])))
        write_video(root / f"{name}.mp4", pictures_of(v))
        write_images(root / "images" / name, v)
        cv2.imwrite(str(root / f"plate_{name}.png"), picture(v, 0))
    save_rig(Rig(tuple(cameras)), root / "rig.toml")
    return root


def videos(folder: Path, **settings: Any) -> VideoReading:
    return VideoReading(path=str(folder / "{view}.mp4"), rig=folder / "rig.toml", **settings)


def images(folder: Path, **settings: Any) -> ImageReading:
    path = str(folder / "images" / "{view}" / "img_{frame}.png")
    return ImageReading(path=path, rig=folder / "rig.toml", fps=float(FPS), **settings)


KINDS: dict[str, Callable[..., Recording]] = {"videos": videos, "images": images}

both = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS.keys())


def shown(recording: Recording) -> list[tuple[tuple[int, int] | None, ...]]:
    """What the images of all frames show."""
    return [tuple(map(seen, frame.images)) for frame in recording.open().frames()]
