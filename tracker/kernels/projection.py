"""Projection of single points, shared by the compiled kernels."""

from __future__ import annotations

from tracker.arrays import Array
from tracker.kernels.compilation import compiled


@compiled(fastmath={"contract", "nsz"})
def project_point(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Image of a world point; the twin is `Camera.project`.

    Args:
        camera: (25,) row of `Rig.packed`.
        x, y, z: world position, metres.

    Returns:
        Pixel u, v and the depth in metres (pixel 0, 0 when the depth is not positive).
    """
    cx = camera[0] * x + camera[1] * y + camera[2] * z + camera[3]
    cy = camera[4] * x + camera[5] * y + camera[6] * z + camera[7]
    depth = camera[8] * x + camera[9] * y + camera[10] * z + camera[11]
    if depth <= 1e-9:
        return 0.0, 0.0, depth
    a, b = cx / depth, cy / depth
    r2 = a * a + b * b
    radial = 1.0 + r2 * (camera[19] + r2 * (camera[20] + r2 * camera[23]))
    u = a * radial + 2.0 * camera[21] * a * b + camera[22] * (r2 + 2.0 * a * a)
    v = b * radial + camera[21] * (r2 + 2.0 * b * b) + 2.0 * camera[22] * a * b
    return camera[15] * u + camera[24] * v + camera[17], camera[16] * v + camera[18], depth


@compiled(fastmath={"contract", "nsz"})
def project_along(
    cameras: Array, v: int, point: tuple[float, float, float], normal: tuple[float, float]
) -> tuple[float, float, float, float, float]:
    """Pixel of a world point, and the derivative of its position along an image normal, px per metre.

    The twins are `Camera.project` and `Camera.project_jacobian`.
    """
    x, y, z = point
    a = cameras[v, 0] * x + cameras[v, 1] * y + cameras[v, 2] * z + cameras[v, 3]
    b = cameras[v, 4] * x + cameras[v, 5] * y + cameras[v, 6] * z + cameras[v, 7]
    depth = cameras[v, 8] * x + cameras[v, 9] * y + cameras[v, 10] * z + cameras[v, 11]
    a, b = a / depth, b / depth
    k1, k2, p1, p2, k3 = cameras[v, 19], cameras[v, 20], cameras[v, 21], cameras[v, 22], cameras[v, 23]
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
    u = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    w = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    cross = a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b
    uu, ww = radial + a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a, radial + b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a
    # The normal in the distorted plane, then in the plane of the pinhole.
    gu, gw = normal[0] * cameras[v, 15], normal[0] * cameras[v, 24] + normal[1] * cameras[v, 16]
    ga, gb = (gu * uu + gw * cross) / depth, (gu * cross + gw * ww) / depth
    gz = -(ga * a + gb * b)
    return (
        cameras[v, 15] * u + cameras[v, 24] * w + cameras[v, 17],
        cameras[v, 16] * w + cameras[v, 18],
        ga * cameras[v, 0] + gb * cameras[v, 4] + gz * cameras[v, 8],
        ga * cameras[v, 1] + gb * cameras[v, 5] + gz * cameras[v, 9],
        ga * cameras[v, 2] + gb * cameras[v, 6] + gz * cameras[v, 10],
    )
