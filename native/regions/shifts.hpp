// Shifts of the contour: where along its normal does a part's colour end?
//
// Shifting the contour along a line by d leaves the places up to d inside. The posterior of d, flat a priori, has a mean
// and a variance: one equation of the pose.
#pragma once
#include "body/wrenches.hpp"
#include "regions/lines.hpp"

namespace bodytrack::regions {

// How far the contour has to move along its normal at each sample of one pose. beside (V, M, 2): parts seen at the SPOTS;
// cameras (V, 29). shifts (V, M, 3) receives the mean shift, px, outwards; its inverse variance, 1/px^2; 1 where the line
// supports a contour there, 0.3 where its best place is the end of the line. All 0 for those left out: of weight 0, of
// parts that are not wanted or known, without support.
void find_shifts(const Lines &lines, const Samples &samples, Array<const Index, 3> beside, Array<const double, 2> cameras,
                 Array<float, 3> shifts);

// Normal equations that move every sample along its normal by its shift (V, M, 3); a line counts by its inverse variance,
// px^-2, and its support. By wrenches; g is the derivative of the projection along the image normal. Writes J^T W J
// (dof, dof) and J^T W r (dof,).
body::Sums shift_equations(Array<const float, 3> shifts, const Samples &samples, const body::Motion &motion,
                           Array<const double, 2> cameras, double px_per_observation, Array<double, 2> matrix,
                           Array<double, 1> vector);

}  // namespace bodytrack::regions
