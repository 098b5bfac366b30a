#include "adjustment/projecting.hpp"

#include <initializer_list>

#include "lens.hpp"

namespace bodytrack::adjustment {

namespace {

namespace of = rows::bundle_camera;
namespace by = rows::bundle_unknown;

// Nearer to the camera's plane than this, metres, a point has no image.
constexpr double NEAREST = 1e-6;

Lens<double> lens_of(const double *camera) {
    return {camera[of::K1], camera[of::K2], camera[of::P1], camera[of::P2],
            camera[of::K3], camera[of::K4], camera[of::K5], camera[of::K6]};
}

}  // namespace

Pixel project_with_slopes(const double *camera, const double *point, const double *velocity, PixelSlopes &slopes) {
    slopes = {};
    auto &by_camera = slopes.by_camera;
    auto &by_point = slopes.by_point;
    const double dx = point[0] - camera[of::X], dy = point[1] - camera[of::Y], dz = point[2] - camera[of::Z];
    const double px = camera[of::R11] * dx + camera[of::R12] * dy + camera[of::R13] * dz;
    const double py = camera[of::R21] * dx + camera[of::R22] * dy + camera[of::R23] * dz;
    const double pz = camera[of::R31] * dx + camera[of::R32] * dy + camera[of::R33] * dz;
    if (pz <= NEAREST) return {};
    const double inverse = 1.0 / pz, x = px * inverse, y = py * inverse, r2 = x * x + y * y;
    const Bent<double> bent = bend_with_slopes(lens_of(camera), x, y);
    const double c = camera[of::C], stretch = 1.0 + camera[of::AFFINITY], shear = camera[of::SHEAR];
    // pixels by plane coordinates
    const double ux = c * (stretch * bent.aa + shear * bent.ab), uy = c * (stretch * bent.ab + shear * bent.bb);
    const double vx = c * bent.ab, vy = c * bent.bb;
    // pixels by coordinates in the camera
    const double in_camera[2][3] = {{ux * inverse, uy * inverse, -(ux * x + uy * y) * inverse},
                                    {vx * inverse, vy * inverse, -(vx * x + vy * y) * inverse}};
    for (int axis = 0; axis < 2; axis++) {
        const double cx = in_camera[axis][0], cy = in_camera[axis][1], cz = in_camera[axis][2];
        by_camera[axis][by::TURN_X] = py * cz - pz * cy;
        by_camera[axis][by::TURN_Y] = pz * cx - px * cz;
        by_camera[axis][by::TURN_Z] = px * cy - py * cx;
        for (int k = 0; k < 3; k++) {
            by_point[axis][k] = cx * camera[of::R11 + k] + cy * camera[of::R21 + k] + cz * camera[of::R31 + k];
            by_camera[axis][by::X + k] = -by_point[axis][k];
        }
        by_camera[axis][by::DELAY] = velocity[axis];
    }
    by_camera[0][by::CX] = by_camera[1][by::CY] = 1.0;
    by_camera[0][by::AFFINITY] = c * bent.u;
    by_camera[0][by::SHEAR] = c * bent.v;
    // of an unknown that moves the image by so much in the plane of the lens
    const auto moving = [&](int unknown, double u, double v, double scale) {
        by_camera[0][unknown] = scale * (stretch * u + shear * v);
        by_camera[1][unknown] = scale * v;
    };
    moving(by::C, bent.u, bent.v, 1.0);
    double power = r2 / (1.0 + r2 * (camera[of::K4] + r2 * (camera[of::K5] + r2 * camera[of::K6])));
    for (const int k : {by::K1, by::K2, by::K3}) {
        moving(k, x * power, y * power, c);
        power *= r2;
    }
    moving(by::P1, 2.0 * x * y, r2 + 2.0 * y * y, c);
    moving(by::P2, r2 + 2.0 * x * x, 2.0 * x * y, c);
    const double delay = camera[of::DELAY];
    return {c * (stretch * bent.u + shear * bent.v) + camera[of::CX] + delay * velocity[0],
            c * bent.v + camera[of::CY] + delay * velocity[1], true};
}

}  // namespace bodytrack::adjustment
