// Segments of constant curvature: chains of edge pixels split where their curvature changes.
#pragma once
#include "images/linking.hpp"

namespace bodytrack::images {

// Pixels to each side over which the tangent is taken; largest departure of the tangent angle from a straight line,
// rad; least number of points of a segment.
struct SplitRule {
    Index reach;
    double tolerance;
    Index shortest;
};

// Splits chains of neighbouring pixels where their curvature changes; the number of segments.
// segments (N,) receive the segment of each point, -1 in segments that are too short.
Index split_segments(const Chains &chains, Index n_chains, const SplitRule &rule, Array<std::int32_t, 1> segments);

}  // namespace bodytrack::images
