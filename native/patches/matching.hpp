// Adaptive least squares matching of image patches (Gruen 1985): six affine and two radiometric parameters.
#pragma once
#include "patches/equations.hpp"
#include "patches/splines.hpp"

namespace bodytrack::patches {

// How a match ended; WEAK: the patch has too little texture, or looks like its negative.
enum Ended : Index { MATCHED, NOT_CONVERGED, DRIFTED, OUTSIDE, WEAK };

// Columns of what is found: centre px and affine matrix row by row; brightness and contrast; sigma0, grey levels;
// covariance of the shift, px^2; correlation; iterations; half the patch, px.
namespace found {
enum Column {
    X, Y, XX_OF, XY_OF, YX_OF, YY_OF, BRIGHTNESS, CONTRAST, SIGMA0, VARIANCE_X, VARIANCE_Y, COVARIANCE, CORRELATION,
    ITERATIONS, HALF_PATCH,
    N_COLUMNS
};
}

// Images that a patch of the first is looked for in the second of.
struct Images {
    SplineImage template_image, search;
};

// Finds a template patch around `at` (2), px, in another image: found (15) holds the start in its first six columns,
// and the result after. The inverse-compositional form linearizes the template once; the classical form of Gruen (1985)
// linearizes the search image at every iteration. Both minimize the squares of brightness + contrast g(A x + c) - f(x).
Ended match_patch(const Images &images, const double *at, double *found, const Rule &rule, const Noise &noise,
                  Workspace &work);

// Matches N patches: at (N, 2), found (N, 15), ended (N,) receives how each match ended.
void match_patches(const Images &images, Array<const double, 2> at, Array<double, 2> found, Array<Index, 1> ended,
                   const Rule &rule, const Noise &noise);

}  // namespace bodytrack::patches
