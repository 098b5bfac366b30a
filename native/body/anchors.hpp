// Places on parts that are followed in images: how far from there parts carry them, and the equations that bring them.
//
// Places lie on the surface where a viewing ray met it, so they are surest across that ray.
#pragma once
#include "body/wrenches.hpp"

namespace bodytrack::body {

// N places on parts of a scene, and where an image shows them.
struct Carried {
    // (N,) whose image; (N,) of the scene
    Array<const Index, 1> views, parts;
    // (N, 3) in the part's frame: place, metres; unit vectors out of the surface, and along the ray by which it was found
    Array<const double, 2> places, normals, rays;
    // (N,) standard deviation of the place along that ray, metres
    Array<const double, 1> depths_m;
    // (N, 2) where the image shows it
    Array<const double, 2> pixels;
    // (N,) of the pixel in either axis, px^2
    Array<const double, 1> variances;

    Index size() const { return parts.size(); }
};

// How far from where they are shown poses (B, P, 4, 4) carry the places (B, N), px; no more than a distance on the body,
// metres, which also counts for what lies behind the camera.
void gaps_of(Array<const double, 4> placements, Array<const double, 2> cameras, const Carried &carried, double most_m,
             Array<double, 2> gaps);

// Where a pose (P, 4, 4) carries the places, less where they are shown: found (N, 10), rows of `rows::carried_place`.
// slide_m: standard deviation of a place across its ray, for clothes slide, metres.
void residuals_of(Array<const double, 3> placements, Array<const double, 2> cameras, const Carried &carried,
                  double slide_m, Array<double, 2> found);

// Normal equations that bring the places to where they are shown, by wrenches; each place has two residuals. found (N, 10)
// from `residuals_of`; weights (N,) px^-2. Writes J^T W J (dof, dof) and J^T W r (dof,).
Sums anchor_equations(Array<const double, 3> placements, const Carried &carried, Array<const double, 2> found,
                      Array<const double, 1> weights, const Motion &motion, Array<double, 2> matrix,
                      Array<double, 1> vector);

}  // namespace bodytrack::body
