#include "skins/smooth_contours.hpp"

#include <algorithm>
#include <cmath>

#include "projection.hpp"

namespace bodytrack::skins {

namespace {

using namespace rows::camera;

// Of the difference that gives the direction of a contour in the image, metres.
constexpr double STEP_M = 1e-3;

// Lengths are no smaller, squared: nothing is divided by 0.
constexpr double LEAST = 1e-12;

}  // namespace

bool turns_away(const Posed &posed, Index p, Index q, Index r, const double *camera) {
    double aa = 0.0, ab = 0.0, bb = 0.0, av = 0.0, bv = 0.0;
    for (int k = 0; k < 3; k++) {
        const double a = posed.points(q, k) - posed.points(p, k), b = posed.points(r, k) - posed.points(p, k);
        const double sight = posed.points(p, k) - camera[CENTRE_X + k];
        aa += a * a;
        ab += a * b;
        bb += b * b;
        av += a * sight;
        bv += b * sight;
    }
    // the line of sight in the plane of the face, in its two edges, times a positive number
    const double one = bb * av - ab * bv, other = aa * bv - ab * av;
    return one * (posed.facing[q] - posed.facing[p]) + other * (posed.facing[r] - posed.facing[p]) < 0.0;
}

Surface cross_edge(const Posed &posed, Index i, Index j) {
    const float t = posed.facing[i] / (posed.facing[i] - posed.facing[j]);
    Surface at;
    double length2 = 0.0, turn = 0.0;
    for (int k = 0; k < 3; k++) {
        const float move = posed.points(j, k) - posed.points(i, k), change = posed.normals(j, k) - posed.normals(i, k);
        at.point[k] = posed.points(i, k) + t * move;
        at.normal[k] = posed.normals(i, k) + t * change;
        length2 += at.normal[k] * at.normal[k];
        turn += move * change;
    }
    const double scale = 1.0 / std::sqrt(std::max(length2, LEAST));
    for (int k = 0; k < 3; k++) {
        at.normal[k] *= scale;
        at.point[k] += 0.5 * t * (1.0 - t) * turn * scale * at.normal[k];
    }
    return at;
}

Surface bent(const Surface &one, const Surface &other, double t) {
    Surface at;
    double turn = 0.0;
    for (int k = 0; k < 3; k++) {
        turn += (other.normal[k] - one.normal[k]) * (other.point[k] - one.point[k]);
        at.normal[k] = one.normal[k] + t * (other.normal[k] - one.normal[k]);
    }
    for (int k = 0; k < 3; k++)
        at.point[k] = one.point[k] + t * (other.point[k] - one.point[k]) + 0.5 * t * (1.0 - t) * turn * at.normal[k];
    return at;
}

void image_normal(const double *camera, const Surface &at, double &nu, double &nv) {
    const auto &[x, y, z] = at.point;
    const auto &n = at.normal;
    const double dx = x - camera[CENTRE_X], dy = y - camera[CENTRE_Y], dz = z - camera[CENTRE_Z];
    const double a = n[1] * dz - n[2] * dy, b = n[2] * dx - n[0] * dz, c = n[0] * dy - n[1] * dx;
    const double step = STEP_M / std::sqrt(std::max(a * a + b * b + c * c, LEAST));
    const Image back = project_point(camera, x - step * a, y - step * b, z - step * c);
    const Image ahead = project_point(camera, x + step * a, y + step * b, z + step * c);
    const double du = ahead.u - back.u, dv = ahead.v - back.v, length = std::sqrt(std::max(du * du + dv * dv, LEAST));
    nu = -dv / length;
    nv = du / length;
}

}  // namespace bodytrack::skins
