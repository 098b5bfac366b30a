"""The keypoints of all views of a rig, in pixels of the images that are tracked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from tracker.arrays import Array
from tracker.camera import Camera
from tracker.errors import SequenceError
from tracker.files import Stamp, stamp_of
from tracker.frame import Frame
from tracker.keypoint_layouts import KeypointSource, open_keypoints
from tracker.rig import Rig

_MOST_OUTSIDE = 0.3
"""Share of a view's keypoints that may lie outside of its image; detectors guess feet below the edge."""


@dataclass(frozen=True)
class KeypointViews:
    """One source a view, all of the same keypoints."""

    views: tuple[str, ...]
    names: tuple[str, ...]
    sources: tuple[KeypointSource, ...]

    @staticmethod
    def open(pattern: str, views: tuple[str, ...], names: tuple[str, ...] = ()) -> KeypointViews:
        """Opens the files of all views, once as long as they stay as they are.

        Args:
            pattern: path with `{view}`.
            views: names of the cameras.
            names: of the keypoints in files without names.

        Raises:
            SequenceError: a file is missing, or two have other keypoints.
        """
        if "{view}" not in pattern and len(views) > 1:
            raise SequenceError(f'path = "{pattern}": no {{view}} in it, expected e.g. keypoints/{{view}}_json')
        paths = tuple(Path(pattern.replace("{view}", view)) for view in views)
        return _opened(paths, views, names, tuple(map(stamp_of, paths)))

    def at(self, frame: Frame, rig: Rig, downscale: int | None = None, least_confidence: float = 0.0) -> list[Array]:
        """What was found in the images of one frame.

        Args:
            frame: tells which images of the views they are; files that are named are numbered as the images are,
                tables from 0 on.
            rig: the cameras of the images tracked.
            downscale: how much larger the images were that the detector saw; None: as they were recorded.
            least_confidence: keypoints of less are left out.

        Returns:
            For each view (N, K, 3) pixel and confidence of N persons; NaN for keypoints that were not found.

        Raises:
            SequenceError: most keypoints of a view lie outside of its image.
        """
        found = []
        for v, (source, camera) in enumerate(zip(self.sources, rig.cameras, strict=True)):
            number = frame.position(v) + (frame.first_number if source.named else 0)
            persons = source.at(number).found.copy()
            # pixel centres lie at integer coordinates
            persons[..., :2] = (persons[..., :2] + 0.5) / (downscale or camera.downscale) - 0.5
            persons[persons[..., 2] < least_confidence] = np.nan
            _check_size(persons[..., :2], camera, frame.index)
            found.append(persons)
        return found


def _check_size(pixels: Array, camera: Camera, frame: int) -> None:
    """Keypoints (N, K, 2) most of which lie outside of the image were found in a larger one."""
    width, height = camera.size
    outside = (pixels < -0.5).any(axis=-1) | (pixels > np.array(camera.size) - 0.5).any(axis=-1)
    if outside.sum() > _MOST_OUTSIDE * max(np.isfinite(pixels[..., 0]).sum(), 1):
        x, y = np.nanmax(pixels, axis=(0, 1))
        raise SequenceError(
            f'view "{camera.name}", frame {frame}: keypoints lie as far as ({x:.0f}, {y:.0f}) px, the image has '
            f"{width}x{height} px; expected pixels of the images as recorded: for those of larger ones set downscale"
        )


@lru_cache(maxsize=8)
def _opened(
    paths: tuple[Path, ...], views: tuple[str, ...], names: tuple[str, ...], _: tuple[Stamp, ...]
) -> KeypointViews:
    sources = tuple(open_keypoints(path, names) for path in paths)
    for view, source in zip(views, sources, strict=True):
        if source.names != sources[0].names:
            raise SequenceError(
                f'view "{view}" has {len(source.names)} keypoints ({", ".join(source.names[:3])}, ...), '
                f'view "{views[0]}" has {len(sources[0].names)} ({", ".join(sources[0].names[:3])}, ...): '
                "expected the same ones"
            )
    return KeypointViews(views, sources[0].names, sources)
