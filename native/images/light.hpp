// How the light of an image differs from that of its clean plate.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Grey levels added before ratios are taken; tracker/kernels/changes.py says why.
constexpr double DARK = 6.0;

// Median log ratios (h / size, w / size, 3) of an image (h, w, 3) and its plate in square blocks, of every `step`th
// pixel.
void block_ratios(Array<const Byte, 3> now, Array<const Byte, 3> plate, Index size, Index step,
                  Array<double, 3> ratios);

// The quadratic surface (n, m, 3) that most blocks agree with, by iteratively weighted least squares: Cauchy's weights,
// a half at the median departure or at `least`; every `stride`th block in both directions is asked.
void smooth_surface(Array<const double, 3> ratios, double least, Index n_steps, Index stride, Array<double, 3> surface);

// Blocks (n, m) that depart by less than `most`, and those that a way of smaller steps from block to block leads to.
void connected_blocks(Array<const double, 3> departures, double most, Array<bool, 2> reached);

}  // namespace bodytrack::images
