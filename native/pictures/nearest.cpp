#include "pictures/nearest.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "pictures/pixels.hpp"
#include "projection.hpp"

namespace bodytrack::pictures {

namespace {

// Sides that rise by less are level: no row lies between their ends, px.
constexpr double LEVEL_PX = 1e-9;

// Where a corner of a triangle is in the pictures, px, and its inverse depth.
struct Vertex {
    double x, y, z;
};

// Inverse depth at the pictures' first pixel, and by how much it grows per px along x and y, 1 / m.
struct Plane {
    double base, along_x, along_y;
};

struct Pictures {
    Array<float, 2> depths;
    Array<std::int16_t, 2> parts;
};

// Draws a triangle of a part row by row; its corners come from top to bottom.
void draw(const Vertex &a, const Vertex &b, const Vertex &c, const Plane &plane, std::int16_t part,
          const Pictures &pictures) {
    const Index height = pictures.depths.shape[0], width = pictures.depths.shape[1];
    const double whole = (c.x - a.x) / std::max(c.y - a.y, LEVEL_PX), upper = (b.x - a.x) / std::max(b.y - a.y, LEVEL_PX);
    const double lower = (c.x - b.x) / std::max(c.y - b.y, LEVEL_PX);
    const Index bottom = last_pixel(c.y, height);
    for (Index row = first_pixel(a.y); row <= bottom; row++) {
        const double y = double(row), one = a.x + whole * (y - a.y);
        const double other = y < b.y ? a.x + upper * (y - a.y) : b.x + lower * (y - b.y);
        const Index last = last_pixel(std::max(one, other), width);
        float *depths = pictures.depths[row].data;
        std::int16_t *parts = pictures.parts[row].data;
        for (Index x = first_pixel(std::min(one, other)); x <= last; x++) {
            const float inverse = float(plane.base + plane.along_x * double(x) + plane.along_y * y);
            // of two parts in one place the first one, in whatever order they are drawn
            if (inverse > depths[x] || (inverse == depths[x] && part < parts[x])) {
                depths[x] = inverse;
                parts[x] = part;
            }
        }
    }
}

}  // namespace

void project_surfaces(Array<const double, 3> placements, Array<const double, 3> surfaces, Array<const bool, 1> wanted,
                      const double *camera, Array<double, 3> seen) {
    const Index n = surfaces.shape[1];
    for (Index p = 0; p < wanted.size(); p++) {
        double *pixels = seen[p].data, *depths = pixels + 2 * n;
        if (!wanted[p] || project_grid(placements[p].data, surfaces[p], camera, pixels) < NEAREST_M)
            std::fill_n(pixels, 3 * n, std::numeric_limits<double>::quiet_NaN());
        else
            for (Index i = 0; i < n; i++) depths[i] = 1.0 / depths[i];
    }
}

void draw_nearest(Array<const double, 3> seen, Array<const Index, 2> triangles, const Corner &corner,
                  Array<float, 2> depths, Array<std::int16_t, 2> parts) {
    for (Index p = 0; p < seen.shape[0]; p++) {
        const auto of_part = seen[p];
        if (seen.shape[2] == 0 || std::isnan(of_part(0, 0))) continue;
        const auto vertex = [&](Index i) {
            return Vertex{of_part(0, i) - double(corner.x), of_part(1, i) - double(corner.y), of_part(2, i)};
        };
        for (Index t = 0; t < triangles.shape[0]; t++) {
            Vertex a = vertex(triangles(t, 0)), b = vertex(triangles(t, 1)), c = vertex(triangles(t, 2));
            const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            if (!(area < 0.0)) continue;  // y goes down in images: what is anticlockwise there is turned away
            const double along_x = ((b.z - a.z) * (c.y - a.y) - (c.z - a.z) * (b.y - a.y)) / area;
            const double along_y = ((c.z - a.z) * (b.x - a.x) - (b.z - a.z) * (c.x - a.x)) / area;
            const Plane plane{a.z - along_x * a.x - along_y * a.y, along_x, along_y};
            // from top to bottom
            if (b.y < a.y) std::swap(a, b);
            if (c.y < b.y) {
                std::swap(b, c);
                if (b.y < a.y) std::swap(a, b);
            }
            draw(a, b, c, plane, std::int16_t(p), {depths, parts});
        }
    }
}

}  // namespace bodytrack::pictures
