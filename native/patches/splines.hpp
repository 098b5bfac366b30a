// Cubic B-spline interpolation of image patches under an affine transformation.
#pragma once
#include "array.hpp"

namespace bodytrack::patches {

// Spline coefficients of an image, row by row, its width and height, px.
struct SplineImage {
    const float *flat;
    Index width, height;
};

// Patches reach no nearer to the border than this, px: the splines need the pixels around.
constexpr Index MARGIN = 2;

// No patch reaches farther from its centre than this, px.
constexpr Index MOST_REACH = 64;

// Whether a patch of 2 half + 1 pixels a side touches the border or is too large; warp (6) is the position of its
// centre, then the affine matrix row by row.
bool reaches_out(const double *warp, Index half, const SplineImage &image);

// Grey values under an affinely transformed patch, which must lie inside, row by row.
void sample_patch(const SplineImage &image, const double *warp, Index half, float *values);

// Grey values and image gradients along x and y, grey levels per px, as `sample_patch`.
void sample_gradient(const SplineImage &image, const double *warp, Index half, float *values, float *dx, float *dy);

// The same of an upright patch whose centre is a whole pixel. Three coefficients in a row instead of four, the same
// ones for all pixels: ten times as fast.
void sample_whole_pixels(const SplineImage &image, Index column, Index row, Index half, float *values, float *dx,
                         float *dy);

}  // namespace bodytrack::patches
