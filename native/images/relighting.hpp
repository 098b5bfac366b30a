// A plate in the light of an image.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Where a part lies in the plate: its first pixel, and pixels of the plate from one of its pixels to the next.
struct Geometry {
    Index x, y, spacing;
};

// A part (h, w, 3) of a plate in another light: gains (n, m, 3) of its blocks of `size` px, bilinear between their
// centres.
void relight(Array<const Byte, 3> picture, Array<const float, 3> gains, double size, const Geometry &geometry,
             Array<Byte, 3> lit);

}  // namespace bodytrack::images
