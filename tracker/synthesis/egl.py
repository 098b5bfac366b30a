"""Synthesis on a graphics card: one picture of many poses in all views, scored where it is drawn."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.geometry.superquadrics import Meshes, meshes_of
from tracker.images.sight import Observation
from tracker.kernels.regions import Lines
from tracker.kernels.rows import RegionRow
from tracker.synthesis._atlas import Atlas, Batch, atlas_on, batches
from tracker.synthesis._pictures import Picture, before_cameras, contours_of, distances_of, misfits_of
from tracker.synthesis._skins import ids_of_skins
from tracker.synthesis.cpu import CpuSynthesis


@component
class EglSynthesis:
    """Pictures of part numbers by OpenGL 4.3 through EGL; needs no display. Works without a graphics card, slowly."""

    contact_m: float = pydantic.Field(default=0.02, ge=0)
    """An edge whose outer side is this close to another part is an edge between parts, metres."""

    n_eta: int = pydantic.Field(default=17, ge=5)
    """Latitudes of the parts' meshes."""

    n_omega: int = pydantic.Field(default=32, ge=8)
    """Longitudes of the parts' meshes."""

    device: int = pydantic.Field(default=0, ge=0)
    """Number of the EGL device."""

    atlas_px: int = pydantic.Field(default=4096, ge=256)
    """Largest width and height of the picture that poses are drawn into, px; more poses take several pictures."""

    @property
    def renderer(self) -> str:
        """What draws, in the driver's words."""
        return atlas_on(self.device).renderer

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
        pictures = self._pictures(scene, scene.world_from_parts())[0]
        return tuple(picture.whole(camera) for picture, camera in zip(pictures, scene.rig.cameras, strict=True))

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        """Directed chamfer distances of poses, drawn and scored on the graphics card.

        Args:
            scene: persons, poses and rig.
            person: whose poses vary.
            poses: (B, dof) of that person, rad and m.
            observation: what the images show.
            theta: distance at which a point is an outlier, px.
            reject: reject outliers as the paper does (scored on the CPU), or else clamp them at theta.

        Returns:
            (B, V, 2) px: model to scene, scene to model; NaN for a missing view.
        """
        if reject:
            return distances_of(self.contours(scene, person, poses, True), observation, theta, reject)
        atlas, placements = atlas_on(self.device), scene.world_from_parts(person, poses)
        present = observation.packed.regions[:, RegionRow.WIDTH] > 0
        distances = np.full((len(placements), len(present), 2), np.nan)
        against = observation, theta, self.contact_m
        for meshes, batch in self._batches(atlas, scene, placements, present):
            found = atlas.scores(scene, placements[batch.poses], meshes, batch, against)
            distances[batch.poses] = np.where(present[:, None], found, np.nan)
        return distances

    def region_misfits(self, scene: Scene, person: int, poses: Array, lines: Lines) -> Array:
        """Misfits of colours; see `tracker.synthesis.Synthesis.region_misfits`."""
        return misfits_of(
            scene, scene.world_from_parts(person, poses), self.contours(scene, person, poses, True), lines
        )

    def _pictures(self, scene: Scene, placements: Array) -> list[list[Picture]]:
        """B times V pictures of parts placed at (B, P, 4, 4)."""
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
