#include "contours/solids.hpp"

#include <algorithm>

#include "projection.hpp"

namespace bodytrack::contours {

namespace {

// Below this depth, metres, a part counts as not wholly before the camera.
constexpr double LEAST_DEPTH = 0.05;

double length(double x, double y, double z) { return std::sqrt(x * x + y * y + z * z); }

}  // namespace

void place_solid(const double *placement, const Parts &parts, Index p, Solid &s) {
    using namespace rows::superquadric;
    const double *shape = parts.shapes[p].data;
    for (int r = 0; r < 3; r++) {
        double shift = 0.0;
        const double inverse = 1.0 / shape[r];
        for (int k = 0; k < 3; k++) {
            s.m[r][k] = float(placement[4 * k + r] * inverse);
            s.rotation[r][k] = float(placement[4 * r + k]);
            shift -= placement[4 * k + r] * placement[4 * k + 3];
        }
        s.m[r][3] = float(shift * inverse);
        s.position[r] = float(placement[4 * r + 3]);
    }
    const double e1 = shape[E1], e2 = shape[E2];
    s.reach = float(parts.bounds(1, p));
    s.k1 = float(shape[K1]);
    s.k2 = float(shape[K2]);
    s.around = float(2.0 / e2);
    s.along = float(e2 / e1);
    s.upward = float(2.0 / e1);
}

void place_solids(Array<const double, 3> placements, const Parts &parts, Solids &solids) {
    for (Index p = 0; p < parts.size(); p++) place_solid(placements[p].data, parts, p, solids[p]);
}

void view_solid(const Parts &parts, Index p, const double *camera, double margin_m, Solid &s) {
    using namespace rows::camera;
    const double *shape = parts.shapes[p].data;
    for (int r = 0; r < 3; r++) {
        s.eye[r] = float(s.m[r][0] * camera[CENTRE_X] + s.m[r][1] * camera[CENTRE_Y] + s.m[r][2] * camera[CENTRE_Z] +
                         s.m[r][3]);
        s.camera[r] = float(s.eye[r] * shape[r]);
    }
    const double x = s.position[0], y = s.position[1], z = s.position[2], half = shape[rows::superquadric::A3];
    const double ax = half * s.rotation[0][2], ay = half * s.rotation[1][2], az = half * s.rotation[2][2];
    const Image low = project_point(camera, x - ax, y - ay, z - az), high = project_point(camera, x + ax, y + ay, z + az);
    const double width = parts.bounds(2, p) + margin_m, depth = std::min(low.depth, high.depth) - width;
    const double du = high.u - low.u, dv = high.v - low.v, square = du * du + dv * dv + 1e-9;
    s.start_u = float(low.u);
    s.start_v = float(low.v);
    s.share_u = float(du / square);
    s.share_v = float(dv / square);
    s.axis_u = float(du);
    s.axis_v = float(dv);
    // Off the axis of a camera a width is drawn out by the ratio of distance and depth; else a tenth on top covers
    // perspective and lens distortion across the width of a part.
    double drawn_out = 1.1;
    if (depth > LEAST_DEPTH) {
        const double cx = x - camera[CENTRE_X], cy = y - camera[CENTRE_Y], cz = z - camera[CENTRE_Z];
        drawn_out = std::max(drawn_out, length(cx - ax, cy - ay, cz - az) / low.depth);
        drawn_out = std::max(drawn_out, length(cx + ax, cy + ay, cz + az) / high.depth);
    }
    const double wide = drawn_out * std::max(camera[FX], camera[FY]) * width / std::max(depth, LEAST_DEPTH);
    s.width2 = float(wide * wide);
    s.least_u = float(std::min(low.u, high.u) - wide);
    s.most_u = float(std::max(low.u, high.u) + wide);
    s.least_v = float(std::min(low.v, high.v) - wide);
    s.most_v = float(std::max(low.v, high.v) + wide);
    s.nearest = depth > LEAST_DEPTH ? float(depth) : -1.0f;
}

void view_solids(const Parts &parts, const double *camera, double margin_m, Solids &solids) {
    for (Index p = 0; p < parts.size(); p++) view_solid(parts, p, camera, margin_m, solids[p]);
}

}  // namespace bodytrack::contours
