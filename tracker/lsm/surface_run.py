"""What a surface configuration describes, and its execution."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.config import Table, build, build_class, describe, read_config
from tracker.errors import ConfigError, nearest
from tracker.lsm.surface import Surface, SurfaceMeasurement, Told, measure_surface, residual_rms_px
from tracker.lsm.surface_files import write_csv, write_ply
from tracker.lsm.surface_pictures import cloud_figure, matches_figure
from tracker.reading import Reading
from tracker.rig import Rig


@dataclass(frozen=True)
class SurfaceRun:
    """Surfaces to be measured in the frames of a recording."""

    name: str
    reading: Reading
    measurement: SurfaceMeasurement

    def described(self) -> Table:
        """The resolved configuration; it loads again to an equal run."""
        measurement = _without_use(describe(self.measurement))
        return {"name": self.name, "reading": describe(self.reading), **measurement}


@dataclass(frozen=True)
class SurfaceSummary:
    """Figures of one measured frame."""

    frame: int
    n_points: int
    n_matches: dict[str, int]
    """Matches of each search image after filtering."""

    n_seeds: dict[str, int]
    coverage: dict[str, float]
    """Share of the places that template and search image are known to have in common, 0 to 1."""

    warnings: tuple[str, ...]
    residual_px: float
    """RMS of the reprojection, px."""

    s0: float
    median_sigma_mm: float
    """Median point error, mm."""

    seconds: float
    files: tuple[str, ...]


def load_surface_run(path: Path, overrides: Sequence[str] = ()) -> SurfaceRun:
    """Reads the configuration of a surface measurement.

    Args:
        path: TOML file; relative paths in it start at its folder.
        overrides: `section.key=value`.

    Raises:
        ConfigError: names file, section, key and the nearest valid one.
    """
    table, source, folder = read_config(path, overrides), path.name, path.parent
    fields = [field.name for field in dataclasses.fields(SurfaceMeasurement)]
    valid = ("name", "reading", *fields)
    for key in table:
        if key not in valid:
            raise ConfigError(f'{source}: unknown key or section "{key}"; {nearest(key, valid)}')
    if not isinstance(table.get("reading"), dict):
        raise ConfigError(f"{source}: the section [reading] is missing; see configs/surfaces/temple.toml")
    reading = build("reading", table["reading"], f"{source} [reading]", folder)
    chosen = {key: value for key, value in table.items() if key in fields}
    measurement = build_class(SurfaceMeasurement, chosen, source, folder)
    return SurfaceRun(str(table.get("name", path.stem)), reading, measurement)


def _without_use(table: Table) -> Table:
    """A description without the component names that a surface configuration does not need."""
    return {
        key: _without_use(value) if isinstance(value, dict) else value for key, value in table.items() if key != "use"
    }


def execute_surface_run(
    run: SurfaceRun, folder: Path, told: Told = lambda what, done, total: None
) -> list[SurfaceSummary]:
    """Measures every frame of the recording and writes the results of each as soon as it is done.

    Args:
        run: what to do.
        folder: where the results go; made when the first frame is measured.
        told: of the progress.

    Returns:
        Figures of the frames; also in `surface.json`, with the configuration.

    Raises:
        TrackerError: of the reading or the measurement; files of frames measured before it stay.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty: choose another --output")
    sequence = run.reading.open()
    run.measurement.template_of(sequence.rig)
    summaries = []
    for frame in sequence.frames():
        begin = time.perf_counter()
        surface = measure_surface(run.measurement, frame, sequence.rig, told)
        seconds = time.perf_counter() - begin
        folder.mkdir(parents=True, exist_ok=True)
        suffix = f"_{frame.index:06d}" if sequence.n_frames > 1 else ""
        told("writing", 0, 1)
        files = _write(surface, sequence.rig, folder, suffix)
        summaries.append(_summary(surface, frame.index, seconds, files))
        _write_json(run, summaries, folder)
        told("writing", 1, 1)
    return summaries


def _write(surface: Surface, rig: Rig, folder: Path, suffix: str) -> tuple[str, ...]:
    names = tuple(f"{stem}{suffix}.{kind}" for stem, kind in _FILES)
    write_ply(surface.points, folder / names[0])
    write_csv(surface.points, rig.names, folder / names[1])
    matches_figure(surface).savefig(folder / names[2], dpi=110)
    cloud_figure(surface.points, rig).savefig(folder / names[3], dpi=110)
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


def _write_json(run: SurfaceRun, summaries: list[SurfaceSummary], folder: Path) -> None:
    content = {"config": run.described(), "frames": [dataclasses.asdict(summary) for summary in summaries]}
    unfinished = folder / "surface.json.part"
    unfinished.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    unfinished.replace(folder / "surface.json")
