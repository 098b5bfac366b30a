"""Where a camera shows a point, and how that changes with camera and point: what a bundle adjustment linearizes."""

from __future__ import annotations

from tracker.arrays import Array
from tracker.kernels.compilation import compiled
from tracker.kernels.lens import LensTerms, bend_with_slopes
from tracker.kernels.rows import bundle_camera as state
from tracker.kernels.rows import bundle_unknown as unknown


@compiled
def project_with_slopes(
    camera: Array, point: Array, velocity: Array, by_camera: Array, by_point: Array
) -> tuple[float, float, bool]:
    """Image of a point with its derivatives; the twin is `Camera.project`.

    Args:
        camera: (26,) state, see `tracker.kernels.rows.bundle_camera`.
        point: (3,) world position, metres.
        velocity: (2,) velocity of the image, px per frame; the time offset shifts along it.
        by_camera: (2, 17) output; rotations act after the camera's own, positions are the centre's.
        by_point: (2, 3) output.

    Returns:
        Pixel u, v, and whether the point lies before the camera; if it does not, the slopes are 0.
    """
    by_camera[:], by_point[:] = 0.0, 0.0
    dx, dy, dz = point[0] - camera[state.X], point[1] - camera[state.Y], point[2] - camera[state.Z]
    px = camera[state.R11] * dx + camera[state.R12] * dy + camera[state.R13] * dz
    py = camera[state.R21] * dx + camera[state.R22] * dy + camera[state.R23] * dz
    pz = camera[state.R31] * dx + camera[state.R32] * dy + camera[state.R33] * dz
    if pz <= 1e-6:
        return 0.0, 0.0, False
    inverse = 1.0 / pz
    x, y = px * inverse, py * inverse
    r2 = x * x + y * y
    xd, yd, xx, xy, yy = bend_with_slopes(_lens(camera), x, y, 1.0)
    c, stretch, shear = camera[state.C], 1.0 + camera[state.AFFINITY], camera[state.SHEAR]
    # pixels by plane coordinates
    ux, uy = c * (stretch * xx + shear * xy), c * (stretch * xy + shear * yy)
    vx, vy = c * xy, c * yy
    # pixels by coordinates in the camera
    ucx, ucy, ucz = ux * inverse, uy * inverse, -(ux * x + uy * y) * inverse
    vcx, vcy, vcz = vx * inverse, vy * inverse, -(vx * x + vy * y) * inverse
    by_camera[0, unknown.TURN_X], by_camera[1, unknown.TURN_X] = py * ucz - pz * ucy, py * vcz - pz * vcy
    by_camera[0, unknown.TURN_Y], by_camera[1, unknown.TURN_Y] = pz * ucx - px * ucz, pz * vcx - px * vcz
    by_camera[0, unknown.TURN_Z], by_camera[1, unknown.TURN_Z] = px * ucy - py * ucx, px * vcy - py * vcx
    for k in range(3):
        by_point[0, k] = ucx * camera[state.R11 + k] + ucy * camera[state.R21 + k] + ucz * camera[state.R31 + k]
        by_point[1, k] = vcx * camera[state.R11 + k] + vcy * camera[state.R21 + k] + vcz * camera[state.R31 + k]
        by_camera[0, unknown.X + k], by_camera[1, unknown.X + k] = -by_point[0, k], -by_point[1, k]
    by_camera[0, unknown.C], by_camera[1, unknown.C] = stretch * xd + shear * yd, yd
    by_camera[0, unknown.CX] = by_camera[1, unknown.CY] = 1.0
    by_camera[0, unknown.AFFINITY], by_camera[0, unknown.SHEAR] = c * xd, c * yd
    k4, k5, k6 = camera[state.K4], camera[state.K5], camera[state.K6]
    power = r2 / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    for k in (unknown.K1, unknown.K2, unknown.K3):
        by_camera[0, k] = c * (stretch * x + shear * y) * power
        by_camera[1, k] = c * y * power
        power *= r2
    xp1, yp1 = 2.0 * x * y, r2 + 2.0 * y * y
    xp2, yp2 = r2 + 2.0 * x * x, 2.0 * x * y
    by_camera[0, unknown.P1], by_camera[1, unknown.P1] = c * (stretch * xp1 + shear * yp1), c * yp1
    by_camera[0, unknown.P2], by_camera[1, unknown.P2] = c * (stretch * xp2 + shear * yp2), c * yp2
    by_camera[0, unknown.DELAY], by_camera[1, unknown.DELAY] = velocity[0], velocity[1]
    u = c * (stretch * xd + shear * yd) + camera[state.CX] + camera[state.DELAY] * velocity[0]
    return u, c * yd + camera[state.CY] + camera[state.DELAY] * velocity[1], True


@compiled
def _lens(camera: Array) -> LensTerms:
    return (
        camera[state.K1],
        camera[state.K2],
        camera[state.P1],
        camera[state.P2],
        camera[state.K3],
        camera[state.K4],
        camera[state.K5],
        camera[state.K6],
    )
