"""Evidence: what the images say, how well a pose explains it, and where to move next.

A file is one kind of evidence, a component; `measures` has what they share, `similarity` the distances of contours.
It imports `synthesis`, `images`, `bodies` and what lies below, and `points` in the one evidence of that name.
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
"""What one kind of evidence has observed in a frame: its own frozen value, which only it looks into."""

Memory = Any
"""What one kind of evidence has learned from the frames so far: its own frozen value; None at the start."""

GUESSED: Memory = object()
"""In place of a memory where the pose expected is one of several guesses: it must not teach what would confirm it."""


class EvidencePicture(NamedTuple):
    """What one kind of evidence saw in a view of a frame, drawn by itself."""

    title: str
    """What is shown; or which evidence has no picture, and why."""

    picture: Image | None
    """(H, W, 3) BGR, as large as the view's image; None where there is nothing to draw."""


@runtime_checkable
class Evidence(Protocol):
    """A component that answers for one kind of evidence. Search and refinement know none of them by name.

    One pose has one number: what `distances` ranks by is what `account` reports. Components derive from this class
    and inherit the optional methods, `check`, `told`, `takes_part_plates`, `look`, `learned`, `observe_again`, `kinds`
    and `pictures`.
    """

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> Observed:
        """Looks at a frame.

        Args:
            sight: the images, and the clean plates where there are some; missing views are None.
            expected: contours of the prediction (several poses where there are several candidates); None to look
                everywhere and accept everything.
            memory: what was learned up to the frame before; `GUESSED` where the pose expected is but a guess.

        Returns:
            What `asked.observed` is in the questions that follow.
        """
        ...

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """How far each pose (B, dof) is from what was observed: (B,) px, lower is better; what a search ranks by."""
        ...

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """What a refinement minimizes, linearized at a pose.

        Args:
            asked: person, scene and what was observed.
            q: (dof,) rad and m.
            gate_px: how far from the model the images are believed, px.
        """
        ...

    def account(self, asked: Comparison, q: Array) -> Account:
        """How well a pose (dof,) explains what was observed; its distance is the one that `distances` gives."""
        ...

    def observe_again(self, asked: Comparison, q: Array) -> Observed:
        """What is observed if a person is known to be about a pose (dof,); by default what was observed before.

        Segmentation and pose estimation are alternated by it: a contour found with the pose last found as its prior.
        """
        return asked.observed

    def kinds(self, asked: Comparison) -> Kinds | None:
        """What a compiled refinement computes of its `equations` by itself; by default None: it is asked in each step.

        Args:
            asked: person, scene and what was observed.
        """
        return None

    def check(self, scene: Scene) -> None:
        """Refuses files of its own that cannot be used, before the first frame; by default there are none.

        Raises:
            ConfigError: what is wrong with them.
        """
        return

    def takes_part_plates(self) -> bool:
        """Whether it uses plates that are unknown behind persons who stay; see `tracking.recorded_plates`."""
        return False

    def told(self, known: Sequence[object | None]) -> str:
        """In one line what it goes by, if that depends on the recording; by default nothing.

        Args:
            known: what is known of each view without persons, a plate or that there are masks; None for neither.
        """
        return ""

    def look(self, sight: Sight, around: Contours) -> None:
        """Does ahead what needs no exact prediction, and leaves it in the sight; by default nothing.

        Args:
            sight: the frame to come.
            around: contours of all persons two frames before.
        """
        return

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """What is known after a frame; by default what was known before it.

        Args:
            memory: what was known before the frame.
            sight: the frame.
            scene: all persons at their estimated poses.
            fitted: their contours.
            trusted: (V, P) parts of the scene that can be learned from in a view.
        """
        return memory

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """What it saw in a view of a frame, to be looked at; by default it says that it draws nothing.

        Args:
            asked: the person at the pose found, and what was observed.
            sight: the frame that was observed.
            view: number of a view that has an image.
        """
        return (EvidencePicture(f"{component_name(type(self))}: draws no picture", None),)
