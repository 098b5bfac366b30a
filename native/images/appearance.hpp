// What pixels look like, from their colours and the slopes around them; see `tracker.images.operations.appearance`.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Chroma (K,) by place, steps (256,) of a slope, 0 to 3, and classes (16,) of four times a step across plus one along.
// The place of chroma is red Cr + blue Cb + added.
struct Appearances {
    Array<const Byte, 1> chroma, steps, classes;
    Index red, blue, added;
};

// Lightness, chroma and the class of texture (h, w, 3) of every pixel of a region at x, y of a part of an image: its
// lightness, Cr and Cb (H, W, 3), and slopes across and along (H, W).
void mark_appearance(Array<const Byte, 3> colours, Array<const Byte, 2> across,
                     Array<const Byte, 2> along, Index x, Index y, const Appearances &tables,
                     Array<Byte, 3> looks);

}  // namespace bodytrack::images
