// Edge linking: chains of neighbouring edge pixels.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// x, y of pixels (N, 2), without the border of an edge map.
using Pixels = Array<std::int32_t, 2>;

// Chains of pixels: the points of all, chain after chain, and where each begins.
struct Chains {
    Pixels points;
    Array<std::int32_t, 1> starts;
};

// Links edge pixels into 8-connected chains, each pixel into one; the number of chains.
// edges (h + 2, w + 2) are non-zero at the N edge pixels, with an empty border; cleared. points (N, 2), starts (N +
// 1,).
Index link_edges(Array<Byte, 2> edges, const Chains &chains);

}  // namespace bodytrack::images
