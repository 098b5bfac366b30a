// A-posteriori precision of a matched patch, honest on weak texture and smoothed images.
#pragma once
#include "patches/equations.hpp"

namespace bodytrack::patches {

// Sigma0 and the covariance of the shift (columns of what is found) from the sum of the squared residuals and the
// standard deviation of the template's grey values; false where a parameter cannot be determined.
bool estimate_precision(double *found, double squares, double spread, const Rule &rule, const Noise &noise,
                        Workspace &work);

}  // namespace bodytrack::patches
