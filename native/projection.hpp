// Projection of single points, shared by the kernels; the twins are `Camera.project` and `Camera.project_jacobian`.
#pragma once
#include <algorithm>

#include "array.hpp"
#include "lens.hpp"

namespace bodytrack {

struct Point {
    double x, y, z;
};

// A world point in the frame of a packed camera, metres.
inline Point in_camera(const double *camera, double x, double y, double z) {
    using namespace rows::camera;
    return {camera[R11] * x + camera[R12] * y + camera[R13] * z + camera[TX],
            camera[R21] * x + camera[R22] * y + camera[R23] * z + camera[TY],
            camera[R31] * x + camera[R32] * y + camera[R33] * z + camera[TZ]};
}

// Pixel of a point of the plane z = 1 of the camera.
inline void through_lens(const double *camera, double a, double b, double &u, double &v) {
    using namespace rows::camera;
    double p, q;
    bend(Lens<double>(camera), a, b, p, q);
    u = camera[FX] * p + camera[SHEAR] * q + camera[CX];
    v = camera[FY] * q + camera[CY];
}

struct Image {
    double u = 0.0, v = 0.0, depth = 0.0;
};

// Image of a world point, and its depth in metres: 0 beyond the reach of the lens; pixel 0, 0 where not positive.
inline Image project_point(const double *camera, double x, double y, double z) {
    const Point seen = in_camera(camera, x, y, z);
    if (seen.z <= 1e-9) return {0.0, 0.0, seen.z};
    const double a = seen.x / seen.z, b = seen.y / seen.z;
    if (beyond_reach(camera, a, b)) return {};
    Image image;
    through_lens(camera, a, b, image.u, image.v);
    image.depth = seen.z;
    return image;
}

// Images of the points of a part, several at a time, for nothing branches; returns the least depth, metres. placement (16)
// world_from_part, metres; points (N, 3 or more) of the part, metres; pixels (3, N): of use only where all points lie before
// the camera; depths, metres, 0 beyond the reach of the lens.
template <class T>
inline double project_grid(const double *placement, Array<const T, 2> points, const double *camera, double *pixels) {
    const Index n = points.shape[0], stride = points.shape[1];
    double *u = pixels, *v = u + n, *depths = v + n;
    const double *m = placement;
    for (Index i = 0; i < n; i++) {
        const T *point = points.data + stride * i;
        const double x = point[0], y = point[1], z = point[2];
        const Point seen = in_camera(camera, m[0] * x + m[1] * y + m[2] * z + m[3], m[4] * x + m[5] * y + m[6] * z + m[7],
                                     m[8] * x + m[9] * y + m[10] * z + m[11]);
        const double a = seen.x / seen.z, b = seen.y / seen.z;
        through_lens(camera, a, b, u[i], v[i]);
        depths[i] = beyond_reach(camera, a, b) ? 0.0 : seen.z;
    }
    return *std::min_element(depths, depths + n);
}

struct Along {
    double u, v;
    // derivative of the position along the normal by the world point, px per metre
    double x, y, z;
};

// Pixel of a world point, and the derivative of its position along an image normal.
inline Along project_along(const double *camera, double x, double y, double z, double nu, double nv) {
    using namespace rows::camera;
    const Point seen = in_camera(camera, x, y, z);
    const double a = seen.x / seen.z, b = seen.y / seen.z;
    const Bent<double> bent = bend_with_slopes(Lens<double>(camera), a, b);
    // the normal in the distorted plane, then in the plane of the pinhole
    const double gu = nu * camera[FX], gw = nu * camera[SHEAR] + nv * camera[FY];
    const double ga = (gu * bent.aa + gw * bent.ab) / seen.z, gb = (gu * bent.ab + gw * bent.bb) / seen.z;
    const double gz = -(ga * a + gb * b);
    return {camera[FX] * bent.u + camera[SHEAR] * bent.v + camera[CX], camera[FY] * bent.v + camera[CY],
            ga * camera[R11] + gb * camera[R21] + gz * camera[R31],
            ga * camera[R12] + gb * camera[R22] + gz * camera[R32],
            ga * camera[R13] + gb * camera[R23] + gz * camera[R33]};
}

}  // namespace bodytrack
