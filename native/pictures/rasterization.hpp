// Z-buffer rasterization of triangle meshes, for pictures and exact part masks.
#pragma once
#include "array.hpp"

namespace bodytrack::pictures {

// A pixel of the image.
struct Corner {
    Index x, y;
};

// Draws triangles (T, 3) into a depth buffer with perspective-correct interpolation. pixels (N, 2), depths (N,) metres;
// origin: the buffer's first pixel in the image. buffers (h, w, 4), in and out: inverse depth (0 where empty), triangle
// index, and the barycentric weights of its first two vertices.
void rasterize(Array<const double, 2> pixels, Array<const double, 1> depths, Array<const Index, 2> triangles,
               const Corner &origin, Array<float, 3> buffers);

}  // namespace bodytrack::pictures
