// Edge segments that matter, from linked pixels (Gavrila & Davis 1996, section 4.2).
#pragma once
#include "images/constant_curvature.hpp"
#include "images/slopes.hpp"

namespace bodytrack::images {

// Edge points of segments, segment after segment: positions (N, 2) px, unit gradients (N, 2), segments (N,).
struct Traced {
    Array<float, 2> positions, directions;
    Array<Index, 1> segments;
};

struct TracedCounts {
    Index points, segments;
};

// Links edge pixels, splits the chains and finds the sub-pixel profile of the segments that are long enough. edges as
// in link_edges; slopes (h, w); near (h, w) is non-zero where edges matter: segments without such a pixel are left out
// early, for four of five edges around a person are the room's; (0, 0) for all of them.
TracedCounts trace_segments(Array<Byte, 2> edges, const Slopes &slopes, const SplitRule &rule,
                            Array<const Byte, 2> near, const Traced &found);

}  // namespace bodytrack::images
