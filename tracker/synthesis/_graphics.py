"""Common parts of graphics libraries: late loading, and contours and distances from pictures."""

from __future__ import annotations

import importlib
from typing import Any

import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import RenderError
from tracker.images.sight import Observation
from tracker.kernels.regions import Lines
from tracker.synthesis._pictures import Picture, contours_of, distances_of, misfits_of
from tracker.synthesis._skins import ids_of_skins
from tracker.synthesis.cpu import CpuSynthesis

SYSTEM_PACKAGES = "apt-get install -y --no-install-recommends libegl1 libgl1 libxrender1 libosmesa6"
NEWER_BINDING = 'pip install -U "PyOpenGL>=3.1.10"'


def library(name: str, use: str) -> Any:
    """An optional Python package.

    Args:
        name: the package.
        use: the component that needs it.

    Raises:
        RenderError: it is not installed, or it does not find the system libraries it needs.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        if error.name == package:
            raise RenderError(f'synthesis "{use}" needs the Python package {package}: pip install {package}') from error
        raise unusable(use, error) from error
    except Exception as error:
        raise unusable(use, error) from error


def unusable(use: str, error: Exception) -> RenderError:
    """Advice about an exception of a graphics library, in one sentence."""
    first = next(iter(str(error).strip().splitlines()), "")
    kind = "" if type(error) is Exception else f"{type(error).__name__} "
    reason = " ".join(f"{kind}{first}".split())
    if "OSMesaCreateContextAttribs" in str(error):
        return RenderError(f'synthesis "{use}" needs a newer PyOpenGL than pyrender asks for: {NEWER_BINDING}')
    return RenderError(f'synthesis "{use}" finds no OpenGL it can use ({reason}): {SYSTEM_PACKAGES}')


@component
class PictureSynthesis:
    """Results from pictures of part numbers; a component draws these (`_pictures`)."""

    contact_m: float = pydantic.Field(default=0.02, ge=0)
    """An edge whose outer side is this close to another part is an edge between parts, metres."""

    n_eta: int = pydantic.Field(default=17, ge=5)
    """Latitudes of the parts' meshes."""

    n_omega: int = pydantic.Field(default=32, ge=8)
    """Longitudes of the parts' meshes."""

    def contours(
        self, scene: Scene, person: int | None = None, poses: Array | None = None, coarse: bool = False
    ) -> Contours:
        """Visible occluding contours, a sample a pixel; see `tracker.synthesis.Synthesis.contours`."""
        if scene.has_skins and not coarse:
            return CpuSynthesis(contact_m=self.contact_m).contours(scene, person, poses)
        placements = scene.world_from_parts(person, poses)
        return contours_of(scene, placements, self._pictures(scene, placements), self.contact_m)

    def silhouettes(self, scene: Scene) -> tuple[Mask, ...]:
        """The region (H, W) that all persons cover, for each view."""
        return tuple(ids >= 0 for ids in self.part_ids(scene))

    def part_ids(self, scene: Scene) -> tuple[Integers, ...]:
        """Scene-wide part number (H, W) seen at each pixel's centre in every view, -1 for none."""
        if scene.has_skins:
            return ids_of_skins(scene)
        (pictures,) = self._pictures(scene, scene.world_from_parts())
        return tuple(picture.whole(camera) for picture, camera in zip(pictures, scene.rig.cameras, strict=True))

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        """Chamfer distances of the coarse contours; see `tracker.synthesis.Synthesis.directed_distances`."""
        return distances_of(self.contours(scene, person, poses, True), observation, theta, reject)

    def region_misfits(self, scene: Scene, person: int, poses: Array, lines: Lines) -> Array:
        """Misfits of colours; see `tracker.synthesis.Synthesis.region_misfits`."""
        placements = scene.world_from_parts(person, poses)
        return misfits_of(scene, placements, self.contours(scene, person, poses, True), lines)

    def _pictures(self, scene: Scene, placements: Array) -> list[list[Picture]]:
        """B times V pictures of parts placed at (B, P, 4, 4)."""
        raise NotImplementedError
