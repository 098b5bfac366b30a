// Wrenches on the ends of a kinematic chain, and what they are to the parameters that move those ends.
//
// A point's image moves along a direction by g . (v + w x X) for each twist (v, w): the product of the twist with one
// wrench (g, X x g). Wrenches are summed for each end of the chain first (6 x 6), and multiplied with the twists once.
#pragma once
#include <vector>

#include "array.hpp"
#include "projection.hpp"

namespace bodytrack::body {

// Sums of one end, which hangs on one parameter.
struct End {
    // of w g g^T over wrenches g; only what is on and below the diagonal
    double wrenches[6][6] = {};
    // of w r g
    double pulls[6] = {};
    bool used = false;

    // Adds residuals of a point X in the world, metres: the sum of their weights, and of weights times residuals (px); g is
    // the derivative of each of them by the point, px per metre.
    void add(const Point &point, const Point &gradient, double pull, double weight);
};

// How a pose moves the parts of a scene: (P,) the last parameter that moves each, -1 for the world, -2 for parts that do not
// count; (dof, 6) spatial twists; (dof, dof + 1) from `BodyModel.moves`.
struct Motion {
    Array<const Index, 1> ends;
    Array<const double, 2> twists;
    Array<const bool, 2> moves;
};

// Sums of w r^2 and of w.
struct Sums {
    double squares = 0.0, total = 0.0;
};

// The normal equations of the parameters that move some ends (dof): J^T W J (dof, dof) and J^T W r (dof,).
void chain(const std::vector<End> &ends, const Motion &motion, Array<double, 2> matrix, Array<double, 1> vector);

}  // namespace bodytrack::body
