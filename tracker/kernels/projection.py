"""Projection of single points, shared by the compiled kernels."""

from __future__ import annotations

from tracker.arrays import Array
from tracker.kernels.compilation import compiled
from tracker.kernels.rows.camera import (
    CX,
    CY,
    FX,
    FY,
    K1,
    K2,
    K3,
    P1,
    P2,
    R11,
    R12,
    R13,
    R21,
    R22,
    R23,
    R31,
    R32,
    R33,
    SHEAR,
    TX,
    TY,
    TZ,
)


@compiled(fastmath={"contract", "nsz"})
def project_point(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Image of a world point; the twin is `Camera.project`.

    Args:
        camera: (25,) row of `Rig.packed`.
        x, y, z: world position, metres.

    Returns:
        Pixel u, v and the depth in metres (pixel 0, 0 when the depth is not positive).
    """
    cx = camera[R11] * x + camera[R12] * y + camera[R13] * z + camera[TX]
    cy = camera[R21] * x + camera[R22] * y + camera[R23] * z + camera[TY]
    depth = camera[R31] * x + camera[R32] * y + camera[R33] * z + camera[TZ]
    if depth <= 1e-9:
        return 0.0, 0.0, depth
    a, b = cx / depth, cy / depth
    r2 = a * a + b * b
    radial = 1.0 + r2 * (camera[K1] + r2 * (camera[K2] + r2 * camera[K3]))
    u = a * radial + 2.0 * camera[P1] * a * b + camera[P2] * (r2 + 2.0 * a * a)
    v = b * radial + camera[P1] * (r2 + 2.0 * b * b) + 2.0 * camera[P2] * a * b
    return camera[FX] * u + camera[SHEAR] * v + camera[CX], camera[FY] * v + camera[CY], depth


@compiled(fastmath={"contract", "nsz"})
def project_along(
    cameras: Array, v: int, point: tuple[float, float, float], normal: tuple[float, float]
) -> tuple[float, float, float, float, float]:
    """Pixel of a world point, and the derivative of its position along an image normal, px per metre.

    The twins are `Camera.project` and `Camera.project_jacobian`.
    """
    x, y, z = point
    a = cameras[v, R11] * x + cameras[v, R12] * y + cameras[v, R13] * z + cameras[v, TX]
    b = cameras[v, R21] * x + cameras[v, R22] * y + cameras[v, R23] * z + cameras[v, TY]
    depth = cameras[v, R31] * x + cameras[v, R32] * y + cameras[v, R33] * z + cameras[v, TZ]
    a, b = a / depth, b / depth
    k1, k2, p1, p2, k3 = cameras[v, K1], cameras[v, K2], cameras[v, P1], cameras[v, P2], cameras[v, K3]
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
    u = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    w = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    cross = a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b
    uu, ww = radial + a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a, radial + b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a
    # The normal in the distorted plane, then in the plane of the pinhole.
    gu, gw = normal[0] * cameras[v, FX], normal[0] * cameras[v, SHEAR] + normal[1] * cameras[v, FY]
    ga, gb = (gu * uu + gw * cross) / depth, (gu * cross + gw * ww) / depth
    gz = -(ga * a + gb * b)
    return (
        cameras[v, FX] * u + cameras[v, SHEAR] * w + cameras[v, CX],
        cameras[v, FY] * w + cameras[v, CY],
        ga * cameras[v, R11] + gb * cameras[v, R21] + gz * cameras[v, R31],
        ga * cameras[v, R12] + gb * cameras[v, R22] + gz * cameras[v, R32],
        ga * cameras[v, R13] + gb * cameras[v, R23] + gz * cameras[v, R33],
    )
