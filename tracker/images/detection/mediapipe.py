"""MediaPipe's BlazePose: one person an image, 33 keypoints; its wheel holds the weights, so nothing is downloaded.

V. Bazarevsky et al., BlazePose: On-device real-time body pose tracking, CVPR workshop 2020.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import cv2
import numpy as np
import pydantic

from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.foundation.arrays import Array, Image
from tracker.foundation.configuration.components import component
from tracker.images.detection import Finder, library, version_of

_PACKAGE = "mediapipe==0.10.21"
"""The last version whose wheel has the network beside the program; later ones download it."""


@component
class MediaPipeDetection:
    """BlazePose of the package mediapipe: one person an image, the most conspicuous one."""

    layout: ClassVar[str] = "blazepose_33"

    network: Literal["full", "heavy"] = "full"
    """`full` is in the package. `heavy` is three times as slow, and the package downloads it on first use."""

    least_confidence: float = pydantic.Field(default=0.5, gt=0, le=1)
    """Least certainty of a person, a share of 1."""

    def open(self) -> Finder:
        """Loads the network; see `tracker.images.detection.Detection.open`."""
        pose = library("mediapipe", _PACKAGE).solutions.pose.Pose(
            static_image_mode=True,  # it would else look where it has found somebody in the image before
            model_complexity={"full": 1, "heavy": 2}[self.network],
            min_detection_confidence=self.least_confidence,
        )

        def find(image: Image) -> Array:
            return _persons(pose.process(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)), (image.shape[1], image.shape[0]))

        return find

    def about(self) -> str:
        """Name of the network; see `tracker.images.detection.Detection.about`."""
        return f"mediapipe {version_of('mediapipe')}, BlazePose {self.network}, from {self.least_confidence:g}"


def _persons(found: Any, size: tuple[int, int]) -> Array:
    """(N, 33, 3) from the package's result, whose positions are shares of width and height, from edge to edge."""
    if found.pose_landmarks is None:
        return np.zeros((0, len(LAYOUTS["blazepose_33"]), 3))
    marks = np.array([(mark.x, mark.y, mark.visibility) for mark in found.pose_landmarks.landmark])
    marks[:, :2] = marks[:, :2] * size - 0.5
    marks[:, 2] = np.clip(marks[:, 2], 0.0, 1.0)
    return marks[None]
