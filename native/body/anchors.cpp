#include "body/anchors.hpp"

#include <algorithm>
#include <cmath>

namespace bodytrack::body {

namespace {

using namespace rows;
namespace at = rows::carried_place;

// What is nearer to the camera has no image, metres.
constexpr double NEAREST_M = 0.1;

// A vector of a part in the world.
Point turned(const double *placement, const double *v) {
    const auto row = [&](int r) { return placement[4 * r] * v[0] + placement[4 * r + 1] * v[1] + placement[4 * r + 2] * v[2]; };
    return {row(0), row(1), row(2)};
}

// Place n in the world.
Point placed(const double *placement, const Carried &carried, Index n) {
    const Point place = turned(placement, carried.places[n].data);
    return {place.x + placement[3], place.y + placement[7], place.z + placement[11]};
}

double dot(const Along &a, const Point &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
double square(const Along &a) { return a.x * a.x + a.y * a.y + a.z * a.z; }

}  // namespace

void gaps_of(Array<const double, 4> placements, Array<const double, 2> cameras, const Carried &carried, double most_m,
             Array<double, 2> gaps) {
    for (Index b = 0; b < placements.shape[0]; b++)
        for (Index n = 0; n < carried.size(); n++) {
            const double *camera = cameras[carried.views[n]].data;
            const auto [x, y, z] = placed(placements[b][carried.parts[n]].data, carried, n);
            const Image image = project_point(camera, x, y, z);
            const double most = most_m * camera[camera::FX] / std::max(image.depth, NEAREST_M);
            const double off = std::hypot(image.u - carried.pixels(n, 0), image.v - carried.pixels(n, 1));
            gaps(b, n) = image.depth > NEAREST_M ? std::min(off, most) : most;
        }
}

void residuals_of(Array<const double, 3> placements, Array<const double, 2> cameras, const Carried &carried,
                  double slide_m, Array<double, 2> found) {
    for (Index n = 0; n < carried.size(); n++) {
        const double *camera = cameras[carried.views[n]].data, *placement = placements[carried.parts[n]].data;
        const auto [x, y, z] = placed(placement, carried, n);
        double *row = found[n].data;
        std::fill_n(row, at::N_COLUMNS, 0.0);
        if (project_point(camera, x, y, z).depth <= NEAREST_M) {
            row[at::VARIANCE] = 1.0;
            row[at::FACING] = -1.0;
            continue;
        }
        const Along u = project_along(camera, x, y, z, 1.0, 0.0), w = project_along(camera, x, y, z, 0.0, 1.0);
        row[at::U] = u.u - carried.pixels(n, 0);
        row[at::W] = w.v - carried.pixels(n, 1);
        const Point ray = turned(placement, carried.rays[n].data), normal = turned(placement, carried.normals[n].data);
        const double deep = dot(u, ray) * dot(u, ray) + dot(w, ray) * dot(w, ray), size = square(u) + square(w);
        const double spread = 0.5 * (deep * carried.depths_m[n] * carried.depths_m[n] + size * slide_m * slide_m);
        row[at::VARIANCE] = spread + carried.variances[n];
        const double cx = camera[camera::CENTRE_X] - x, cy = camera[camera::CENTRE_Y] - y,
                     cz = camera[camera::CENTRE_Z] - z;
        row[at::FACING] = (normal.x * cx + normal.y * cy + normal.z * cz) / std::sqrt(cx * cx + cy * cy + cz * cz);
        row[at::U_X] = u.x;
        row[at::U_Y] = u.y;
        row[at::U_Z] = u.z;
        row[at::W_X] = w.x;
        row[at::W_Y] = w.y;
        row[at::W_Z] = w.z;
    }
}

Sums anchor_equations(Array<const double, 3> placements, const Carried &carried, Array<const double, 2> found,
                      Array<const double, 1> weights, const Motion &motion, Array<double, 2> matrix,
                      Array<double, 1> vector) {
    std::vector<End> sums_of(motion.moves.shape[1]);
    Sums sums;
    for (Index n = 0; n < carried.size(); n++) {
        const Index end = motion.ends[carried.parts[n]];
        const double weight = weights[n];
        if (!(weight > 0.0) || end < 0) continue;
        const Point point = placed(placements[carried.parts[n]].data, carried, n);
        const double *row = found[n].data;
        const auto add = [&](double residual, const double *gradient) {
            sums_of[end].add(point, {gradient[0], gradient[1], gradient[2]}, weight * residual, weight);
            sums.squares += weight * residual * residual;
            sums.total += weight;
        };
        add(row[at::U], row + at::U_X);
        add(row[at::W], row + at::W_X);
    }
    chain(sums_of, motion, matrix, vector);
    return sums;
}

}  // namespace bodytrack::body
