#include "pictures/rods.hpp"

#include <algorithm>

namespace bodytrack::pictures {

namespace {

// A rod seen from its end is a point.
constexpr float LEAST_PX2 = 1e-6f;

bool inside(const float *start, const float *way, float reach_px, const float *pixel) {
    float x = pixel[0] - start[0], y = pixel[1] - start[1];
    const float along = (x * way[0] + y * way[1]) / std::max(way[0] * way[0] + way[1] * way[1], LEAST_PX2);
    const float t = along < 0.0f ? 0.0f : along > 1.0f ? 1.0f : along;
    x -= t * way[0];
    y -= t * way[1];
    return x * x + y * y < reach_px * reach_px;
}

}  // namespace

void covered_by_rods(Array<const float, 3> starts, Array<const float, 3> ways, Array<const float, 2> reach_px,
                     Array<const float, 2> pixels, Array<double, 1> shares) {
    const Index n_parts = starts.shape[1], n = pixels.shape[0];
    for (Index b = 0; b < starts.shape[0]; b++) {
        const float *first = starts[b].data, *way = ways[b].data, *reach = reach_px[b].data;
        Index n_inside = 0;
        for (Index i = 0; i < n; i++)
            for (Index p = 0; p < n_parts; p++)
                if (inside(first + 2 * p, way + 2 * p, reach[p], pixels[i].data)) {
                    n_inside++;
                    break;
                }
        shares[b] = double(n_inside) / double(n);
    }
}

}  // namespace bodytrack::pictures
