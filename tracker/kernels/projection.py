"""Projection of single points, shared by the compiled kernels."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled
from tracker.kernels.lens import bend, bend_with_slopes, beyond_reach, lens_of
from tracker.kernels.rows import camera as at


@compiled(fastmath={"contract", "nsz"})
def _in_camera(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A world point in the camera's frame, metres."""
    return (
        camera[at.R11] * x + camera[at.R12] * y + camera[at.R13] * z + camera[at.TX],
        camera[at.R21] * x + camera[at.R22] * y + camera[at.R23] * z + camera[at.TY],
        camera[at.R31] * x + camera[at.R32] * y + camera[at.R33] * z + camera[at.TZ],
    )


@compiled(fastmath={"contract", "nsz"})
def project_point(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Image of a world point; the twin is `Camera.project`.

    Args:
        camera: (29,) row of `Rig.packed`.
        x, y, z: world position, metres.

    Returns:
        Pixel u, v and the depth in metres, 0 beyond the reach of the lens (pixel 0, 0 when it is not positive).
    """
    cx, cy, depth = _in_camera(camera, x, y, z)
    if depth <= 1e-9:
        return 0.0, 0.0, depth
    a, b = cx / depth, cy / depth
    if beyond_reach(camera, a, b):
        return 0.0, 0.0, 0.0
    u, v = _through_lens(camera, a, b)
    return u, v, depth


@compiled(fastmath={"contract", "nsz"})
def _through_lens(camera: Array, a: float, b: float) -> tuple[float, float]:
    """Pixel of a point of the plane z = 1 of the camera."""
    u, v = bend(lens_of(camera), a, b, 1.0)
    return camera[at.FX] * u + camera[at.SHEAR] * v + camera[at.CX], camera[at.FY] * v + camera[at.CY]


@compiled
def project_grid(placement: Array, grid: Array32, camera: Array, pixels: Array) -> float:
    """Images of the points of a part; several at a time, for nothing branches.

    Args:
        placement: (4, 4) world_from_part, metres.
        grid: (N, 3 or more) points of the part, metres.
        camera: (29,) row of `Rig.packed`.
        pixels: (3, N) output: pixels, of use only where all points lie before the camera, and depths, metres; 0 beyond
            the reach of the lens.

    Returns:
        Least depth, metres.
    """
    for i in range(pixels.shape[1]):
        x, y, z = grid[i, 0], grid[i, 1], grid[i, 2]
        wx = placement[0, 0] * x + placement[0, 1] * y + placement[0, 2] * z + placement[0, 3]
        wy = placement[1, 0] * x + placement[1, 1] * y + placement[1, 2] * z + placement[1, 3]
        wz = placement[2, 0] * x + placement[2, 1] * y + placement[2, 2] * z + placement[2, 3]
        cx, cy, depth = _in_camera(camera, wx, wy, wz)
        a, b = cx / depth, cy / depth
        u, v = _through_lens(camera, a, b)
        pixels[0, i], pixels[1, i], pixels[2, i] = u, v, 0.0 if beyond_reach(camera, a, b) else depth
    nearest = np.inf
    for i in range(pixels.shape[1]):
        nearest = min(nearest, pixels[2, i])
    return nearest


@compiled(fastmath={"contract", "nsz"})
def project_along(
    cameras: Array, v: int, point: tuple[float, float, float], normal: tuple[float, float]
) -> tuple[float, float, float, float, float]:
    """Pixel of a world point, and the derivative of its position along an image normal, px per metre.

    The twins are `Camera.project` and `Camera.project_jacobian`.
    """
    x, y, z = point
    a = cameras[v, at.R11] * x + cameras[v, at.R12] * y + cameras[v, at.R13] * z + cameras[v, at.TX]
    b = cameras[v, at.R21] * x + cameras[v, at.R22] * y + cameras[v, at.R23] * z + cameras[v, at.TY]
    depth = cameras[v, at.R31] * x + cameras[v, at.R32] * y + cameras[v, at.R33] * z + cameras[v, at.TZ]
    a, b = a / depth, b / depth
    u, w, uu, cross, ww = bend_with_slopes(lens_of(cameras[v]), a, b, 1.0)
    # The normal in the distorted plane, then in the plane of the pinhole.
    gu, gw = normal[0] * cameras[v, at.FX], normal[0] * cameras[v, at.SHEAR] + normal[1] * cameras[v, at.FY]
    ga, gb = (gu * uu + gw * cross) / depth, (gu * cross + gw * ww) / depth
    gz = -(ga * a + gb * b)
    return (
        cameras[v, at.FX] * u + cameras[v, at.SHEAR] * w + cameras[v, at.CX],
        cameras[v, at.FY] * w + cameras[v, at.CY],
        ga * cameras[v, at.R11] + gb * cameras[v, at.R21] + gz * cameras[v, at.R31],
        ga * cameras[v, at.R12] + gb * cameras[v, at.R22] + gz * cameras[v, at.R32],
        ga * cameras[v, at.R13] + gb * cameras[v, at.R23] + gz * cameras[v, at.R33],
    )
