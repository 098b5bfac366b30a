#include "projection.hpp"

#include <algorithm>
#include <limits>

namespace bodytrack {

double project_grid(const double *placement, Array<const float, 2> grid, const double *camera, Array<double, 2> pixels) {
    const Index n = pixels.shape[1], stride = grid.shape[1];
    double *u = pixels.data, *v = u + n, *depths = v + n;
    const double *m = placement;
    for (Index i = 0; i < n; i++) {
        const float *point = grid.data + stride * i;
        const double x = point[0], y = point[1], z = point[2];
        const Point seen = in_camera(camera, m[0] * x + m[1] * y + m[2] * z + m[3], m[4] * x + m[5] * y + m[6] * z + m[7],
                                     m[8] * x + m[9] * y + m[10] * z + m[11]);
        const double a = seen.x / seen.z, b = seen.y / seen.z;
        through_lens(camera, a, b, u[i], v[i]);
        depths[i] = beyond_reach(camera, a, b) ? 0.0 : seen.z;
    }
    double nearest = std::numeric_limits<double>::infinity();
    for (Index i = 0; i < n; i++) nearest = std::min(nearest, depths[i]);
    return nearest;
}

}  // namespace bodytrack
