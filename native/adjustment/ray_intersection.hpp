// Forward ray intersection of many points, weighted by the precision of their images.
#pragma once
#include "array.hpp"

namespace bodytrack::adjustment {

// Images of N points in V views: cameras (V, 29); pixels (V, N, 2), NaN where a view does not show the point; variances
// (V, N, 3) of the pixels: xx, yy, xy, px^2.
struct Images {
    Array<const double, 2> cameras;
    Array<const double, 3> pixels, variances;
};

// Gauss-Newton on the weighted reprojection error. points (N, 3) holds the starts, and the points after, metres, NaN
// where fewer than two views meet; covariances (N, 3, 3), m^2; residuals (N,): RMS of the reprojection over the
// coordinates, px.
void intersect_rays(const Images &images, Array<double, 2> points, Array<double, 3> covariances,
                    Array<double, 1> residuals);

}  // namespace bodytrack::adjustment
