// Visible occluding-contour samples of skinned meshes, without rendering a picture.
//
// The contour of the smooth surface (`smooth_contours`) is followed across the faces of a mesh, cut into samples of equal
// length, and tested for visibility (`visibility`). Open borders of faces seen from outside are contours as well.
#pragma once
#include "contours/tracing.hpp"
#include "skins/mesh.hpp"

namespace bodytrack::skins {

// How contours are cut into samples: contour that a sample stands for, px; distance at which surfaces touch, metres; cells
// of the depth pictures along the longer side of an image.
struct Spacing {
    double step_px, contact_m, n_cells;
};

// Visible occluding-contour samples of meshes that move with the parts of many poses (B, P, 4, 4), in all views; further
// ones than there is room for are dropped. part_from_rest (P, 4, 4): from the pose that the surface was measured in.
void trace_skins(Array<const double, 4> placements, Array<const double, 3> part_from_rest, const Mesh &mesh,
                 const contours::Views &views, const Spacing &spacing, const contours::Traced &traced);

}  // namespace bodytrack::skins
