"""Models with a skin of their own: saved with it, and shown beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tracker.acquisition.result import BoneLength, Panel, PartResidual, fit_figure
from tracker.acquisition.scan_rigging import Fitted
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription, measured_pose, read_description, save_description
from tracker.bodies.body.sections import SkinSection
from tracker.bodies.scene import Person, Scene
from tracker.bodies.skin import Rigging, ScannedSurface, write_rigging, write_surface
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.evidence.measures.outlines import overlap
from tracker.foundation.arrays import Array
from tracker.foundation.files import replacing
from tracker.running.jobs._acquired import AcquireOutcome
from tracker.synthesis.cpu import CpuSynthesis

# Of the pictures that show how the parts fit the skin.
_PICTURE_PX = (480, 640)
_DIRECTIONS_DEG = {"front": 0.0, "side": 90.0}


def save_with_skin(
    description: BodyDescription, surface: ScannedSurface, rigging: Rigging, path: Path
) -> BodyDescription:
    """Writes a model with the files of its skin beside it; its section of the skin may say more of it already."""
    files = {"surface": str(path.with_suffix(".scan.ply")), "weights": str(path.with_suffix(".scan.npz"))}
    write_surface(surface, Path(files["surface"]))
    write_rigging(rigging, Path(files["weights"]))
    skin = description.skin or SkinSection(surface="")
    description = description.model_copy(update={"skin": skin.model_copy(update=files)})
    save_description(description, path)
    for file in files.values():
        Path(file).unlink()
    return description


def skinned_outcome(
    fits: Mapping[str, Fitted], description: BodyDescription, general: BodyDescription, path: Path
) -> AcquireOutcome:
    """Pictures of the parts over the silhouettes of a skin, and the figures.

    Args:
        fits: part -> how it was fitted to the skin.
        description: of the model that is saved, with its skin.
        general: of the body whose lengths are told beside.
        path: of the saved model; the picture is written beside it.
    """
    body = read_description(path).build()
    assert description.skin is not None
    q = measured_pose(body, description.skin)
    parts, cameras = _without_skin(description), _cameras(body, q)
    synthesis, panels, overlaps = CpuSynthesis(), [], {}
    for name, camera in cameras.items():
        mask = synthesis.silhouettes(Scene((Person(body.name, body, q),), Rig((camera,))))[0]
        covered = synthesis.silhouettes(Scene((Person(body.name, parts, q),), Rig((camera,))))[0]
        overlaps[name] = overlap(covered, mask)
        image = np.where(mask[..., None], np.uint8(150), np.uint8(235)).repeat(3, axis=2)
        panels.append(Panel(f"{name}: parts to skin, IoU {overlaps[name]:.3f}", image, mask, camera, q))
    figure, renderer = fit_figure(parts, panels, body.name)
    with replacing(path.with_suffix(".png")) as picture:
        figure.savefig(picture, dpi=100)
    residuals = _residuals(fits)
    rms = float(np.sqrt(np.mean([one.rms_mm**2 for one in residuals])))
    return AcquireOutcome(
        model=path,
        picture=path.with_suffix(".png"),
        shaded_by=renderer,
        stature_m=description.stature_m,
        overlaps=overlaps,
        before={},
        turns_deg=(),
        contour_rms_mm=rms,
        parts=residuals,
        bones=_bones(body, general),
    )


def _without_skin(description: BodyDescription) -> BodyModel:
    return description.model_copy(update={"skin": None}).build()


def _cameras(body: BodyModel, q: Array) -> dict[str, Camera]:
    """Cameras that see the whole skin, however wide it is."""
    assert body.skin is not None
    points = body.skin.world_points(body.world_from_part(q))
    middle, (depth, width, height) = (points.min(axis=0) + points.max(axis=0)) / 2, np.ptp(points, axis=0)
    extent = float(max(height, np.hypot(depth, width) * _PICTURE_PX[1] / _PICTURE_PX[0]))
    found = {}
    for name, degrees in _DIRECTIONS_DEG.items():
        angle, distance = np.radians(degrees), 4.0 * extent
        x, y, z = middle + distance * np.array([np.cos(angle), np.sin(angle), 0.0])
        focal_px = 0.85 * _PICTURE_PX[1] * distance / extent
        found[name] = Camera.looking_at(name, _PICTURE_PX, focal_px, (x, y, z), middle)
    return found


def _residuals(fits: Mapping[str, Fitted]) -> tuple[PartResidual, ...]:
    return tuple(
        PartResidual(
            part=name,
            rms_mm=1000 * fit.rms_m,
            bias_mm=1000 * fit.bias_m,
            contour_m=float(2 * fit.shape[2]),
            size_mm=(2000 * float(fit.shape[0]), 2000 * float(fit.shape[1]), 2000 * float(fit.shape[2])),
            sigma_mm=(0.0, 0.0, 0.0),
        )
        for name, fit in fits.items()
    )


def _bones(body: BodyModel, general: BodyDescription) -> tuple[BoneLength, ...]:
    """Lengths of all links, as scanned and in the general model scaled by the stature."""
    ratio = body.stature_m / general.stature_m if general.stature_m > 0 else 1.0
    before = {name: ratio * np.array(mark.at) for name, mark in general.landmarks.items()}
    after = {mark.name: mark.point for mark in body.landmarks}

    def length(points: dict[str, Array], link: tuple[str, str]) -> float:
        return 1000 * float(np.linalg.norm(points[link[0]] - points[link[1]]))

    return tuple(BoneLength("-".join(link), length(after, link), 0.0, length(before, link)) for link in body.links)
