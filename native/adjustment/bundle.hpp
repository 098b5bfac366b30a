// Normal equations of a bundle adjustment, reduced to the cameras object by object (Schur complement).
//
// An object is what moves as a whole between two exposures and has six unknowns of its own: the two ends of a reference
// bar, the pose of a board, or a single point. Its unknowns are eliminated as soon as its observations are summed up,
// so that only the cameras' equations are ever solved together.
#pragma once
#include "array.hpp"
#include "rows.hpp"

namespace bodytrack::adjustment {

constexpr int N_UNKNOWNS = rows::bundle_unknown::N_UNKNOWNS;

// Unknowns of an object.
constexpr int N_OBJECT = 6;

// N observations: their views (N,), points (N,), pixels (N, 2), image velocities (N, 2) px per frame, weights (N,).
// Those of an object stand one after another; of weight 0, they count for nothing.
struct Observed {
    Array<const Index, 1> views, points;
    Array<const double, 2> pixels, velocities;
    Array<const double, 1> weights;
};

// Points (P, 3), their slopes (P, 3, 6) by the unknowns of their object, the first observation of each object (G + 1,),
// and what is known of the objects beforehand: normal matrices (G, 6, 6) and right sides (G, 6).
struct Objects {
    Array<const double, 2> points;
    Array<const double, 3> slopes;
    Array<const Index, 1> firsts;
    Array<const double, 3> priors;
    Array<const double, 2> prior_sides;
};

// Outputs: normal matrix (17 V, 17 V) and right side (17 V,), and for the way back to the objects their inverse normal
// matrices (G, 6, 6), right sides (G, 6) and couplings with the cameras (G, V, 6, 17).
struct Reduced {
    Array<double, 2> normal;
    Array<double, 1> side;
    Array<double, 3> inverses;
    Array<double, 2> object_sides;
    Array<double, 4> couplings;
};

// Observed minus projected pixels (N, 2); NaN behind the camera. cameras (V, 26) are states, points (P, 3) metres.
void residuals_of(Array<const double, 2> cameras, Array<const double, 2> points, const Observed &observed,
                  Array<double, 2> residuals);

// Sums up the normal equations and eliminates the unknowns of every object. Levenberg-Marquardt's damping is added to
// every diagonal element as a share of it.
void reduce_normal(Array<const double, 2> cameras, const Objects &objects, const Observed &observed, double damping,
                   const Reduced &reduced);

}  // namespace bodytrack::adjustment
