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

// The normal equations of the parameters that move some ends (dof): J^T W J (dof, dof) and J^T W r (dof,). twists (dof, 6)
// are spatial; moves (dof, dof + 1) from `BodyModel.moves`.
void chain(const std::vector<End> &ends, Array<const double, 2> twists, Array<const bool, 2> moves,
           Array<double, 2> matrix, Array<double, 1> vector);

}  // namespace bodytrack::body
