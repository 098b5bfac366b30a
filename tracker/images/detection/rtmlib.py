"""RTMPose by rtmlib: any number of persons an image, 26 keypoints; rtmlib downloads the weights on first use.

T. Jiang et al., RTMPose: Real-time multi-person pose estimation based on MMPose, arXiv 2303.07399, 2023.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.foundation.arrays import Array, Image
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError
from tracker.images.detection import Finder, library, version_of

_PACKAGE = "rtmlib onnxruntime"


@component
class RtmlibDetection:
    """RTMPose with feet, of the package rtmlib, as Pose2Sim uses it: all persons in the image."""

    layout: ClassVar[str] = "halpe_26"

    mode: Literal["lightweight", "balanced", "performance"] = "balanced"
    """Size of the network, in rtmlib's words."""

    device: Literal["cpu", "cuda", "mps"] = "cpu"
    """Device that computes."""

    def open(self) -> Finder:
        """Loads the networks, of persons and of their keypoints; see `tracker.images.detection.Detection.open`."""
        package = library("rtmlib", _PACKAGE)
        try:
            body = package.BodyWithFeet(mode=self.mode, backend="onnxruntime", device=self.device)
        except (OSError, RuntimeError, ImportError) as error:
            told = " ".join(str(error).split())[:200]
            raise ConfigError(
                f'detector "rtmlib" cannot load its networks ({told}): the first time it downloads them, and needs '
                "the network of this machine and the Python package onnxruntime"
            ) from error

        def find(image: Image) -> Array:
            boxes = body.det_model(image)
            if not len(boxes):  # without boxes it takes the whole image for a person
                return np.zeros((0, len(LAYOUTS["halpe_26"]), 3))
            places, scores = body.pose_model(image, bboxes=boxes)
            return np.concatenate([places, np.clip(scores, 0.0, 1.0)[..., None]], axis=-1).astype(np.float64)

        return find

    def about(self) -> str:
        """Name of the network; see `tracker.images.detection.Detection.about`."""
        return f"rtmlib {version_of('rtmlib')}, BodyWithFeet {self.mode}"
