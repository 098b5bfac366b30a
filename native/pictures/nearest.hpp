// Which of the parts before a camera is the nearest, pixel by pixel: a small depth buffer.
#pragma once
#include <cstdint>

#include "pictures/rasterization.hpp"

namespace bodytrack::pictures {

// Images of the points (P, N, 3) of the wanted parts (P,), at placements (P, 4, 4): seen (P, 3, N), pixels and inverse
// depths, 1 / m; NaN for parts that are not wanted, or not wholly before the camera (29,).
void project_surfaces(Array<const double, 3> placements, Array<const double, 3> surfaces, Array<const bool, 1> wanted,
                      const double *camera, Array<double, 3> seen);

// Draws the sides of parts that face the camera; inverse depths are linear in the image except for the lens. triangles
// (T, 3): point numbers, anticlockwise seen from outside; corner: the pictures' first pixel in the image. In and out:
// depths (h, w), inverse, 1 / m, 0 where there is nothing, and parts (h, w), the number of the part.
void draw_nearest(Array<const double, 3> seen, Array<const Index, 2> triangles, const Corner &corner,
                  Array<float, 2> depths, Array<std::int16_t, 2> parts);

}  // namespace bodytrack::pictures
