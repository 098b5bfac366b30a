"""Strain of the moving back's shirt beside that of the exact mesh."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from benchmarks.followed_back import add_row, followed
from benchmarks.moving_back import CENTRE, Back, Start
from tracker.foundation.arrays import Array
from tracker.points.following.following import Following
from tracker.points.strain import Strains, gauges_of, near, smoothed, spacing_m, strains_of
from tracker.points.trajectories import PointFrame
from tracker.running.skin_strain import DEPTH, GAUGE

# The issue: strain to 0.5 % on 5 mm bases, which 4 px of the centre view are.
_STEP_PX, _AIM = 4, 0.5
# Reaches of gauges in distances of neighbours: the four next ones, and the default.
_GAUGES = (1.25, GAUGE)
# Of a normal distribution: within one standard deviation, and the median of the deviations' size over it.
_ONE_SIGMA, _MIDDLE = 68.3, 0.674


def add_rows(table: Table, back: Back) -> None:
    """Rows for gauges of two sizes, in a middle frame and the last one.

    Args:
        table: of four columns.
        back: the recording.
    """
    following, start = Following(), back.start(100_000, _STEP_PX)
    frames, _ = followed(back, start, following)
    first, patch_px = frames[0], following.matching.patch_px
    spacing, camera = spacing_m(first.positions), back.rig.cameras[CENTRE]
    px_m = float(np.nanmedian(camera.in_camera(first.positions)[:, 2])) / camera.matrix[0, 0]
    table.add_row("points, and how far apart", f"{len(first.ids)}", "", f"{1000 * spacing:.2f} mm")
    for reach in _GAUGES:
        for frame in (frames[len(frames) // 2], frames[-1]):
            found = _measured(first, frame, (reach * spacing, DEPTH * spacing, patch_px * px_m))
            gauges = gauges_of(start.positions[first.index], reach * spacing)
            true = strains_of(gauges, start.positions[frame.index], 0.0)
            point = _at_points(back, start, frame.index)
            _add(table, f"gauges reach {1000 * reach * spacing:.1f} mm, frame {frame.index}", found, (true, point))


def _measured(first: PointFrame, frame: PointFrame, reaches: tuple[float, float, float]) -> Strains:
    gauge_m, depth_m, patch_m = reaches
    around = near(first.positions, depth_m)
    begun, now = (smoothed(one.positions, one.covariances, around) for one in (first, frame))
    return strains_of(gauges_of(begun, gauge_m), now, patch_m)


def _at_points(back: Back, start: Start, index: int) -> Array:
    """(N, 2) principal strains of the triangle of the mesh that each point lies in, the larger one first."""
    corners = back.truth.triangles[start.material[0]]
    sides = [np.stack([at[corners[:, k]] - at[corners[:, 0]] for k in (1, 2)], axis=2) for at in _vertices(back, index)]
    flat = np.linalg.qr(sides[0])[1]
    maps = sides[1] @ np.linalg.inv(flat)
    found: Array = np.sqrt(np.linalg.eigvalsh(maps.transpose(0, 2, 1) @ maps))[:, ::-1] - 1
    return found


def _vertices(back: Back, index: int) -> tuple[Array, Array]:
    return back.truth.vertices(0), back.truth.vertices(index)


def _add(table: Table, name: str, found: Strains, truths: tuple[Strains, Array]) -> None:
    true, point = truths
    off, beside = (100 * np.abs(found.stretches - one) for one in (true.stretches, point))
    known = np.isfinite(off[:, 0])
    size = f"{int(known.sum())} gauges, strains to {np.nanpercentile(np.abs(100 * true.stretches), 95):.1f} % (95 %)"
    within, around = (float(np.percentile(one[known], _ONE_SIGMA)) for one in (off, beside))
    add_row(table, f"{name}: 68 % are off by less than", within, "%", _AIM, note=size)
    add_row(table, f"{name}: from the strain at the point", around, "%", note="what the gauge smooths besides")
    add_row(table, f"{name}: median error", float(np.median(off[known])), "%")
    told = 100 * float(np.median(found.sigmas[known]))
    ratio = float(np.median(off[known] / found.sigmas[known])) / 100 / _MIDDLE
    table.add_row(f"{name}: sigma told", f"{told:.3f} %", "", f"error / sigma {ratio:.2f}; 1 is right")
