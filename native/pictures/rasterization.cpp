#include "pictures/rasterization.hpp"

#include <algorithm>
#include <cmath>

#include "pictures/pixels.hpp"

namespace bodytrack::pictures {

namespace {

// Twice the area of triangles that are lines, px^2.
constexpr double LEAST_PX2 = 1e-12;

}  // namespace

void rasterize(Array<const double, 2> pixels, Array<const double, 1> depths, Array<const Index, 2> triangles,
               const Corner &origin, Array<float, 3> buffers) {
    const Index height = buffers.shape[0], width = buffers.shape[1];
    for (Index t = 0; t < triangles.shape[0]; t++) {
        const Index a = triangles(t, 0), b = triangles(t, 1), c = triangles(t, 2);
        const double left = double(origin.x), top = double(origin.y);
        const double ax = pixels(a, 0) - left, ay = pixels(a, 1) - top, bx = pixels(b, 0) - left, by = pixels(b, 1) - top;
        const double cx = pixels(c, 0) - left, cy = pixels(c, 1) - top;
        const double area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
        if (!(std::fabs(area) >= LEAST_PX2)) continue;
        const Index low_x = first_pixel(std::min({ax, bx, cx})), high_x = last_pixel(std::max({ax, bx, cx}), width);
        const Index low_y = first_pixel(std::min({ay, by, cy})), high_y = last_pixel(std::max({ay, by, cy}), height);
        const double za = 1.0 / depths[a], zb = 1.0 / depths[b], zc = 1.0 / depths[c];
        for (Index row = low_y; row <= high_y; row++)
            for (Index column = low_x; column <= high_x; column++) {
                const double x = double(column), y = double(row);
                const double u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area;
                const double v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area;
                const double w = 1.0 - u - v;
                if (u < 0.0 || v < 0.0 || w < 0.0) continue;
                const double near = u * za + v * zb + w * zc;
                float *buffer = &buffers(row, column, 0);
                if (!(near > buffer[0])) continue;
                buffer[0] = float(near);
                buffer[1] = float(t);
                buffer[2] = float(u * za / near);
                buffer[3] = float(v * zb / near);
            }
    }
}

}  // namespace bodytrack::pictures
