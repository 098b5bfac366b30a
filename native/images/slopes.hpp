// Gradients of colour images.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Differences (h, w) across two pixels by a Sobel filter: eighths of a grey level per pixel.
struct Slopes {
    Array<const std::int16_t, 2> dx, dy;
};

// Sobel gradient of the channel that changes most, measured by abs(dx) + abs(dy); the first of equals. image (h, w, 3),
// mirrored at the border, at least 2 px wide and high; dx, dy (h, w). In one pass, for the memory is slower than the
// arithmetic.
void strongest_slopes(Array<const Byte, 3> image, Array<std::int16_t, 2> dx, Array<std::int16_t, 2> dy);

}  // namespace bodytrack::images
