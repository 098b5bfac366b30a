// Nearest neighbours between model contours and scene edges whose directions agree, and their normal equations.
#pragma once
#include "body/wrenches.hpp"

namespace bodytrack::contours {

// Largest distance of a pair, px, and smallest cosine between its directions (modulo sign).
struct Gate {
    double radius, cosine;
};

// Oriented nearest neighbours from the model to the scene and back. positions (V, M, 5) are model samples of one pose,
// counts (V,) of which are valid; those of weight 0 are not matched. Scene points (S, 5), each view's sorted by y, begin at
// first (V + 1,). pairs (N, 4) receives view, model sample, scene point, 0 for model to scene or 1 for scene to model.
// Returns the number of pairs, N at most.
Index match_oriented(Array<const float, 3> positions, Array<const Index, 1> counts, Array<const float, 2> scene,
                     Array<const Index, 1> first, const Gate &gate, Array<Index, 2> pairs);

// Pairs (N, 4) of `match_oriented`, and what they are of.
struct Paired {
    Array<const Index, 2> pairs;
    // (V, M, 5), (V, M, 3), (V, M): model samples of one pose, their points in the world, metres, and scene-wide parts
    Array<const float, 3> positions, points;
    Array<const Index, 2> parts;
    // (S, 5)
    Array<const float, 2> scene;
    // (V, 29)
    Array<const double, 2> cameras;
};

// Normal equations of the point-to-contour residuals, robustly weighted (Geman & McClure), by wrenches; matrix (dof, dof)
// receives J^T W J and vector (dof,) J^T W r. px_per_observation: contour length that counts as one observation; robust_px:
// residual at which a pair's weight has fallen to a quarter. The twin is `Correspondences.residual`.
body::Sums normal_equations(const Paired &paired, const body::Motion &motion, double px_per_observation,
                            double robust_px, Array<double, 2> matrix, Array<double, 1> vector);

}  // namespace bodytrack::contours
