#include "body/self_collision.hpp"

#include <algorithm>
#include <cmath>

#include "contours/solids.hpp"
#include "rows.hpp"

namespace bodytrack::body {

namespace {

using namespace rows;
using contours::Solid;

// Along the middle 80 % of an axis, in half extents: joints overlap by design.
constexpr double PLACES[] = {-0.8, -0.4, 0.0, 0.4, 0.8};

// Of a part's radius: flesh and clothes give way, and shapes are good to a centimetre or two. With every point counting in
// full a hand on the hip cost 0.4 px, and the forearm was put behind the back in 18 of 80 frames.
constexpr double SHALLOW = 0.25;

// Points on the axis of a part inside another one, by their depth.
double sum_inside(const Solid &part, double half, const Solid &other, const double *shape) {
    double sum = 0.0;
    for (const double place : PLACES) {
        const double t = half * place;
        double u, v, w;
        contours::in_part(other, part.position[0] + t * part.rotation[0][2], part.position[1] + t * part.rotation[1][2],
                          part.position[2] + t * part.rotation[2][2], u, v, w);
        if (contours::inside_value(other, float(u), float(v), float(w)) < 1.0f)
            sum += std::min(depth(shape, u, v, w) / SHALLOW, 1.0);
    }
    return sum;
}

}  // namespace

double depth(const double *shape, double u, double v, double w) {
    using namespace superquadric;
    const double e1 = shape[E1], e2 = shape[E2];
    const double across = std::pow(std::fabs(u / (1.0 + shape[K1] * w)), 2.0 / e2) +
                          std::pow(std::fabs(v / (1.0 + shape[K2] * w)), 2.0 / e2);
    const double room = 1.0 - std::pow(std::fabs(w), 2.0 / e1);
    if (room <= 0.0) return 0.0;
    return std::max(1.0 - std::pow(std::pow(across, e2 / e1) / room, 0.5 * e1), 0.0);
}

void sum_collisions(Array<const double, 4> placements, Array<const double, 2> shapes, Array<const Index, 2> pairs,
                    Array<double, 1> sums) {
    const Index n_parts = shapes.shape[0];
    const std::vector<double> bounds(3 * n_parts, 1.0);
    const contours::Parts parts{shapes, {bounds.data(), {3, n_parts}}};
    contours::Solids solids(n_parts);
    for (Index b = 0; b < placements.shape[0]; b++) {
        contours::place_solids(placements[b], parts, solids);
        sums[b] = 0.0;
        for (Index i = 0; i < pairs.shape[0]; i++) {
            const Index p = pairs(i, 0), q = pairs(i, 1);
            sums[b] += sum_inside(solids[p], shapes(p, superquadric::A3), solids[q], shapes[q].data);
            sums[b] += sum_inside(solids[q], shapes(q, superquadric::A3), solids[p], shapes[p].data);
        }
    }
}

}  // namespace bodytrack::body
