"""Synthesis on the CPU, and on a graphics card where there is one and it is faster."""

from __future__ import annotations

from functools import lru_cache

import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import RenderError
from tracker.images.sight import Observation
from tracker.kernels.descent import Tracing
from tracker.kernels.regions import Lines
from tracker.synthesis._atlas import atlas_on
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.egl import EglSynthesis

SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software")
"""Words in the names of renderers that only pretend to be a graphics card."""


@component
class AutoSynthesis:
    """`cpu`, and `egl` for the poses of a search if OpenGL runs on a real graphics card.

    Contours always come from the tracer: a card's are as fine as its pixels, and have to be read back. A software
    OpenGL is never taken: the tracer is a hundred times faster.
    """

    contact_m: float = pydantic.Field(default=0.02, ge=0)
    """An edge whose outer side is this close to another part is an edge between parts, metres."""

    device: int = pydantic.Field(default=0, ge=0)
    """Number of the EGL device to look at."""

    least_poses: int = pydantic.Field(default=32, ge=1)
    """Smallest batch of poses that is sent to the graphics card."""

    @property
    def choice(self) -> str:
        """The working component and the reason, in one sentence."""
        return _found(self.device)[1]

    @property
    def threads(self) -> bool:
        """Whether several threads may ask at once: not where a graphics card answers."""
        return not _found(self.device)[0]

    def contours(
        self, scene: Scene, person: int | None = None, poses: Array | None = None, coarse: bool = False
    ) -> Contours:
        """Visible occluding contours; see `tracker.synthesis.Synthesis.contours`."""
        return self._cpu.contours(scene, person, poses, coarse)

    def tracing(self, scene: Scene) -> Tracing | None:
        """What contours are traced by."""
        return self._cpu.tracing(scene)

    def silhouettes(self, scene: Scene) -> tuple[Mask, ...]:
        """The region covered; see `tracker.synthesis.Synthesis.silhouettes`."""
        return self._cpu.silhouettes(scene)

    def part_ids(self, scene: Scene) -> tuple[Integers, ...]:
        """The part seen at every pixel; see `tracker.synthesis.Synthesis.part_ids`."""
        return self._cpu.part_ids(scene)

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        """Directed chamfer distances; see `tracker.synthesis.Synthesis.directed_distances`."""
        if len(poses) < self.least_poses or not _found(self.device)[0]:
            return self._cpu.directed_distances(scene, person, poses, observation, theta, reject)
        egl = EglSynthesis(contact_m=self.contact_m, device=self.device)
        return egl.directed_distances(scene, person, poses, observation, theta, reject)

    def region_misfits(self, scene: Scene, person: int, poses: Array, lines: Lines) -> Array:
        """Misfits of colours; see `tracker.synthesis.Synthesis.region_misfits`."""
        return self._cpu.region_misfits(scene, person, poses, lines)

    @property
    def _cpu(self) -> CpuSynthesis:
        return CpuSynthesis(contact_m=self.contact_m)


@lru_cache
def _found(device: int) -> tuple[bool, str]:
    """Whether an EGL device is a graphics card, and what to say about it; looked up once."""
    try:
        renderer = atlas_on(device).renderer
    except RenderError as error:
        return False, f"cpu, because {error}"
    if any(word in renderer.lower() for word in SOFTWARE):
        return False, f"cpu, because OpenGL is software here ({renderer}), slower than the contour tracer"
    return True, f"egl, because there is a graphics card ({renderer})"


def look_again() -> None:
    """Forgets what was found."""
    _found.cache_clear()
