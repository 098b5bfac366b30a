// Where an edge lies between its pixels, and which way its gradient points.
#pragma once
#include "images/linking.hpp"
#include "images/slopes.hpp"

namespace bodytrack::images {

// Sub-pixel positions, px, and unit gradients (N, 2) of edge pixels (N, 2).
void edge_profile(Array<const std::int32_t, 2> points, const Slopes &slopes, Array<float, 2> edges,
                  Array<float, 2> directions);

}  // namespace bodytrack::images
