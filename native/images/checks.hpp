// Whether arguments are what the kernels rely on; asked at the border, where loops are not compiled for speed.
#pragma once
#include "images/linking.hpp"

namespace bodytrack::images {

// Pixels (N, 2) that lie in a picture.
bool pixels_within(Array<const std::int32_t, 2> pixels, Index width, Index height);

// Labels that are numbers from 0 and below n.
bool labels_below(Array<const std::int32_t, 2> labels, Index n);

// An edge map with an empty border, and so many edge pixels at most.
bool framed(Array<const Byte, 2> edges, Index most);

// Chains that begin where others end, whose points lie beside each other.
bool linked(const Chains &chains, Index n_chains);

}  // namespace bodytrack::images
