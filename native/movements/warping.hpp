// Dynamic time warping of a recording onto the movements of a library, in one pass.
#pragma once
#include "array.hpp"

namespace bodytrack::movements {

// How far limbs point in different directions: root of the weighted mean square angle between every two frames, degrees.
// queried (T, L, 3) and known (N, L, 3) are unit directions of L limbs, weights (L,) add up to 1; gaps (T, N).
void direction_gaps(Array<const float, 3> queried, Array<const float, 3> known, Array<const float, 1> weights,
                    Array<float, 2> gaps);

// The performances of a library: gaps (T, N) to every frame of it, where each begins (K + 1,), whether it goes round,
// and its slack (K,).
struct Known {
    Array<const float, 2> gaps;
    Array<const Index, 1> first;
    Array<const bool, 1> repeats;
    Array<const Index, 1> slack;
};

// One-pass dynamic programming for connected patterns (Ney, IEEE Trans. ASSP 32, 1984); the cost of all frames.
double warp_sequence(const Known &known, double unknown, double entry, Array<Index, 2> found);

}  // namespace bodytrack::movements
