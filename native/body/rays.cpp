#include "body/rays.hpp"

#include <algorithm>
#include <cmath>

#include "rows.hpp"

namespace bodytrack::body {

namespace {

using namespace rows;

// Of a ray through the sphere around a part; between two of them the crossing is halved so often: 0.1 mm at 1 m.
constexpr int STEPS = 32, HALVINGS = 10;

// Distance of the places that a gradient is taken between, metres.
constexpr double BESIDE_M = 1e-4;

// Inside-outside function of a part (7,) at a point in its frame, metres; the twin is
// `tracker.foundation.geometry.superquadrics.inside_outside`.
double inside_outside(const double *shape, double x, double y, double z) {
    using namespace superquadric;
    const double height = z / shape[A3], clamped = std::min(std::max(height, -1.0), 1.0);
    const double u = std::fabs(x / (shape[A1] * (1.0 + shape[K1] * clamped)));
    const double v = std::fabs(y / (shape[A2] * (1.0 + shape[K2] * clamped)));
    const double e1 = shape[E1], e2 = shape[E2];
    return std::pow(std::pow(u, 2.0 / e2) + std::pow(v, 2.0 / e2), e2 / e1) + std::pow(std::fabs(height), 2.0 / e1);
}

// A ray in the frame of a part: it starts at o, metres, and goes along the unit vector d.
struct Ray {
    double o[3], d[3];

    double inside(const double *shape, double t) const {
        return inside_outside(shape, o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]);
    }
};

Ray in_part_frame(const double *placement, const double *centre, const double *ray) {
    Ray turned{};
    for (int k = 0; k < 3; k++) {
        const double start = centre[k] - placement[4 * k + 3];
        for (int r = 0; r < 3; r++) {
            turned.o[r] += placement[4 * k + r] * start;
            turned.d[r] += placement[4 * k + r] * ray[k];
        }
    }
    return turned;
}

// Where along a ray it first meets a part, metres; whether it does.
bool meets(const Ray &ray, const double *shape, double &near) {
    using namespace superquadric;
    const double wide = shape[A1] * (1.0 + std::fabs(shape[K1])), deep = shape[A2] * (1.0 + std::fabs(shape[K2]));
    const double radius = std::sqrt(wide * wide + deep * deep + shape[A3] * shape[A3]), step = 2.0 * radius / STEPS;
    const double along = ray.o[0] * ray.d[0] + ray.o[1] * ray.d[1] + ray.o[2] * ray.d[2];
    const double start = std::max(-along - radius, 0.0);
    int i = 1;
    for (near = start + step; i <= STEPS && !(ray.inside(shape, near) < 1.0); i++) near = start + step * (i + 1);
    if (i > STEPS) return false;
    double far = near - step;
    for (int k = 0; k < HALVINGS; k++) {
        const double half = 0.5 * (near + far);
        (ray.inside(shape, half) < 1.0 ? near : far) = half;
    }
    return true;
}

}  // namespace

void meet_parts(Array<const double, 3> placements, Array<const double, 2> shapes, const double *centre,
                Array<const double, 2> rays, Array<const Index, 1> parts, Array<double, 2> found) {
    for (Index n = 0; n < parts.size(); n++) {
        const double *shape = shapes[parts[n]].data;
        const Ray ray = in_part_frame(placements[parts[n]].data, centre, rays[n].data);
        double *row = found[n].data, near;
        std::fill_n(row, met_place::N_COLUMNS, 0.0);
        if (!meets(ray, shape, near)) continue;
        double place[3], normal[3], square = 0.0, facing = 0.0;
        for (int k = 0; k < 3; k++) place[k] = ray.o[k] + near * ray.d[k];
        for (int k = 0; k < 3; k++) {
            double above[3] = {place[0], place[1], place[2]}, below[3] = {place[0], place[1], place[2]};
            above[k] += BESIDE_M;
            below[k] -= BESIDE_M;
            normal[k] = inside_outside(shape, above[0], above[1], above[2]) -
                        inside_outside(shape, below[0], below[1], below[2]);
            square += normal[k] * normal[k];
            facing -= normal[k] * ray.d[k];
        }
        const double length = std::max(std::sqrt(square), 1e-12);
        for (int k = 0; k < 3; k++) {
            row[met_place::X + k] = place[k];
            row[met_place::NORMAL_X + k] = normal[k] / length;
            row[met_place::RAY_X + k] = ray.d[k];
        }
        row[met_place::FACING] = facing / length;
    }
}

}  // namespace bodytrack::body
