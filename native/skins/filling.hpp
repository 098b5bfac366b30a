// The region of an image that a mesh covers.
#pragma once
#include "array.hpp"

namespace bodytrack::skins {

// Sets the pixels of a mask (h, w) whose centres triangles (T, 3) of vertices (N, 3), in the world, metres, cover, from
// whichever side they are seen; triangles that are not wholly before the camera (29,) are left out.
void fill_mesh(Array<const double, 2> points, Array<const Index, 2> faces, const double *camera, Array<bool, 2> mask);

}  // namespace bodytrack::skins
