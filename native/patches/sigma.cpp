#include "patches/sigma.hpp"

#include <algorithm>
#include <cmath>

#include "patches/matching.hpp"

namespace bodytrack::patches {

namespace {

// Variances and covariance of both shifts.
struct Covariance {
    double xx, yy, xy;
};

// A patch of `size` pixels a side with as much room right and below as the smoothing reaches, and zeros before and
// behind.
struct Padded {
    Index size, n_taps, wide, lead;

    Padded(Index size, Index n_taps)
        : size(size), n_taps(n_taps), wide(size + n_taps - 1), lead(wide * n_taps) {}
};

// How much each residual moves a shift, from the row of the inverse normal matrix; rows padded with zeros.
void fill_influence(const Workspace &work, const Vector &row, const Padded &padded, std::vector<float> &out) {
    float r[N_PARAMETERS];
    for (int k = 0; k < N_PARAMETERS; k++) r[k] = float(row[k]);
    std::fill(out.begin(), out.end(), 0.0f);
    for (Index y = 0; y < padded.size; y++) {
        const float *part[N_PARAMETERS];
        for (int k = 0; k < N_PARAMETERS; k++) part[k] = work.design[k].data() + y * padded.size;
        float *__restrict line = out.data() + padded.lead + y * padded.wide;
        for (Index x = 0; x < padded.size; x++) {
            const float first = r[0] * part[0][x] + r[1] * part[1][x] + r[2] * part[2][x] + r[3] * part[3][x];
            const float second = r[4] * part[4][x] + r[5] * part[5][x] + r[6] * part[6][x] + r[7] * part[7][x];
            line[x] = first + second;
        }
    }
}

// Sums of n values and those so many strides before them, weighted with the taps.
void correlate(const float *values, Array<const float, 1> taps, Index stride, Index n, float *__restrict sums) {
    std::fill(sums, sums + n, 0.0f);
    for (Index t = 0; t < taps.size(); t++) {
        const float weight = taps[t], *__restrict behind = values - t * stride;
        for (Index i = 0; i < n; i++) sums[i] += weight * behind[i];
    }
}

// Variances and covariance of both shifts for white noise of variance 1 that was smoothed with the taps; rows (2) of
// the inverse normal matrix.
Covariance propagated(const Vector (&rows)[2], Index size, Array<const float, 1> taps, Workspace &work) {
    const Padded padded(size, taps.size());
    const Index lead = padded.lead, wide = padded.wide;
    for (int axis = 0; axis < 2; axis++) {
        auto &influence = work.influences[axis], &passed = work.passed;
        fill_influence(work, rows[axis], padded, influence);
        if (padded.n_taps == 1) continue;
        // what a patch of another size has left there
        std::fill(passed.begin(), passed.end(), 0.0f);
        correlate(influence.data() + lead, taps, 1, size * wide, passed.data() + lead);
        correlate(passed.data() + lead, taps, wide, wide * wide, influence.data() + lead);
    }
    const float *along = work.influences[0].data() + lead, *down = work.influences[1].data() + lead;
    const Index n = wide * wide;
    return {dot(along, along, n), dot(down, down, n), dot(along, down, n)};
}

}  // namespace

// Noise n in the images enlarges the normal matrix N by the power of its own gradients G, but these gradients say
// nothing about the shift: its covariance is 2 s^2 (N - G)^-1 N (N - G)^-1, not sigma0^2 N^-1. Where the images were
// smoothed, neighbouring residuals agree by chance: s^2 follows from sigma0 by the power that the smoothing leaves, and
// the noise passes the estimator through the smoothing.
bool estimate_precision(double *found, double squares, double spread, const Rule &rule, const Noise &noise,
                        Workspace &work) {
    const double half = double(rule.half), n = double(rule.n_pixels());
    const double sigma0_2 = std::max(squares, 0.0) / (n - N_PARAMETERS), raw = sigma0_2 / noise.residual_gain;
    const double gradients = raw * noise.gradient_gain * n, by_affine = (half + 1.0) / (3.0 * half);
    Matrix reduced;
    std::copy(&work.normal[0][0], &work.normal[0][0] + N_PARAMETERS * N_PARAMETERS, &reduced[0][0]);
    for (int k = 0; k < 6; k++) reduced[k][k] -= gradients * (k % 3 == 0 ? 1.0 : by_affine);
    if (!factorize(reduced, work.factor)) return false;
    Vector rows[2] = {};
    for (int axis = 0; axis < 2; axis++) {
        rows[axis][3 * axis] = 1.0;
        solve(work.factor, rows[axis]);
    }
    auto [xx, yy, xy] = propagated(rows, 2 * rule.half + 1, noise.taps, work);
    const double weight = rule.prior / (half * half);
    for (const int k : AFFINE) {
        xx += weight * rows[0][k] * rows[0][k];
        yy += weight * rows[1][k] * rows[1][k];
        xy += weight * rows[0][k] * rows[1][k];
    }
    const bool classical = rule.classical;
    const double a = classical ? 1.0 : found[found::XX_OF], b = classical ? 0.0 : found[found::XY_OF];
    const double c = classical ? 0.0 : found[found::YX_OF], d = classical ? 1.0 : found[found::YY_OF];
    found[found::SIGMA0] = std::sqrt(sigma0_2);
    found[found::VARIANCE_X] = 2.0 * raw * (a * a * xx + 2.0 * a * b * xy + b * b * yy);
    found[found::VARIANCE_Y] = 2.0 * raw * (c * c * xx + 2.0 * c * d * xy + d * d * yy);
    found[found::COVARIANCE] = 2.0 * raw * (a * c * xx + (a * d + b * c) * xy + b * d * yy);
    found[found::CORRELATION] = std::sqrt(std::max(0.0, 1.0 - squares / (n * spread * spread)));
    return true;
}

}  // namespace bodytrack::patches
