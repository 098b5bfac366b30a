// Which pixels of a view lie inside the parts of a body, taken for rods, for many poses.
#pragma once
#include "array.hpp"

namespace bodytrack::pictures {

// Writes the share (B,) of some pixels (N, 2) that poses cover. starts (B, P, 2): one end of each part, px, NaN covers
// nothing; ways (B, P, 2) from there to the other end; reach_px (B, P): how far from the line between them a part reaches.
void covered_by_rods(Array<const float, 3> starts, Array<const float, 3> ways, Array<const float, 2> reach_px,
                     Array<const float, 2> pixels, Array<double, 1> shares);

}  // namespace bodytrack::pictures
