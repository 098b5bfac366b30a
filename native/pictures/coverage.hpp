// What of weighted pictures a body covers, for many poses: the silhouettes are filled small and never kept.
//
// Parts that stand still in a batch are filled once for all poses, and not even once if they stand as in the batch before;
// where those are that stand as in the pose before is not found anew.
#pragma once
#include "array.hpp"

namespace bodytrack::pictures {

// Two pictures of all views end to end.
struct Weighted {
    // (V, 29), of the small pictures
    Array<const double, 2> cameras;
    // (V, 3) start in the pictures, width, height; width 0 for a view that does not count
    Array<const Index, 2> regions;
    // (N, 2)
    Array<const float, 2> pictures;
};

// Surface points of parts (P, n_rows n_columns, 3), ring by ring.
struct Rings {
    Array<const float, 3> points;
    int n_rows, n_columns;
};

// What the parts (P,) that stand still in a search cover, at the first pose (P, 4, 4): marks the pixels covered (N,) and
// writes the sums over them (V, 2).
void cover_still(Array<const double, 3> placements, Array<const bool, 1> still, const Rings &rings,
                 const Weighted &weighted, Array<bool, 1> covered, Array<double, 2> sums);

// Sums (B, V, 2) of two pictures over what a body covers at poses (B, P, 4, 4), 0 for views that do not count; the twin is
// `fill_parts` and a sum. moving (P,): parts that do not stand still; covered and base: of the others, from `cover_still`.
void covered_sums(Array<const double, 4> placements, Array<const bool, 1> moving, const Rings &rings,
                  const Weighted &weighted, Array<const bool, 1> covered, Array<const double, 2> base,
                  Array<double, 3> sums);

// Share (h, w) of each square of `factor` pixels along its side that a mask (H, W) covers.
void cover_shares(Array<const bool, 2> mask, Index factor, Array<float, 2> shares);

}  // namespace bodytrack::pictures
