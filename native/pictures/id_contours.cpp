#include "pictures/id_contours.hpp"

#include <algorithm>
#include <cmath>

#include "lens.hpp"

namespace bodytrack::pictures {

namespace {

using namespace rows;

// Squared radius of the window, px^2; a pixel's weight falls from 1 at its centre to 0 at this distance.
constexpr double WINDOW_PX2 = 12.0;

// Share of the window that a straight contour through its middle gains in a pixel.
constexpr double SHARE_PER_PX = 0.245;

// A surface may bend away by this much between the last pixel's centre and the contour, metres.
constexpr double DEEPEST_M = 0.1;

// Behind a part that has nothing behind it, metres.
constexpr double FAR_M = 1e9;

// Taper and exponents of a part; the motion stands before them.
enum Column { K1 = 12, K2, AROUND, ALONG, UPWARD };

// What a pixel is to a part.
enum Side { NEITHER, INSIDE, OUTSIDE };

// A pixel that shows a part at a depth, metres.
struct Here {
    Index x, y, part;
    float depth;
};

// The contour beside a pixel: its unit normal, and its distance from the pixel's centre, px.
struct Edge {
    double nx, ny, beyond;
};

bool within_picture(const IdPicture &picture, Index x, Index y) {
    return x >= 0 && y >= 0 && y < picture.ids.shape[0] && x < picture.ids.shape[1];
}

// What a pixel of the picture is to a part; unpainted surroundings are background.
Side side_of(const IdPicture &picture, Index x, Index y, const Here &here) {
    const Index u = x + picture.left, v = y + picture.top;
    if (u < 0 || v < 0 || u >= picture.image_width || v >= picture.image_height) return NEITHER;
    if (!within_picture(picture, x, y) || picture.ids(y, x) < 0) return OUTSIDE;
    if (picture.ids(y, x) == here.part) return INSIDE;
    return picture.depths(y, x) > here.depth ? OUTSIDE : NEITHER;
}

// How far behind the pixel its nearest farther neighbour lies, metres; -1 for a pixel that is on no contour.
double gap_behind(const IdPicture &picture, const Here &here) {
    double gap = FAR_M;
    bool found = false;
    constexpr Index steps[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    for (const auto &[dx, dy] : steps) {
        const Index x = here.x + dx, y = here.y + dy;
        if (side_of(picture, x, y, here) != OUTSIDE) continue;
        found = true;
        if (within_picture(picture, x, y) && picture.ids(y, x) >= 0)
            gap = std::min(gap, double(picture.depths(y, x) - here.depth));
    }
    return found ? gap : -1.0;
}

Edge edge_beside(const IdPicture &picture, const Here &here) {
    double weights[3] = {}, xs[3] = {}, ys[3] = {};
    for (int dy = -3; dy <= 3; dy++)
        for (int dx = -3; dx <= 3; dx++) {
            const double weight = 1.0 - (dx * dx + dy * dy) / WINDOW_PX2;
            if (weight <= 0.0) continue;
            const Side side = side_of(picture, here.x + dx, here.y + dy, here);
            weights[side] += weight;
            xs[side] += weight * dx;
            ys[side] += weight * dy;
        }
    const double inside = weights[INSIDE], outside = weights[OUTSIDE];
    const double nx = xs[OUTSIDE] / outside - xs[INSIDE] / inside, ny = ys[OUTSIDE] / outside - ys[INSIDE] / inside;
    const double length = std::sqrt(nx * nx + ny * ny);
    if (length < 1e-3) return {0.0, 1.0, 0.5};
    const double beyond = (inside / (inside + outside) - 0.5) / SHARE_PER_PX;
    return {nx / length, ny / length, std::min(std::max(beyond, 0.0), 1.0)};
}

// Depth at the contour, metres: a round surface falls away with the root of the distance from its contour.
double depth_there(const IdPicture &picture, const Here &here, const Edge &edge) {
    const Index dx = Index(std::nearbyint(-edge.nx)), dy = Index(std::nearbyint(-edge.ny));
    const Index x = here.x + dx, y = here.y + dy;
    if (!within_picture(picture, x, y) || picture.ids(y, x) != here.part) return here.depth;
    const double near = std::sqrt(edge.beyond), far = std::sqrt(edge.beyond - dx * edge.nx - dy * edge.ny);
    const double fall = double(here.depth - picture.depths(y, x)) * near / std::max(far - near, 1e-3);
    return here.depth + std::min(std::max(fall, 0.0), DEEPEST_M);
}

// World point of a pixel at a depth, and world normal of the plane through the contour and the camera.
struct Lifted {
    double point[3], normal[3];
};

Lifted lift(const double *camera, double u, double v, const Edge &edge, double depth) {
    using namespace rows::camera;
    double a, b;
    undistort(camera, u, v, a, b);
    const double sx = camera[FX] * edge.nx, sy = camera[SHEAR] * edge.nx + camera[FY] * edge.ny;
    const Bent<double> bent = bend_with_slopes(Lens<double>(camera), a, b);
    const double nx = bent.aa * sx + bent.ab * sy, ny = bent.ab * sx + bent.bb * sy, nz = -(nx * a + ny * b);
    const double scale = 1.0 / std::sqrt(nx * nx + ny * ny + nz * nz);
    const double cx = a * depth - camera[TX], cy = b * depth - camera[TY], cz = depth - camera[TZ];
    Lifted lifted;
    for (int k = 0; k < 3; k++) {
        lifted.point[k] = camera[R11 + k] * cx + camera[R21 + k] * cy + camera[R31 + k] * cz;
        lifted.normal[k] = scale * (camera[R11 + k] * nx + camera[R21 + k] * ny + camera[R31 + k] * nz);
    }
    return lifted;
}

// Whether a world point lies inside a part (17,).
bool encloses(const double *s, double x, double y, double z) {
    const double w = s[8] * x + s[9] * y + s[10] * z + s[11];
    if (std::fabs(w) > 1.0) return false;
    const double u = std::fabs((s[0] * x + s[1] * y + s[2] * z + s[3]) / (1.0 + s[K1] * w));
    const double v = std::fabs((s[4] * x + s[5] * y + s[6] * z + s[7]) / (1.0 + s[K2] * w));
    if (u > 1.0 || v > 1.0) return false;
    const double around = std::pow(std::pow(u, s[AROUND]) + std::pow(v, s[AROUND]), s[ALONG]);
    return around + std::pow(std::fabs(w), s[UPWARD]) < 1.0;
}

// Whether a sample of a part lies inside another part once moved outwards by the contact distance.
bool touches(Array<const double, 2> solids, Index part, const Lifted &at, double contact_m) {
    double moved[3];
    for (int k = 0; k < 3; k++) moved[k] = at.point[k] + contact_m * at.normal[k];
    for (Index q = 0; q < solids.shape[0]; q++)
        if (q != part && encloses(solids[q].data, moved[0], moved[1], moved[2])) return true;
    return false;
}

}  // namespace

Index id_contours(const IdPicture &picture, const double *camera, Array<const double, 2> solids, double contact_m,
                  const IdSamples &samples) {
    Index n = 0;
    for (Index y = 0; y < picture.ids.shape[0]; y++)
        for (Index x = 0; x < picture.ids.shape[1]; x++) {
            const Here here{x, y, picture.ids(y, x), picture.depths(y, x)};
            const double gap = here.part >= 0 ? gap_behind(picture, here) : -1.0;
            if (gap < 0.0 || ++n > samples.parts.size()) continue;
            const Edge edge = edge_beside(picture, here);
            const double depth = depth_there(picture, here, edge);
            const double u = double(x + picture.left) + edge.beyond * edge.nx;
            const double v = double(y + picture.top) + edge.beyond * edge.ny;
            const Lifted at = lift(camera, u, v, edge, depth);
            const bool touching = gap - (depth - here.depth) < contact_m || touches(solids, here.part, at, contact_m);
            float *position = samples.positions[n - 1].data;
            position[sample::U] = float(u);
            position[sample::V] = float(v);
            position[sample::NU] = float(edge.nx);
            position[sample::NV] = float(edge.ny);
            position[sample::LENGTH] = touching ? 0.0f : float(1.0 / std::max(std::fabs(edge.nx), std::fabs(edge.ny)));
            for (int k = 0; k < 3; k++) samples.points(n - 1, k) = float(at.point[k]);
            samples.parts[n - 1] = here.part;
            samples.between[n - 1] = touching;
        }
    return n;
}

}  // namespace bodytrack::pictures
