// Coarse depth pictures of meshes: what is in front, so that contours behind it are dropped.
#pragma once
#include <memory>
#include <vector>

#include "skins/mesh.hpp"

namespace bodytrack::skins {

// A view that meshes are traced in, and what is seen there.
struct View {
    View(const double *camera, double width, double height, double n_cells, const Mesh &mesh);

    // (29,) row of `Rig.packed`, and the same in single precision
    const double *camera;
    std::vector<float> lens;
    // of the image, px
    double width, height;
    // size of a cell, px; cell (i, j) is the value at pixel (cell_px j, cell_px i)
    double cell_px;
    // the largest inverse depth at each cell (rows, columns), 1 / m, 0 where there is nothing
    Index rows, columns;
    std::vector<float> depths;
    // (N, 3) pixel and inverse depth of each vertex, 1 / m, 0 behind the camera and beyond its reach
    std::vector<float> seen;
    // (N,) product of the normal and the way to the camera, positive where the surface faces it
    std::vector<float> facing;
    // (T,) faces seen from outside, wholly before the camera
    std::vector<std::uint8_t> front;

    const float *seen_at(Index vertex) const { return seen.data() + 3 * vertex; }
};

// Where n vertices are seen, and whether the surface faces the camera there: points and normals (N, 3) from `pose_mesh`,
// the packed camera in single precision; the twin is `project_point`. Writes seen (N, 3) and facing (N,) of a `View`.
void see_vertices(const float *points, const float *normals, Index n, const float *camera, float *seen, float *facing);

// Sees the vertices (N, 3) of a posed mesh, finds the faces in front, and draws them into the depth picture.
void draw_depths(const Mesh &mesh, Array<const float, 2> points, Array<const float, 2> normals, View &view);

}  // namespace bodytrack::skins
