// What differs between an image and a plate, and which regions of it are large enough to be an object.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Marks 1 in moving (h, w) where a channel differs by more than `level` grey levels, else 0.
// image (h + 2, w + 2, 3) is a part with a border of a pixel, which is left out; its corner without the border is x, y
// of the plate (H, W, 3).
void mark_changes(Array<const Byte, 3> image, Array<const Byte, 3> plate, Index x, Index y, double level,
                  Array<Byte, 2> moving);

// Median of the grey levels of a picture.
double median_level(Array<const Byte, 2> picture);

// Marks the regions that are not smaller than a share `least` of the largest one.
// labels (h, w) from 0, which is none, to n_labels - 1.
void large_regions(Array<const std::int32_t, 2> labels, Index n_labels, double least, Array<bool, 2> mask);

}  // namespace bodytrack::images
