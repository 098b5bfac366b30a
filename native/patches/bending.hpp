// How far the mean of a followed patch lies from its centre, from the affine terms of its neighbours.
#pragma once
#include "array.hpp"

namespace bodytrack::patches {

// Followed points: offsets (N, K, 2) of the neighbours from them at birth, px; rows (N, K) of the neighbours, -1 for
// none; affine transformations (N, 2, 2) from birth to now, which are known (N,) of the present frame.
struct Followed {
    Array<const double, 3> offsets;
    Array<const Index, 2> rows;
    Array<const double, 3> affine;
    Array<const bool, 1> known;
};

// Shifts (N, 2), px, of each patch's mean against its centre; 0 where neighbours cannot tell. Patches have 2 half + 1
// pixels a side.
void bending_shifts(const Followed &followed, Index half, Array<double, 2> shifts);

}  // namespace bodytrack::patches
