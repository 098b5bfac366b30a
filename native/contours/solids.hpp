// Parts of a body, tapered superquadrics, made ready for tests in one pose and view, and where points stand to them.
#pragma once
#include <cmath>
#include <vector>

#include "array.hpp"

namespace bodytrack::contours {

// A part. Single precision is good to 5 micrometres in a room and takes half the time.
struct Solid {
    // motion from the world into the part's frame in units of its half extents
    float m[3][4];
    // camera centre in that frame
    float eye[3];
    // largest squared distance of the surface from the origin of that frame
    float reach;
    // taper
    float k1, k2;
    // exponents 2 / e2, e2 / e1 and 2 / e1 of the inside-outside function
    float around, along, upward;
    // its axis in the image: one end, px; the axis; that divided by its squared length, 1 / px
    float start_u, start_v, axis_u, axis_v, share_u, share_v;
    // squared width around the axis, px^2
    float width2;
    // least depth, metres; -1 for a part that is not wholly before the camera, or that ends beyond the lens's reach
    float nearest;
    // world_from_part: rotation, and position in metres
    float rotation[3][3], position[3];
    // camera centre in the part's frame, metres
    float camera[3];
    // the box around the part in the image, px
    float least_u, most_u, least_v, most_v;
};

using Solids = std::vector<Solid>;

// The parts of all persons of a scene.
struct Parts {
    // (P, 7) packed superquadrics
    Array<const double, 2> shapes;
    // (3, P) radii of bounding spheres, metres; reaches of bounding ellipsoids, squared, in units of the half extents;
    // largest distances of the surface from the z axis, metres
    Array<const double, 2> bounds;

    Index size() const { return shapes.shape[0]; }
};

// Fills what of part p depends on the pose alone. placement (16) is its world_from_part, metres.
void place_solid(const double *placement, const Parts &parts, Index p, Solid &solid);

// The same for all parts: placements (P, 4, 4).
void place_solids(Array<const double, 3> placements, const Parts &parts, Solids &solids);

// Fills what depends on the view, of a packed camera; margin_m is added to the width of a part in the image.
void view_solid(const Parts &parts, Index p, const double *camera, double margin_m, Solid &solid);
void view_solids(const Parts &parts, const double *camera, double margin_m, Solids &solids);

// A world point in the frame of a part, in units of its half extents.
template <class T>
inline void in_part(const Solid &s, T x, T y, T z, T &px, T &py, T &pz) {
    px = s.m[0][0] * x + s.m[0][1] * y + s.m[0][2] * z + s.m[0][3];
    py = s.m[1][0] * x + s.m[1][1] * y + s.m[1][2] * z + s.m[1][3];
    pz = s.m[2][0] * x + s.m[2][1] * y + s.m[2][2] * z + s.m[2][3];
}

// Inside-outside function of a part with exponents e1, e2 up to 1, at a point in units of its half extents: below 1
// inside, 1 on the surface; 9 outside the bounding box and 0.5 inside the inscribed ellipsoid, both without powers.
inline float inside_value(const Solid &s, float x, float y, float z) {
    if (std::fabs(z) > 1.0f) return 9.0f;
    const float u = std::fabs(x / (1.0f + s.k1 * z)), v = std::fabs(y / (1.0f + s.k2 * z));
    if (u > 1.0f || v > 1.0f) return 9.0f;
    const float square = u * u + v * v;
    if (square + z * z < 1.0f) return 0.5f;
    float around;
    if (s.around == 2.0f) {
        if (square > 1.0f) return 9.0f;
        around = std::pow(square, 0.5f * s.upward);
    } else {
        around = std::pow(std::pow(u, s.around) + std::pow(v, s.around), s.along);
    }
    return around + std::pow(std::fabs(z), s.upward);
}

}  // namespace bodytrack::contours
