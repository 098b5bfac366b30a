"""Reference pictures by pyrender: an independent renderer to hold the others against, and shaded figures."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.geometry.superquadrics import meshes_of
from tracker.images.sight import Observation
from tracker.kernels.regions import Lines
from tracker.synthesis._pictures import Picture, before_cameras, contours_of, distances_of, misfits_of
from tracker.synthesis._pyrender import Drawing, drawn, shaded
from tracker.synthesis._skins import ids_of_skins
from tracker.synthesis.cpu import CpuSynthesis


@component
class OsmesaSynthesis:
    """Pictures of part numbers by pyrender; slow. Distorted views are looked up in enlarged undistorted pictures."""

    platform: Literal["osmesa", "egl"] = "osmesa"
    """How pyrender reaches OpenGL: in memory or through EGL. A process can use one of them only."""

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
        pictures = [self._pictures(scene, placed) for placed in placements]
        return contours_of(scene, placements, pictures, self.contact_m)

    def silhouettes(self, scene: Scene) -> tuple[Mask, ...]:
        """The region (H, W) that all persons cover, for each view."""
        return tuple(ids >= 0 for ids in self.part_ids(scene))

    def part_ids(self, scene: Scene) -> tuple[Integers, ...]:
        """Scene-wide part number (H, W) seen at each pixel's centre in every view, -1 for none."""
        if scene.has_skins:
            return ids_of_skins(scene)
        return tuple(picture.ids for picture in self._pictures(scene, scene.world_from_parts()[0]))

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        """Directed chamfer distances (B, V, 2) of poses (B, dof), px: model to scene, scene to model.

        Args:
            scene: persons, poses and rig.
            person: whose poses vary.
            poses: (B, dof) of that person, rad and m.
            observation: what the images show.
            theta: distance at which a point is an outlier, px.
            reject: reject outliers as the paper does, or else clamp them at theta.
        """
        return distances_of(self.contours(scene, person, poses, True), observation, theta, reject)

    def region_misfits(self, scene: Scene, person: int, poses: Array, lines: Lines) -> Array:
        """Misfits of colours; see `tracker.synthesis.Synthesis.region_misfits`."""
        return misfits_of(
            scene, scene.world_from_parts(person, poses), self.contours(scene, person, poses, True), lines
        )

    def picture(self, scene: Scene, view: int) -> Image:
        """A shaded picture (H, W, 3) RGB of the scene in a view, every part in a colour of its own, on white."""
        return shaded(self._drawing(scene, scene.world_from_parts()[0], view), self.platform)

    def _pictures(self, scene: Scene, placements: Array) -> list[Picture]:
        """V pictures of parts placed at (P, 4, 4)."""
        return [drawn(self._drawing(scene, placements, v), self.platform) for v in range(len(scene.rig))]

    def _drawing(self, scene: Scene, placements: Array, view: int) -> Drawing:
        meshes = meshes_of(scene.shapes, self.n_eta, self.n_omega)
        shown = before_cameras(scene, placements[None], meshes.widths)[0, view]
        return Drawing(meshes, placements, np.flatnonzero(shown), scene.rig.cameras[view])
