#include "images/profiles.hpp"

#include <algorithm>
#include <cmath>

namespace bodytrack::images {

namespace {

// A Sobel filter counts a grey level per pixel eight times.
constexpr float PER_SLOPE = 1.0f / 8.0f;

// Half a pixel's diagonal: an edge farther away belongs to another pixel.
constexpr double FARTHEST = 0.71;

}  // namespace

// A parabola goes through the slope, along the gradient's direction, of the pixel and its two neighbours in the row or
// column that the gradient is nearest to; its vertex lies on the edge, whose nearest point is the position. Neighbours
// interpolated along the gradient itself would be smoother than the pixel and draw the vertex to it: twice the error on
// slanted edges.
void edge_profile(Array<const std::int32_t, 2> points, const Slopes &slopes, Array<float, 2> edges,
                  Array<float, 2> directions) {
    const Index height = slopes.dx.shape[0], width = slopes.dx.shape[1];
    for (Index i = 0; i < points.shape[0]; i++) {
        const Index x = points(i, 0), y = points(i, 1);
        const float gx = PER_SLOPE * float(slopes.dx(y, x)), gy = PER_SLOPE * float(slopes.dy(y, x));
        const double here = double(std::sqrt(gx * gx + gy * gy)) + 1e-9, ux = gx / here, uy = gy / here;
        double shift = 0.0;
        if (0 < x && x < width - 1 && 0 < y && y < height - 1) {
            const bool along_row = std::abs(ux) >= std::abs(uy);
            const Index dx = along_row ? 1 : 0, dy = along_row ? 0 : 1;
            const auto slope_at = [&](Index column, Index row) {
                return double(PER_SLOPE) * (slopes.dx(row, column) * ux + slopes.dy(row, column) * uy);
            };
            const double before = slope_at(x - dx, y - dy), after = slope_at(x + dx, y + dy);
            const double curvature = before - 2.0 * here + after;
            if (curvature < -1e-6) {
                const double vertex = 0.5 * (before - after) / curvature * (along_row ? ux : uy);
                shift = std::min(std::max(vertex, -FARTHEST), FARTHEST);
            }
        }
        edges(i, 0) = float(double(x) + shift * ux);
        edges(i, 1) = float(double(y) + shift * uy);
        directions(i, 0) = float(ux);
        directions(i, 1) = float(uy);
    }
}

}  // namespace bodytrack::images
