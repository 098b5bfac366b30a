// Which part of a scene is seen beside a contour: an arm before the trunk has the trunk for its background.
#pragma once
#include <limits>

#include "contours/occlusion.hpp"
#include "regions/lines.hpp"

namespace bodytrack::regions {

// A place beside a contour: its pixel, and the far end of the ray through it, metres.
struct Spot {
    double u, v, x, y, z;
};

// The part that a ray meets first, and where the ray passes its middle, as a share of the ray's length.
struct Side {
    Index part = BACKGROUND;
    double along = std::numeric_limits<double>::infinity();
};

// Lists those of some parts (among: (P,)) that may be seen at the SPOTS of part p; fx_px: focal length of the view.
void parts_near(const contours::Solids &solids, const bool *among, Index p, double fx_px, double step_m,
                std::vector<Index> &near);

// The first of the near parts, or what is known of the others: the one whose middle a ray passes first.
Side nearest_beside(const contours::Solids &solids, const std::vector<Index> &near, const Spot &spot, Side before = {});

// The first n of the SPOTS of a contour sample in the view of a packed camera.
void place_spots(const double *camera, const Sample &at, double step_m, int n, Spot *spots);

// The part seen at the SPOTS outside of each contour sample of one pose (P, 4, 4): found (V, M, 2), -1 where no other
// part is.
void parts_beside(Array<const double, 3> placements, const contours::Parts &parts, Array<const double, 2> cameras,
                  const Samples &samples, double step_m, Array<Index, 3> found);

}  // namespace bodytrack::regions
