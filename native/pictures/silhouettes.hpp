// The region of an image that convex parts cover.
#pragma once
#include <limits>
#include <vector>

#include "array.hpp"

namespace bodytrack::pictures {

// Where each row of pixels begins and ends.
struct Extents {
    explicit Extents(Index height) : left(height), right(height) {}

    Index height() const { return Index(left.size()); }

    void clear(Index first, Index end) {
        for (Index row = first; row < end; row++) {
            left[row] = std::numeric_limits<double>::infinity();
            right[row] = -std::numeric_limits<double>::infinity();
        }
    }

    // Widens the rows that a line crosses to where it crosses them.
    void widen(double u0, double v0, double u1, double v1);

    std::vector<double> left, right;
};

// Sets the pixels of a mask (h, w) whose centres the parts cover: row by row, between the outermost lines of their grids.
// Lines that lie inside are not even projected: 4 of 5 at 25 x 48 points, a quarter of the time with all of them.
// placements (P, 4, 4); grids (P, n_rows n_columns, 7) points, normals and their product, ring by ring, n_columns at most
// 62. Parts that come nearer to the camera than 5 cm, or that are not wholly within the reach of its lens, are left out,
// as in all other pictures.
void fill_parts(Array<const double, 3> placements, Array<const float, 3> grids, int n_rows, int n_columns,
                const double *camera, Array<bool, 2> mask);

}  // namespace bodytrack::pictures
