// What pixels look like, from their colours and the slopes around them; see `tracker.images.operations.appearance`.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// How colours and slopes are told apart.
struct Appearances {
    // (K,) chroma by place; the place is red Cr + blue Cb + added.
    Array<const Byte, 1> chroma;
    Index red, blue, added;
    // The largest slopes of the first three steps, tenths of a grey level a px.
    Byte slopes[3];
};

// Lightness, chroma and the class of texture (h, w, 3) of every pixel of a region at x, y of a BGR image (H, W, 3).
// Of a grey one lightness, and mean slopes across and along. One pass, whose rows stay in the cache.
void mark_appearance(Array<const Byte, 3> image, Index x, Index y, const Appearances &appearances, bool grey,
                     Array<Byte, 3> looks);

// How many of every so many pixels, in both directions, have channels that differ by more than so many levels.
Index count_coloured(Array<const Byte, 3> image, Index spacing, Index level);

}  // namespace bodytrack::images
