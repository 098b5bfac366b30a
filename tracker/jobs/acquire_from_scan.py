"""Acquisition from a laser scan with its joints: a person's model with a skin."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
import pydantic

from tracker.acquisition.figures import Panel, fit_figure
from tracker.acquisition.result import BoneLength, PartResidual
from tracker.acquisition.scan import Scan, ScanFiles, read_scan
from tracker.acquisition.scan_rigging import Rigged, rigged
from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.body.description import BodyDescription
from tracker.body.files import read_buildable, read_description, save_description
from tracker.body.skin import measured_pose
from tracker.camera import Camera
from tracker.components import ModelFile, component
from tracker.files import replacing, write_json
from tracker.jobs import ResultFolder, described
from tracker.jobs._acquired import MODEL, AcquireOutcome
from tracker.kernels.ahead import Group
from tracker.mirror import Mirror
from tracker.outlines import overlap
from tracker.progress import Progress
from tracker.resources import model_path
from tracker.rig import Rig
from tracker.scene import Person, Scene
from tracker.skin_files import write_rigging, write_surface
from tracker.synthesis.cpu import CpuSynthesis

# Of the pictures that show how the parts fit the scan.
_PICTURE_PX = (480, 640)
_DIRECTIONS_DEG = {"front": 0.0, "side": 90.0}


@component
class ScanJob:
    """Makes a person's model from a laser scan and its joints: `model.toml`, its skin, a picture and figures."""

    kernels: ClassVar[Group | None] = "tracking"
    resumable: ClassVar[bool] = False

    scan: ScanFiles
    """The scan: surface, weights and joints."""

    name: str = "model"
    """Of the model."""

    model: ModelFile = pydantic.Field(default_factory=lambda: model_path("human").resolve())
    """The body whose parameters, groups and conventions it gets: the name of a bundled model, or a path that ends in
    .toml."""

    smooth: bool = True
    """Blend the motions of several parts near joints; false: every vertex moves with one part."""

    def open(self, earlier: Path | None = None) -> tuple[BodyDescription, Scan]:
        """Reads the model and the scan; see `tracker.jobs.Job.open`."""
        general = read_buildable(self.model)
        return general, read_scan(self.scan, Mirror(general.sides, general.across))

    @property
    def model_name(self) -> str:
        """What the model is called."""
        return self.name

    def execute(self, opened: tuple[BodyDescription, Scan], folder: ResultFolder, progress: Progress) -> AcquireOutcome:
        """Puts the skeleton into the scan and fits the parts; see `tracker.jobs.Job.execute`."""
        general, scan = opened
        progress("fitting the parts")
        found = rigged(general, scan, self.name)
        path = folder.path / MODEL
        files = {"surface": str(path.with_suffix(".scan.ply")), "weights": str(path.with_suffix(".scan.npz"))}
        write_surface(scan.surface, Path(files["surface"]))
        write_rigging(scan.rigging, Path(files["weights"]))
        assert found.description.skin is not None
        skin = found.description.skin.model_copy(update=files | {"smooth": self.smooth})
        description = found.description.model_copy(update={"skin": skin})
        save_description(description, path)
        for file in files.values():
            Path(file).unlink()
        outcome = _drawn(found, description, general, path)
        write_json(path.with_suffix(".json"), {**outcome.as_dict(), "config": described(self)})
        return outcome


def _drawn(found: Rigged, description: BodyDescription, general: BodyDescription, path: Path) -> AcquireOutcome:
    """Pictures of the parts over the scan's silhouettes, and the figures."""
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
        panels.append(Panel(f"{name}: parts to scan, IoU {overlaps[name]:.3f}", image, mask, camera, q))
    figure, renderer = fit_figure(parts, panels, body.name)
    with replacing(path.with_suffix(".png")) as picture:
        figure.savefig(picture, dpi=100)
    residuals = _residuals(found)
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
    """Cameras that see the whole scan."""
    assert body.skin is not None
    points = body.skin.world_points(body.world_from_part(q))
    middle, height = (points.min(axis=0) + points.max(axis=0)) / 2, float(np.ptp(points[:, 2]))
    found = {}
    for name, degrees in _DIRECTIONS_DEG.items():
        angle, distance = np.radians(degrees), 4.0 * height
        x, y, z = middle + distance * np.array([np.cos(angle), np.sin(angle), 0.0])
        focal_px = 0.85 * _PICTURE_PX[1] * distance / height
        found[name] = Camera.looking_at(name, _PICTURE_PX, focal_px, (x, y, z), middle)
    return found


def _residuals(found: Rigged) -> tuple[PartResidual, ...]:
    return tuple(
        PartResidual(
            part=name,
            rms_mm=1000 * fit.rms_m,
            bias_mm=1000 * fit.bias_m,
            contour_m=float(2 * fit.shape[2]),
            size_mm=(2000 * float(fit.shape[0]), 2000 * float(fit.shape[1]), 2000 * float(fit.shape[2])),
            sigma_mm=(0.0, 0.0, 0.0),
        )
        for name, fit in found.fits.items()
    )


def _bones(body: BodyModel, general: BodyDescription) -> tuple[BoneLength, ...]:
    """Lengths of all links, as scanned and in the general model scaled by the stature."""
    ratio = body.stature_m / general.stature_m if general.stature_m > 0 else 1.0
    before = {name: ratio * np.array(mark.at) for name, mark in general.landmarks.items()}
    after = {mark.name: mark.point for mark in body.landmarks}

    def length(points: dict[str, Array], link: tuple[str, str]) -> float:
        return 1000 * float(np.linalg.norm(points[link[0]] - points[link[1]]))

    return tuple(BoneLength("-".join(link), length(after, link), 0.0, length(before, link)) for link in body.links)
