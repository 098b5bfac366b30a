#include "patches/splines.hpp"

#include <algorithm>
#include <cmath>

namespace bodytrack::patches {

namespace {

// Coefficients in a row that reach a point.
constexpr int FOUR = 4;

// Points of a row of a patch, at most.
constexpr Index MOST = 2 * MOST_REACH;

// The points of one row of a patch in an image: the first coefficient that reaches each, counted from a pixel up and
// left of the patch, and how far beyond a pixel it lies.
struct Points {
    std::int32_t first[MOST];
    float across[MOST], along[MOST];
};

// A patch in an image. Positions are counted from a whole pixel so far up and left that no patch goes below 0:
// truncation is then the floor, and single precision is fine enough (1e-5 px).
class Patch {
  public:
    Patch(const SplineImage &image, const double *warp, Index half)
        : half_(half), size_(2 * half + 1), stride_(std::int32_t(image.width)), a_(float(warp[2])), b_(float(warp[3])),
          c_(float(warp[4])), d_(float(warp[5])) {
        const Index column = Index(std::floor(warp[0])) - MOST_REACH, row = Index(std::floor(warp[1])) - MOST_REACH;
        x_ = float(warp[0] - double(column));
        y_ = float(warp[1] - double(row));
        start_ = (row - 1) * image.width + column - 1;
    }

    Index size() const { return size_; }
    Index start() const { return start_; }

    void row(Index j, Points &points) const {
        const float dy = float(j - half_), x = x_ + b_ * dy, y = y_ + d_ * dy;
        for (Index i = 0; i < size_; i++) {
            const float dx = float(std::int32_t(i - half_)), u = x + a_ * dx, v = y + c_ * dx;
            const std::int32_t column = std::int32_t(u), line = std::int32_t(v);
            points.first[i] = line * stride_ + column;
            points.across[i] = u - float(column);
            points.along[i] = v - float(line);
        }
    }

  private:
    Index half_, size_, start_;
    std::int32_t stride_;
    float a_, b_, c_, d_, x_, y_;
};

// The four cubic B-splines that reach points a fraction beyond a pixel.
void weights_of(const float *__restrict fractions, Index n, float (*__restrict weights)[FOUR]) {
    for (Index i = 0; i < n; i++) {
        const float f = fractions[i], rest = 1.0f - f, f2 = f * f, f3 = f2 * f;
        const float w0 = rest * rest * rest * (1.0f / 6.0f), w1 = 2.0f / 3.0f - f2 + f3 * 0.5f, w3 = f3 * (1.0f / 6.0f);
        weights[i][0] = w0;
        weights[i][1] = w1;
        weights[i][2] = 1.0f - w0 - w1 - w3;
        weights[i][3] = w3;
    }
}

// Their derivatives by the fraction.
void slopes_of(const float *__restrict fractions, Index n, float (*__restrict slopes)[FOUR]) {
    for (Index i = 0; i < n; i++) {
        const float f = fractions[i], rest = 1.0f - f;
        const float w0 = -0.5f * rest * rest, w1 = 1.5f * f * f - 2.0f * f, w3 = 0.5f * f * f;
        slopes[i][0] = w0;
        slopes[i][1] = w1;
        slopes[i][2] = -w0 - w1 - w3;
        slopes[i][3] = w3;
    }
}

// Four columns of coefficients from four rows, weighted.
struct Column {
    float of[FOUR];

    Column(const float *at, Index width, const float (&weights)[FOUR]) {
        for (int k = 0; k < FOUR; k++)
            of[k] = weights[0] * at[k] + weights[1] * at[k + width] + weights[2] * at[k + 2 * width] +
                    weights[3] * at[k + 3 * width];
    }

    // Weighted in turn; their sum is the interpolated value.
    void times(const float (&weights)[FOUR], float (&products)[FOUR]) const {
        for (int k = 0; k < FOUR; k++) products[k] = weights[k] * of[k];
    }
};

void sums_of(const float (*__restrict products)[FOUR], Index n, float *__restrict sums) {
    for (Index i = 0; i < n; i++) sums[i] = (products[i][0] + products[i][1]) + (products[i][2] + products[i][3]);
}

}  // namespace

bool reaches_out(const double *warp, Index half, const SplineImage &image) {
    const double reach_x = double(half) * (std::abs(warp[2]) + std::abs(warp[3])) + double(MARGIN);
    const double reach_y = double(half) * (std::abs(warp[4]) + std::abs(warp[5])) + double(MARGIN);
    const bool inside_x = warp[0] - reach_x >= 0.0 && warp[0] + reach_x <= double(image.width - 1);
    const bool inside_y = warp[1] - reach_y >= 0.0 && warp[1] + reach_y <= double(image.height - 1);
    // written so that NaN reaches out
    return !(inside_x && inside_y && std::max(reach_x, reach_y) < double(MOST_REACH) && half < MOST_REACH);
}

void sample_patch(const SplineImage &image, const double *warp, Index half, float *values) {
    const Patch patch(image, warp, half);
    Points points;
    float across[MOST][FOUR], along[MOST][FOUR], products[MOST][FOUR];
    const Index n = patch.size();
    for (Index j = 0; j < n; j++) {
        patch.row(j, points);
        weights_of(points.across, n, across);
        weights_of(points.along, n, along);
        for (Index i = 0; i < n; i++) {
            const Column column(image.flat + (patch.start() + points.first[i]), image.width, along[i]);
            column.times(across[i], products[i]);
        }
        sums_of(products, n, values + j * n);
    }
}

void sample_gradient(const SplineImage &image, const double *warp, Index half, float *values, float *dx, float *dy) {
    const Patch patch(image, warp, half);
    Points points;
    float across[MOST][FOUR], along[MOST][FOUR], slopes_across[MOST][FOUR], slopes_along[MOST][FOUR];
    float grey[MOST][FOUR], rising[MOST][FOUR], falling[MOST][FOUR];
    const Index n = patch.size();
    for (Index j = 0; j < n; j++) {
        patch.row(j, points);
        weights_of(points.across, n, across);
        weights_of(points.along, n, along);
        slopes_of(points.across, n, slopes_across);
        slopes_of(points.along, n, slopes_along);
        for (Index i = 0; i < n; i++) {
            const float *at = image.flat + (patch.start() + points.first[i]);
            const Column column(at, image.width, along[i]), sloping(at, image.width, slopes_along[i]);
            column.times(across[i], grey[i]);
            column.times(slopes_across[i], rising[i]);
            sloping.times(across[i], falling[i]);
        }
        sums_of(grey, n, values + j * n);
        sums_of(rising, n, dx + j * n);
        sums_of(falling, n, dy + j * n);
    }
}

void sample_whole_pixels(const SplineImage &image, Index column, Index row, Index half, float *values, float *dx,
                         float *dy) {
    constexpr float SIDE = 1.0f / 6.0f, MIDDLE = 2.0f / 3.0f;
    const Index size = 2 * half + 1;
    // smoothed down each column of three rows, and the slope down it
    float smooth[MOST + 2], slope[MOST + 2];
    for (Index j = 0; j < size; j++) {
        const float *same = image.flat + (row - half + j) * image.width + column - half - 1;
        const float *above = same - image.width, *below = same + image.width;
        for (Index i = 0; i < size + 2; i++) {
            smooth[i] = SIDE * (above[i] + below[i]) + MIDDLE * same[i];
            slope[i] = below[i] - above[i];
        }
        float *__restrict out = values + j * size, *__restrict along = dx + j * size, *__restrict down = dy + j * size;
        for (Index i = 0; i < size; i++) {
            out[i] = SIDE * (smooth[i] + smooth[i + 2]) + MIDDLE * smooth[i + 1];
            along[i] = 0.5f * (smooth[i + 2] - smooth[i]);
            down[i] = 0.5f * (SIDE * (slope[i] + slope[i + 2]) + MIDDLE * slope[i + 1]);
        }
    }
}

}  // namespace bodytrack::patches
