"""Synthesis: what the model looks like in every view.

A file is one way to draw it, a component; `simulation` makes whole recordings with exact truth.
It imports `images`, `bodies`, `cameras`, `kernels` and `foundation`, and knows nothing of evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.images.sight import Observation
from tracker.kernels.regions import Lines
from tracker.synthesis._pictures import distances_of, misfits_of

_One = TypeVar("_One")
_Made = TypeVar("_Made")


@runtime_checkable
class Synthesis(Protocol):
    """A component that projects a scene into all views.

    One that several threads may ask at once, for no graphics context belongs to one of them, has `threads = True`.
    """

    def contours(
        self, scene: Scene, person: int | None = None, poses: Array | None = None, coarse: bool = False
    ) -> Contours:
        """Visible occluding contours of all persons, with many poses of one person tried at once.

        Args:
            scene: persons, poses and rig.
            person: whose poses vary; None for the scene as it is.
            poses: (B, dof) of that person, rad and m.
            coarse: as dense as is enough to rank many poses, where that is cheaper, and always of the superquadrics;
                `directed_distances` are those of these contours. Others are of a person's own skin where it is known.

        Returns:
            Samples for B poses (1 for the scene as it is) and all views.
        """
        ...

    def silhouettes(self, scene: Scene) -> tuple[Mask, ...]:
        """The region (H, W) that all persons cover, for each view."""
        ...

    def part_ids(self, scene: Scene) -> tuple[Integers, ...]:
        """The scene-wide part (H, W) seen at each pixel's centre in every view, -1 where there is none."""
        ...

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        """Normalized directed chamfer distances (paper, eq. 2) of many poses of one person.

        The service that searches live on: no contour need be written to memory on the way. It is a faster way to what
        `tracker.kernels.contours.directed_distances` says of the coarse contours.

        Args:
            scene: persons, poses and rig.
            person: whose poses vary.
            poses: (B, dof) of that person, rad and m.
            observation: what the images show.
            theta: distance at which a point is an outlier, px.
            reject: reject outliers as the paper does, or else clamp them at theta.

        Returns:
            (B, V, 2) px: model to scene, scene to model; NaN for a missing view.
        """
        ...

    def region_misfits(self, scene: Scene, person: int, poses: Array, lines: Lines) -> Array:
        """Share beside the contours of many poses of one person that has the colours of the other side.

        As for `directed_distances`, no contour need be written to memory on the way. It is a faster way to what
        `tracker.kernels.regions.score_lines` says of the coarse contours.

        Args:
            scene: persons, poses and rig.
            person: whose poses vary.
            poses: (B, dof) of that person, rad and m.
            lines: the colours seen and known.

        Returns:
            (B, V, P, 3) for each part of the scene: contour compared, px; times how much of a line across it lies on
            the wrong side, px; contour whose lines show the part inside and not outside, px.
        """
        ...


def side_by_side(synthesis: Synthesis, do: Callable[[_One], _Made], of: Sequence[_One]) -> list[_Made]:
    """What is made of each, in threads if the synthesis can be asked by several, for kernels hold no lock.

    Args:
        synthesis: what the work asks.
        do: changes nothing that it sees of the others, so that the results are those of a loop.
        of: what it is done with.
    """
    if not getattr(synthesis, "threads", False) or len(of) < 2:
        return [do(one) for one in of]
    pool = ThreadPoolExecutor(len(of))
    try:
        made = list(pool.map(do, of))
    except BaseException as error:
        # A user who interrupts does not wait for running work: a start searched in full went on after two Ctrl-C.
        pool.shutdown(wait=isinstance(error, Exception), cancel_futures=True)
        raise
    pool.shutdown()
    return made


@dataclass(frozen=True)
class SurfaceSynthesis:
    """Distances of the contours that a refinement moves: of the skin where there is one.

    Parts fitted to a scan lie 10 mm RMS beside its contours, 17 at the chest: enough for an arm before the trunk to
    explain the images better in a wrong place than in the right one. A pose takes 2 ms, ten times that of the parts.
    """

    of: Synthesis
    """Functions for a search."""

    def contours(
        self, scene: Scene, person: int | None = None, poses: Array | None = None, coarse: bool = False
    ) -> Contours:
        """Visible occluding contours; see `tracker.synthesis.Synthesis.contours`."""
        return self.of.contours(scene, person, poses, coarse)

    def silhouettes(self, scene: Scene) -> tuple[Mask, ...]:
        """The region each view's persons cover; see `tracker.synthesis.Synthesis.silhouettes`."""
        return self.of.silhouettes(scene)

    def part_ids(self, scene: Scene) -> tuple[Integers, ...]:
        """The part seen at every pixel; see `tracker.synthesis.Synthesis.part_ids`."""
        return self.of.part_ids(scene)

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        """Chamfer distances of the surface; see `tracker.synthesis.Synthesis.directed_distances`."""
        return distances_of(self.of.contours(scene, person, poses), observation, theta, reject)

    def region_misfits(self, scene: Scene, person: int, poses: Array, lines: Lines) -> Array:
        """Misfits of colours beside the surface; see `tracker.synthesis.Synthesis.region_misfits`."""
        placements = scene.world_from_parts(person, poses)
        return misfits_of(scene, placements, self.of.contours(scene, person, poses), lines)
