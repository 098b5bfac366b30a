"""Initialization: poses of all persons without a prediction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from tracker.analysis import Analysis
from tracker.arrays import Image
from tracker.estimation import Estimation
from tracker.frame import Frame
from tracker.scene import Scene
from tracker.similarity import Similarity
from tracker.start import Start
from tracker.synthesis import Synthesis


@dataclass(frozen=True)
class Stages:
    """The stages a search for a start pose may use, and the clean plates."""

    synthesis: Synthesis
    analysis: Analysis
    similarity: Similarity
    estimation: Estimation
    backgrounds: tuple[Image | None, ...]
    progress: Callable[[str], None] = lambda message: None
    """Told what the search is doing."""

    held: tuple[int, ...] = ()
    """Persons who are not looked for: their poses in the scene hold."""

    seen_before: bool = False
    """Whether the poses of the others are where they were seen last; else they do not matter."""


@runtime_checkable
class Initialization(Protocol):
    """A component that finds start poses."""

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """Poses of all persons in one frame.

        Args:
            frame: the images to start in.
            scene: the persons' bodies and the rig; which of the poses matter, the stages tell.
            stages: what the search may use.

        Raises:
            InitializationError: no pose could be found, with the reason.
        """
        ...
