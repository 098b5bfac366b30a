"""Synthesis on a graphics card: one picture of many poses in all views, scored where it is drawn."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.geometry.superquadrics import Meshes, meshes_of
from tracker.images.sight import Observation
from tracker.kernels.rows import RegionRow
from tracker.synthesis._atlas import Atlas, Batch, atlas_on, batches
from tracker.synthesis._graphics import PictureSynthesis
from tracker.synthesis._pictures import Picture, before_cameras


@component
class EglSynthesis(PictureSynthesis):
    """Pictures of part numbers by OpenGL 4.3 through EGL; needs no display. Works without a graphics card, slowly."""

    device: int = pydantic.Field(default=0, ge=0)
    """Number of the EGL device."""

    atlas_px: int = pydantic.Field(default=4096, ge=256)
    """Largest width and height of the picture that poses are drawn into, px; more poses take several pictures."""

    @property
    def renderer(self) -> str:
        """What draws, in the driver's words."""
        return atlas_on(self.device).renderer

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        """Chamfer distances of poses drawn and scored on the graphics card; with `reject`, scored on the CPU.

        See `tracker.synthesis.Synthesis.directed_distances`.
        """
        if reject:
            return super().directed_distances(scene, person, poses, observation, theta, reject)
        atlas, placements = atlas_on(self.device), scene.world_from_parts(person, poses)
        present = observation.packed.regions[:, RegionRow.WIDTH] > 0
        distances = np.full((len(placements), len(present), 2), np.nan)
        against = observation, theta, self.contact_m
        for meshes, batch in self._batches(atlas, scene, placements, present):
            found = atlas.scores(scene, placements[batch.poses], meshes, batch, against)
            distances[batch.poses] = np.where(present[:, None], found, np.nan)
        return distances

    def _pictures(self, scene: Scene, placements: Array) -> list[list[Picture]]:
        atlas, pictures = atlas_on(self.device), []
        present = np.ones(len(scene.rig), dtype=np.bool_)
        # each alone: rasterizers round by the place in the picture, and a pose is to look the same in any company
        for one in placements[:, None]:
            for meshes, batch in self._batches(atlas, scene, one, present):
                pictures += atlas.pictures(scene, one, meshes, batch)
        return pictures

    def _batches(self, atlas: Atlas, scene: Scene, placements: Array, present: Mask) -> Iterator[tuple[Meshes, Batch]]:
        """What to draw of parts placed at (B, P, 4, 4) in the views present (V,)."""
        meshes = meshes_of(scene.shapes, self.n_eta, self.n_omega)
        shown = before_cameras(scene, placements, meshes.widths) & present[:, None]
        for batch in batches(scene, placements, meshes, shown, min(self.atlas_px, atlas.side)):
            yield meshes, batch
