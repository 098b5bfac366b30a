// Where a surface grid turns away from a camera: crossings of the grid's edges, joined to pieces of contour.
//
// A point of a surface with outward normal n lies on the occluding contour of a camera at c where n . (c - p) = 0. The
// contour crosses the grid's edges where that product changes sign; the crossings of a cell are joined to a piece of
// contour (marching squares) and the pieces to chains. A row of signs is the bits of one integer, so that rows and cells
// without a crossing cost next to nothing. Every edge has a point in its middle; between the nearer two the surface is
// bent by the turn of its normals: a 9 x 16 grid is good to a fraction of a pixel.
#pragma once
#include <memory>

#include "contours/solids.hpp"
#include "contours/workspace.hpp"

namespace bodytrack::contours {

// Columns of a grid that fit into one integer.
constexpr int MOST_COLUMNS = 62;

// Surface grids of R rows and C columns.
struct Grids {
    // (P, F, 7) surface points, normals and their product; F = (2 R - 1) (2 C) nodes, row by row, of which the even rows
    // and columns are the grid, the odd ones the middles of its edges
    Array<const float, 3> nodes;
    // (P, 4, R C) normals of the grid points and their product with the points
    Array<const float, 3> planes;
    int n_rows, n_columns;
};

// What tracing one part writes to on its way; the samples come out in `spots`.
struct Tracing {
    explicit Tracing(const Grids &grids);

    std::vector<float> facing;
    std::vector<int> ids;
    std::vector<Index> listed;
    int links[ROW][2], pieces[ROW][2];
    std::unique_ptr<Crossings> crossings;
    std::unique_ptr<Spots> spots;
};

// Pieces of the occluding contour of part p in one view, whether anything hides them or not: fills the crossings and the
// pieces (two crossings each, in the order of the contour) of the workspace; their number. lens (29,): the packed camera.
int find_pieces(const Grids &grids, Index p, const Solid &solid, const float *lens, Tracing &work);

}  // namespace bodytrack::contours
