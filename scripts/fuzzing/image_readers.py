"""Every reader of images, with files that it reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fuzzing import samples
from fuzzing.mutations import BINARY
from fuzzing.trial import Reader
from tracker.acquisition.pictures import Picture, read_silhouette
from tracker.cameras.rig_layouts import save_rig
from tracker.images.reading.images import ImageReading
from tracker.images.reading.stills import StillReading
from tracker.images.reading.video import VideoReading


def image_readers() -> list[Reader]:
    """All of them."""
    return [
        *(_stills(suffix) for suffix in (".png", ".jpg", ".tif", ".bmp", ".webp")),
        _video(),
        _numbered(),
        _silhouette(),
    ]


def _stills(suffix: str) -> Reader:
    def sample(folder: Path) -> None:
        save_rig(samples.sample_rig(), folder / "rig.toml")
        for view in samples.VIEWS:
            samples.write_picture(folder / f"{view}{suffix}")

    def read(folder: Path) -> object:
        opened = StillReading(
            path=str(folder / f"{{view}}{suffix}"),
            rig=folder / "rig.toml",
            background=str(folder / f"{{view}}{suffix}"),
        ).open()
        return list(opened.frames())

    return Reader(f"picture {suffix}", sample, read, BINARY, (f"left{suffix}",))


def _video() -> Reader:
    def sample(folder: Path) -> None:
        save_rig(samples.sample_rig(), folder / "rig.toml")
        for view in samples.VIEWS:
            samples.write_video(folder / f"{view}.mp4")

    def read(folder: Path) -> object:
        path = str(folder / "{view}.mp4")
        skipping = VideoReading(path=path, rig=folder / "rig.toml", on_missing="skip").open()
        seen = [frame.missing for frame in skipping.frames()]
        strict = VideoReading(path=path, rig=folder / "rig.toml", background=path).open()
        return seen, [frame.missing for frame in strict.frames()]

    return Reader("video", sample, read, BINARY, ("left.mp4",), share=1)


def _numbered() -> Reader:
    def sample(folder: Path) -> None:
        save_rig(samples.sample_rig(), folder / "rig.toml")
        for view in samples.VIEWS:
            for kind in ("images", "masks"):
                (folder / kind / view).mkdir(parents=True)
                for k in range(3):
                    samples.write_picture(folder / kind / view / f"{k:03d}.png", k)

    def read(folder: Path) -> object:
        opened = ImageReading(
            path=str(folder / "images" / "{view}" / "{frame}.png"),
            rig=folder / "rig.toml",
            fps=25.0,
            masks=str(folder / "masks" / "{view}" / "{frame}.png"),
        ).open()
        return [frame.masks for frame in opened.frames()]

    return Reader("masks", sample, read, BINARY, ("masks/left/001.png", "images/right/002.png"), share=1)


def _silhouette() -> Reader:
    def sample(folder: Path) -> None:
        import cv2

        mask = np.zeros((200, 100), dtype=np.uint8)
        cv2.ellipse(mask, (50, 100), (25, 80), 0, 0, 360, 255, -1)
        (folder / "mask.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())

    def read(folder: Path) -> object:
        return read_silhouette(Picture(mask=folder / "mask.png", px_per_m=100.0), "front", None)

    return Reader("silhouette", sample, read, BINARY, ("mask.png",), share=2)
