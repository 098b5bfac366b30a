// Chamfer images: distance of every pixel to the nearest of some pixels, clamped.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Distance (h, w), px, of every pixel to the nearest of some pixels (N, 2) inside, at most `reach`, along the steps of
// a 5 x 5 mask (Borgefors 1986).
void chamfer_distances(Array<const std::int32_t, 2> pixels, double reach, Array<float, 2> distance);

}  // namespace bodytrack::images
