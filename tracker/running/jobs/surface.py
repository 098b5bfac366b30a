"""Surfaces: measures in every frame, by least squares matching, the surface that two or more views show."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pydantic

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.configuration.components import component
from tracker.foundation.files import replacing, write_json
from tracker.foundation.progress import Progress
from tracker.images.reading import Reading, Sequence
from tracker.points.surfaces.patch_figure import patch_figure, patch_searches
from tracker.points.surfaces.surface import Surface, SurfaceMeasurement, measure_surface, residual_rms_px
from tracker.points.surfaces.surface_files import cloud_figure, matches_figure, write_csv, write_ply
from tracker.running.jobs import ResultFolder, described
from tracker.running.jobs._following import position


@component
class SurfaceJob(SurfaceMeasurement):
    """Measures the surface that two or more views show: a point cloud with sigmas, pictures, CSV."""

    resumable: ClassVar[bool] = False

    name: str = "surface"
    """Name of the results' folder: `results/NAME/TIME`."""

    reading: Reading = pydantic.Field(
        examples=['{ use = "stills", path = "{view}.png", rig = "rig.toml" }; see configs/surfaces/temple.toml']
    )
    """The pictures or the recording."""

    patches: tuple[tuple[float, float], ...] = ()
    """Pixels of the template whose search is drawn: `patch_NUMBER.png` has template, start, way and end."""

    @pydantic.field_validator("patches", mode="before")
    @classmethod
    def _whole_numbers_are_positions(cls, patches: object) -> object:
        return tuple(map(position, patches)) if isinstance(patches, tuple | list) else patches

    def open(self, earlier: Path | None = None) -> Sequence:
        """Opens the views; see `jobs.Job.open`."""
        sequence = self.reading.open()
        self.template_of(sequence.rig)
        return sequence

    def execute(self, opened: Sequence, folder: ResultFolder, progress: Progress) -> SurfaceOutcome:
        """Measures every frame and writes its results at once; see `jobs.Job.execute`."""
        save_rig(opened.rig, folder.path / "rig.toml")
        summaries: list[SurfaceSummary] = []
        for frame in opened.frames():
            begin = time.perf_counter()
            surface = measure_surface(self, frame, opened.rig, progress)
            seconds = time.perf_counter() - begin
            suffix = f"_{frame.index:06d}" if opened.n_frames > 1 else ""
            progress("writing", 0, 1)
            files = (*_write(surface, opened.rig, folder.path, suffix), *self._drawn(surface, folder.path, suffix))
            summaries.append(_summary(surface, frame.index, seconds, files))
            content = {"config": described(self), "frames": [asdict(summary) for summary in summaries]}
            write_json(folder.path / "surface.json", content)
            folder.keep()
            progress("writing", 1, 1)
        return SurfaceOutcome(folder.path, tuple(summaries))

    def _drawn(self, surface: Surface, folder: Path, suffix: str) -> list[str]:
        """Pictures of searches, as configured."""
        names = [f"patch_{k}{suffix}.png" for k in range(len(self.patches))]
        for name, at in zip(names, self.patches, strict=True):
            searches = patch_searches(surface, self.matching, at)
            figure = patch_figure(surface.views[surface.template], searches, self.matching.patch_px)
            with replacing(folder / name) as path:
                figure.savefig(path, dpi=110)
        return names


@dataclass(frozen=True)
class SurfaceSummary:
    """Figures of one measured frame."""

    frame: int
    n_points: int
    n_matches: dict[str, int]
    """Matches of each search image after filtering."""

    n_seeds: dict[str, int]
    coverage: dict[str, float]
    """Share of the places known to be visible in both template and search image, 0 to 1."""

    warnings: tuple[str, ...]
    residual_px: float
    """RMS of the reprojection, px."""

    s0: float
    median_sigma_mm: float
    """Median point error, mm."""

    seconds: float
    files: tuple[str, ...]


@dataclass(frozen=True)
class SurfaceOutcome:
    """Outcome of a surface measurement; the figures are in `surface.json`, too."""

    folder: Path
    frames: tuple[SurfaceSummary, ...]


def _write(surface: Surface, rig: Rig, folder: Path, suffix: str) -> tuple[str, ...]:
    names = tuple(f"{stem}{suffix}.{kind}" for stem, kind in _FILES)
    write_ply(surface.points, folder / names[0])
    write_csv(surface.points, rig.names, folder / names[1])
    for name, figure in ((names[2], matches_figure(surface)), (names[3], cloud_figure(surface.points, rig))):
        with replacing(folder / name) as path:
            figure.savefig(path, dpi=110)
    return names


_FILES = (("surface", "ply"), ("surface", "csv"), ("matches", "png"), ("cloud", "png"))


def _summary(surface: Surface, frame: int, seconds: float, files: tuple[str, ...]) -> SurfaceSummary:
    names = [view.camera.name for view in surface.views]
    searched = [v for v in range(len(names)) if v != surface.template]
    return SurfaceSummary(
        frame=frame,
        n_points=len(surface.points),
        n_matches={names[v]: int(field.matched.sum()) for v in searched if (field := surface.fields[v])},
        n_seeds={names[v]: coverage.n_seeds for v in searched if (coverage := surface.coverages[v])},
        coverage={names[v]: coverage.share for v in searched if (coverage := surface.coverages[v])},
        warnings=surface.warnings,
        residual_px=residual_rms_px(surface.points),
        s0=surface.points.s0,
        median_sigma_mm=1000 * float(np.median(surface.points.sigma_m)),
        seconds=seconds,
        files=files,
    )
