// Growth of a match over a grid of the template: from neighbour to neighbour, in a chosen order.
#pragma once
#include "patches/matching.hpp"

namespace bodytrack::patches {

// States of a cell beside those of a match; REJECTED: matched, but not well enough.
constexpr Index REJECTED = 5;

// Columns, rows, and pixels from one to the next; cell (0, 0) is pixel (0, 0).
struct Grid {
    Index n_columns, n_rows, pixels;
};

// Largest sigma0, grey levels; largest standard deviation of a shift, px; least correlation; largest stretch.
struct Limits {
    double sigma0, deviation, correlation, stretch;
};

// Attempts (cell * 4 + direction), least key first, in arrays of Python's; `count` is their number.
struct Heap {
    Array<double, 1> keys;
    Array<Index, 1> items;
    Index &count;
};

// What is known of the cells: found (cells, 15); ended (cells,); nearest seed's cell (cells,), within whose region
// growth stays, rows first (paper, figure 3), all -1 for growth without regions, where the most precise match goes on
// first.
struct Cells {
    Array<double, 2> found;
    Array<Index, 1> ended;
    Array<const Index, 1> seeds;
};

// By what factor the affine transformation of what is found stretches or compresses the patch most; infinite for a
// mirrored one.
double stretch(const double *found);

// Puts the attempts from every matched cell to its open neighbours on the heap.
void push_all(const Heap &heap, const Grid &grid, const Cells &cells);

// How patches are matched: as usual, by a larger patch where that fails, and what a match must be like.
struct Judging {
    Rule usual, larger;
    Noise noise;
    Limits limits;
};

// Works through the heap of attempts, `budget` of them at most; every match adds those of its neighbours. An attempt
// that fails is repeated by way of a point half-way, then with the larger patch. tries (cells,) counts those of each
// cell, most_tries at most. Returns how many attempts are left.
Index grow(const Images &images, const Grid &grid, const Cells &cells, Array<Index, 1> tries, const Heap &heap,
           const Judging &judging, Index budget, Index most_tries);

}  // namespace bodytrack::patches
