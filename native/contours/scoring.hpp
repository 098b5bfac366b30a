// Poses synthesized and compared with an observation in one go: no contour is written to memory.
//
// In a decomposed search most parts of the body stand still. They are traced once for all its poses; of each only the
// moving parts are traced, and tested for what they hide of the others. Parts that stand as in the pose before are not
// even drawn again: side by side with other searches of the same limb half of the moving ones do.
#pragma once
#include "contours/chamfer.hpp"
#include "contours/tracing.hpp"

namespace bodytrack::contours {

// Marks parts (P,) whose placements (B, P, 4, 4) are not the same in all poses; all of them where B is 0 or 1.
void moving_parts(Array<const double, 4> placements, Array<bool, 1> moving);

// Whether part p stands in pose b as in the pose before.
bool repeats(Array<const double, 4> placements, Index b, Index p);

// The contours of parts that stand still: samples (V, ROW, 13), see `trace_view`, and their numbers (V,).
struct Standing {
    Array<const float, 3> samples;
    Array<const Index, 1> counts;
};

// Contour samples of the parts (P,) that stand still in a search, in the first pose (P, 4, 4); nothing else covers them
// here. Writes samples and counts as in `Standing`.
void trace_still(Array<const double, 3> placements, Array<const bool, 1> still, const Grids &grids, const Parts &parts,
                 const Views &views, const Spacing &spacing, Array<float, 3> samples, Array<Index, 1> counts);

// Directed chamfer distances (B, V, 2) of many poses (B, P, 4, 4), px: model to scene, scene to model; those of missing
// views are left as they are. The twin is `trace_contours` and `directed_distances`. moving (P,): parts that do not stand
// still, at least those of `moving_parts`; standing: of the other parts, from `trace_still`.
void score_poses(Array<const double, 4> placements, const Grids &grids, const Parts &parts, const Views &views,
                 const Spacing &spacing, const Edges &edges, const Rule &rule, Array<const bool, 1> moving,
                 const Standing &standing, Array<double, 3> distances);

}  // namespace bodytrack::contours
