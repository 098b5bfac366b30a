// What accepting segments as units needs of each edge: distance to the expected contours, marks in pictures.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Which points (N, 2), px of the whole image, a picture (h, w) is set at whose upper left corner lies at x, y there;
// beyond the picture it is not.
void marked(Array<const float, 2> points, Array<const Byte, 2> picture, Index x, Index y, Array<bool, 1> marks);

// Distance (N,) of each edge point (N, 2) with its unit gradient to the nearest expected contour sample (M, 4), pixel
// and unit normal, at most `most_px`. A sample whose normal is at angle a to the gradient is farther by bend_px |sin
// a|.
void expected_distances(Array<const float, 2> edges, Array<const float, 2> directions, Array<const float, 2> samples,
                        double bend_px, double most_px, Array<float, 1> distances);

}  // namespace bodytrack::images
