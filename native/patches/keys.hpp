// Key patches: pieces of an image that are kept, and found again in others by least squares matching.
#pragma once
#include "patches/matching.hpp"

namespace bodytrack::patches {

// Side of the square of spline coefficients that a patch of 2 half + 1 pixels needs.
constexpr Index key_side(Index half) { return 2 * (half + MARGIN) + 1; }

// Copies the coefficients around whole pixels (N, 2) to keys (N, side * side), where the patch lies within the image.
void cut_keys(const SplineImage &image, Array<const Index, 2> centres, Index half, Array<float, 2> keys,
              Array<bool, 1> inside);

// Finds the key patches `which` (M,) in an image: found (M, 15) and ended (M,) as in match_patches.
void match_keys(Array<const float, 2> keys, Array<const Index, 1> which, const SplineImage &search,
                Array<double, 2> found, Array<Index, 1> ended, const Rule &rule, const Noise &noise);

}  // namespace bodytrack::patches
