// A step of Gauss and Newton inside limits.
#pragma once
#include <vector>

#include "array.hpp"

namespace bodytrack::descent {

// Moves a pose (dof,) near the minimum of the quadratic model inside the limits (dof, 2): what hits one stays there, the
// rest is solved anew; three times at most. matrix (dof, dof), vector (dof,): its normal equations.
// Throws std::domain_error where the matrix is not positive definite, or something is not finite.
void limited_step(Array<double, 1> q, const std::vector<double> &matrix, const std::vector<double> &vector,
                  Array<const double, 2> limits);

}  // namespace bodytrack::descent
