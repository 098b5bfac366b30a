"""Contour samples from pictures of part numbers and depths.

A pixel lies on its part's contour if one of its four neighbours shows the background or something farther away. In a
round window about it, what shows the part is inside and what lies farther away is outside; whatever is nearer hides
both and counts for neither. The centres of both sides give the normal, the share of the inside gives the distance of
the contour from the pixel's centre. `tracker/synthesis/_shaders/edges.glsl` is this file for a graphics card.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.solids import in_part
from tracker.kernels.lens import bend_with_slopes, lens_of, undistort
from tracker.kernels.rows import camera as at

WINDOW_PX2 = 12.0
"""Squared radius of the window, px^2; a pixel's weight falls from 1 at its centre to 0 at this distance."""

SHARE_PER_PX = 0.245
"""Share of the window that a straight contour through its middle gains in a pixel."""

DEEPEST_M = 0.1
"""A surface may bend away by this much between the last pixel's centre and the contour, metres."""

_K1, _K2, _AROUND, _ALONG, _UPWARD = 12, 13, 14, 15, 16
"""Taper and exponents of a part; the columns before them are those of `tracker.kernels.rows.solid`."""


@compiled
def _side(
    ids: Integers, depths: Array32, frame: tuple[int, int, int, int], x: int, y: int, here: tuple[int, float]
) -> int:
    """What a pixel is to part and depth `here`: 1 inside, 2 outside, 0 neither; unpainted surroundings are background.

    Args:
        ids, depths: the picture.
        frame: origin of the picture in the image, image size, px.
        x, y: column and row in the picture.
        here: a part and its depth.
    """
    if x + frame[0] < 0 or y + frame[1] < 0 or x + frame[0] >= frame[2] or y + frame[1] >= frame[3]:
        return 0
    if x < 0 or y < 0 or y >= ids.shape[0] or x >= ids.shape[1] or ids[y, x] < 0:
        return 2
    if ids[y, x] == here[0]:
        return 1
    return 2 if depths[y, x] > here[1] else 0


@compiled
def _gap(ids: Integers, depths: Array32, frame: tuple[int, int, int, int], x: int, y: int) -> float:
    """How far behind the pixel its nearest farther neighbour lies, metres; -1 for a pixel that is on no contour."""
    here, gap, found = (ids[y, x], depths[y, x]), 1e9, False
    for k in range(4):
        column, row = x + (1 - k if k % 2 == 0 else 0), y + (2 - k if k % 2 == 1 else 0)
        if _side(ids, depths, frame, column, row, here) == 2:
            found = True
            within = 0 <= row < ids.shape[0] and 0 <= column < ids.shape[1]
            if within and ids[row, column] >= 0:
                gap = min(gap, depths[row, column] - here[1])
    return gap if found else -1.0


@compiled
def _place(
    ids: Integers, depths: Array32, frame: tuple[int, int, int, int], x: int, y: int
) -> tuple[float, float, float]:
    """Unit normal of the contour beside a pixel, and its distance from the pixel's centre, px."""
    here = ids[y, x], depths[y, x]
    inside = outside = inside_x = inside_y = outside_x = outside_y = 0.0
    for dy in range(-3, 4):
        for dx in range(-3, 4):
            weight = 1.0 - (dx * dx + dy * dy) / WINDOW_PX2
            if weight <= 0.0:
                continue
            side = _side(ids, depths, frame, x + dx, y + dy, here)
            if side == 1:
                inside, inside_x, inside_y = inside + weight, inside_x + weight * dx, inside_y + weight * dy
            elif side == 2:
                outside, outside_x, outside_y = outside + weight, outside_x + weight * dx, outside_y + weight * dy
    nx, ny = outside_x / outside - inside_x / inside, outside_y / outside - inside_y / inside
    length = np.sqrt(nx * nx + ny * ny)
    if length < 1e-3:
        return 0.0, 1.0, 0.5
    beyond = (inside / (inside + outside) - 0.5) / SHARE_PER_PX
    return nx / length, ny / length, min(max(beyond, 0.0), 1.0)


@compiled
def _depth_there(ids: Integers, depths: Array32, x: int, y: int, normal: tuple[float, float], beyond: float) -> float:
    """Depth at the contour, metres: a round surface falls away with the root of the distance from its contour."""
    dx, dy = int(np.rint(-normal[0])), int(np.rint(-normal[1]))
    column, row = x + dx, y + dy
    if not (0 <= row < ids.shape[0] and 0 <= column < ids.shape[1]) or ids[row, column] != ids[y, x]:
        return depths[y, x]
    near, far = np.sqrt(beyond), np.sqrt(beyond - dx * normal[0] - dy * normal[1])
    fall = (depths[y, x] - depths[row, column]) * near / max(far - near, 1e-3)
    return depths[y, x] + min(max(fall, 0.0), DEEPEST_M)


@compiled
def _lift(camera: Array, x: float, y: float, normal: tuple[float, float], depth: float, out: Array) -> None:
    """World point of a pixel and world normal of the plane through the contour and the camera, to `out` (6,)."""
    a, b = undistort(camera, x, y)
    sx, sy = camera[at.FX] * normal[0], camera[at.SHEAR] * normal[0] + camera[at.FY] * normal[1]
    _, _, xx, xy, yy = bend_with_slopes(lens_of(camera), a, b, 1.0)
    nx, ny = xx * sx + xy * sy, xy * sx + yy * sy
    nz = -(nx * a + ny * b)
    scale = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
    cx, cy, cz = a * depth - camera[at.TX], b * depth - camera[at.TY], depth - camera[at.TZ]
    for k in range(3):
        out[k] = camera[at.R11 + k] * cx + camera[at.R21 + k] * cy + camera[at.R31 + k] * cz
        out[3 + k] = scale * (camera[at.R11 + k] * nx + camera[at.R21 + k] * ny + camera[at.R31 + k] * nz)


@compiled
def _encloses(solids: Array, q: int, x: float, y: float, z: float) -> bool:
    """Whether a world point lies inside part q."""
    x, y, w = in_part(solids, q, x, y, z)
    if abs(w) > 1.0:
        return False
    u, v = abs(x / (1.0 + solids[q, _K1] * w)), abs(y / (1.0 + solids[q, _K2] * w))
    if u > 1.0 or v > 1.0:
        return False
    around = (u ** solids[q, _AROUND] + v ** solids[q, _AROUND]) ** solids[q, _ALONG]
    return around + abs(w) ** solids[q, _UPWARD] < 1.0


@compiled
def _touches(solids: Array, p: int, sample: Array, contact_m: float) -> bool:
    """Whether a sample (6,) of part p lies inside another part once moved outwards by the contact distance."""
    x, y, z = sample[0] + contact_m * sample[3], sample[1] + contact_m * sample[4], sample[2] + contact_m * sample[5]
    for q in range(len(solids)):
        if q == p:
            continue
        if _encloses(solids, q, x, y, z):
            return True
    return False


@compiled
def id_contours(
    ids: Integers,
    depths: Array32,
    frame: tuple[int, int, int, int],
    camera: Array,
    solids: Array,
    contact_m: float,
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
) -> int:
    """Contour samples, one for each pixel on a part's contour.

    Args:
        ids: (h, w) scene-wide part number, -1 for the background.
        depths: (h, w) metres, where there is a part.
        frame: x, y of the picture's first pixel in the image, width and height of the image, px. The image shows
            nothing but background around the picture.
        camera: (29,) row of `Rig.packed`.
        solids: (P, 17) motion (3x4) from the world into the part's frame in units of its half extents, tapers,
            exponents 2/e2, e2/e1 and 2/e1.
        contact_m: distance at which parts touch, metres.
        positions, points, parts, between: outputs for M samples, laid out as in `Contours`.

    Returns:
        Samples found; those beyond M are not written.
    """
    n, sample = 0, np.zeros(6)
    for y in range(ids.shape[0]):
        for x in range(ids.shape[1]):
            gap = _gap(ids, depths, frame, x, y) if ids[y, x] >= 0 else -1.0
            if gap < 0.0:
                continue
            n += 1
            if n > len(parts):
                continue
            nx, ny, beyond = _place(ids, depths, frame, x, y)
            depth = _depth_there(ids, depths, x, y, (nx, ny), beyond)
            u, v = x + frame[0] + beyond * nx, y + frame[1] + beyond * ny
            _lift(camera, u, v, (nx, ny), depth, sample)
            touching = gap - (depth - depths[y, x]) < contact_m or _touches(solids, ids[y, x], sample, contact_m)
            positions[n - 1, 0], positions[n - 1, 1], positions[n - 1, 2], positions[n - 1, 3] = u, v, nx, ny
            positions[n - 1, 4] = 0.0 if touching else 1.0 / max(abs(nx), abs(ny))
            for k in range(3):
                points[n - 1, k] = sample[k]
            parts[n - 1] = ids[y, x]
            between[n - 1] = touching
    return n
