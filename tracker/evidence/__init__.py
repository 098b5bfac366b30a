"""Evidence: compares the images with a pose, and shows where to move the pose.

Each file is one kind of evidence, a component; `measures` has their common parts, `similarity` the distances of
contours. It imports `synthesis`, `images`, `bodies` and the rooms below, and `points` in the one evidence of that name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.configuration.tables import component_name
from tracker.images.sight import Sight
from tracker.kernels.descent import Kinds

Observed = Any
"""Observation of one kind of evidence in a frame: its own frozen value, which only that kind reads."""

Memory = Any
"""Knowledge of one kind of evidence from the frames so far: its own frozen value; None at the start."""

GUESSED: Memory = object()
"""Replaces a memory if the expected pose is one of several guesses: it must not teach its own confirmation."""


class EvidencePicture(NamedTuple):
    """Picture of one kind of evidence in a view of a frame."""

    title: str
    """Its title; or which evidence has no picture, and why."""

    picture: Image | None
    """(H, W, 3) BGR, as large as the view's image; None without a picture."""


@runtime_checkable
class Evidence(Protocol):
    """A component for one kind of evidence. Search and refinement know no kind by name.

    A pose has one number: `distances` and `account` agree. Components derive from this class and inherit the optional
    methods, `check`, `told`, `takes_part_plates`, `look`, `learned`, `observe_again`, `kinds` and `pictures`.
    """

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> Observed:
        """Observes a frame.

        Args:
            sight: the images, and the clean plates if there are some; missing views are None.
            expected: contours of the prediction (several poses if there are several candidates); None to search
                everywhere and accept everything.
            memory: knowledge up to the frame before; `GUESSED` if the expected pose is only a guess.

        Returns:
            Value of `asked.observed` in later questions.
        """
        ...

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """Distance of each pose (B, dof) from the observation: (B,) px, lower is better; a search ranks by it."""
        ...

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Equations of a refinement, linearized at a pose.

        Args:
            asked: person, scene and observation.
            q: (dof,) rad and m.
            gate_px: distance from the model up to which the images count, px.
        """
        ...

    def account(self, asked: Comparison, q: Array) -> Account:
        """Explanation of the observation by a pose (dof,); its distance is that of `distances`."""
        ...

    def observe_again(self, asked: Comparison, q: Array) -> Observed:
        """Observation if a person is known to be near a pose (dof,); by default the earlier one.

        It alternates segmentation and pose estimation: the last pose found is the prior of the next contour.
        """
        return asked.observed

    def kinds(self, asked: Comparison) -> Kinds | None:
        """Compiled form of its `equations`; by default None: a refinement calls `equations` in each step.

        Args:
            asked: person, scene and observation.
        """
        return None

    def check(self, scene: Scene) -> None:
        """Refuses unusable files of its own before the first frame; by default there are none.

        Raises:
            ConfigError: describes the fault.
        """
        return

    def takes_part_plates(self) -> bool:
        """Whether it uses plates that are unknown behind persons who stay; see `tracking.recorded_plates`."""
        return False

    def told(self, known: Sequence[object | None]) -> str:
        """One line about its choice, if that depends on the recording; by default empty.

        Args:
            known: for each view without persons a plate, or that there are masks; None for neither.
        """
        return ""

    def look(self, sight: Sight, around: Contours) -> None:
        """Computes in advance what needs no exact prediction, and leaves it in the sight; by default nothing.

        Args:
            sight: the frame to come.
            around: contours of all persons two frames before.
        """
        return

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """Knowledge after a frame; by default the earlier one.

        Args:
            memory: knowledge before the frame.
            sight: the frame.
            scene: all persons at their estimated poses.
            fitted: their contours.
            trusted: (V, P) parts of the scene that may teach in a view.
        """
        return memory

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """Its picture of a view of a frame; by default it says that there is none.

        Args:
            asked: the person at the pose found, and the observation.
            sight: the observed frame.
            view: number of a view that has an image.
        """
        return (EvidencePicture(f"{component_name(type(self))}: draws no picture", None),)
