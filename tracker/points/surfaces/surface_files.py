"""Measured surfaces as files: PLY for mesh and cloud programs, CSV for everything else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tracker.foundation.files import csv_lines, write_whole
from tracker.points.surfaces.points import SurfacePoints

_COLUMNS = ("x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "sigma", "residual_px", "red", "green", "blue")


def write_ply(surface: SurfacePoints, path: Path) -> None:
    """Writes points, colours and `sigma` (point error), metres, as binary PLY; replaced as a whole."""
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("sigma", "<f4")]
    fields += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.zeros(len(surface), dtype=fields)
    for axis, name in enumerate("xyz"):
        vertices[name] = surface.points[:, axis]
    vertices["sigma"] = surface.sigma_m
    for k, name in enumerate(("blue", "green", "red")):
        vertices[name] = surface.colours[:, k]
    kinds = {"<f4": "float", "u1": "uchar"}
    header = ["ply", "format binary_little_endian 1.0", "comment metres; sigma: point error, metres"]
    header += [f"element vertex {len(surface)}", *(f"property {kinds[kind]} {name}" for name, kind in fields)]
    write_whole(path, ("\n".join([*header, "end_header"]) + "\n").encode("ascii") + vertices.tobytes())


def write_csv(surface: SurfacePoints, views: Sequence[str], path: Path) -> None:
    """Writes a row for each point: position and standard deviations in metres, colour, pixels in every view."""
    deviations = np.sqrt(np.diagonal(surface.covariances, axis1=1, axis2=2))
    pixels = surface.pixels.transpose(1, 0, 2).reshape(len(surface), -1)
    columns = [*_COLUMNS, *(f"{view}_{axis}" for view in views for axis in "xy")]
    left = np.column_stack([surface.points, deviations, surface.sigma_m, surface.residual_px])
    lines = [csv_lines([columns]).removesuffix("\r\n")]
    for row, colour, seen in zip(left.tolist(), surface.colours[:, ::-1].tolist(), pixels.tolist(), strict=True):
        metres = [f"{value:.7f}" for value in row[:7]]
        places = ["" if value != value else f"{value:.3f}" for value in seen]
        lines.append(",".join([*metres, f"{row[7]:.4f}", *map(str, colour), *places]))
    write_whole(path, ("\n".join(lines) + "\n").encode("utf-8"))
