#include "patches/matching.hpp"

#include <algorithm>
#include <cmath>

#include "patches/sigma.hpp"

namespace bodytrack::patches {

namespace {

using namespace found;

// Grey levels: rounding.
constexpr float NO_TEXTURE = 1e-3f;

// Samples the template patch, whose normal equations the inverse form solves once for all iterations; a deviation of 0
// where it has no texture.
Moments fix_template(const SplineImage &image, const double *identity, const Rule &rule, Workspace &work) {
    const Index n = rule.n_pixels(), column = Index(std::floor(identity[0])), row = Index(std::floor(identity[1]));
    float *fixed = work.fixed.data(), *dx = work.design[0].data(), *dy = work.design[3].data();
    if (identity[0] == double(column) && identity[1] == double(row))
        sample_whole_pixels(image, column, row, rule.half, fixed, dx, dy);
    else sample_gradient(image, identity, rule.half, fixed, dx, dy);
    const Moments of = moments(fixed, n);
    if (!(of.deviation > NO_TEXTURE)) return {of.mean, 0.0f};
    if (rule.classical) return of;
    complete_design(work, fixed, of, 1.0, rule.half);
    fill_normal(work, n, rule.prior / double(rule.half * rule.half));
    return factorize(work.normal, work.factor) ? of : Moments{of.mean, 0.0f};
}

// Right side of the normal equations at the present warp, and for the classical form the equations themselves.
// Returns the sum of the squared residuals, grey levels; -1 where there is no texture.
double linearize(const SplineImage &search, double *found, const double *start, Moments of_template, bool first,
                 const Rule &rule, Workspace &work, Vector &right) {
    const Index n = rule.n_pixels();
    const double half = double(rule.half);
    float *grey = work.grey.data();
    if (rule.classical)
        sample_gradient(search, found, rule.half, grey, work.design[0].data(), work.design[3].data());
    else sample_patch(search, found, rule.half, grey);
    if (first || rule.classical) {
        const Moments of = moments(grey, n);
        if (!(of.deviation > NO_TEXTURE)) return -1.0;
        if (first) {
            found[CONTRAST] = of_template.deviation / of.deviation;
            found[BRIGHTNESS] = of_template.mean - found[CONTRAST] * of.mean;
        }
        if (rule.classical) {
            complete_design(work, grey, of, found[CONTRAST], rule.half);
            fill_normal(work, n, rule.prior / (half * half));
            if (!factorize(work.normal, work.factor)) return -1.0;
        }
    }
    fill_residuals(work, found[BRIGHTNESS], found[CONTRAST], n);
    // a step of the template brings it to the search patch; a step of the search patch brings it to the template
    const double sign = rule.classical ? -1.0 : 1.0;
    const float *residual = work.residual.data();
    for (int k = 0; k < N_PARAMETERS; k++) right[k] = sign * double(dot(work.design[k].data(), residual, n));
    for (int j = 0; j < 4; j++) right[AFFINE[j]] += sign * rule.prior / half * (found[2 + j] - start[2 + j]);
    return dot(residual, residual, n);
}

// How far a step moves a corner, px.
double reach(const Vector &step) {
    return std::max(std::abs(step[0]) + std::abs(step[1]) + std::abs(step[2]),
                    std::abs(step[3]) + std::abs(step[4]) + std::abs(step[5]));
}

// Inverse composition: warp and radiometry after the inverse of the template's step.
void compose(double *found, const Vector &step, double half, Moments of_template) {
    const double a = 1.0 + step[1] / half, b = step[2] / half, c = step[4] / half, d = 1.0 + step[5] / half;
    const double inverse = 1.0 / (a * d - b * c);
    const double m0 = d * inverse, m1 = -b * inverse, m2 = -c * inverse, m3 = a * inverse;
    for (const int row : {XX_OF, YX_OF}) {
        const double first = found[row], second = found[row + 1];
        found[row] = first * m0 + second * m2;
        found[row + 1] = first * m1 + second * m3;
    }
    found[X] -= found[XX_OF] * step[0] + found[XY_OF] * step[3];
    found[Y] -= found[YX_OF] * step[0] + found[YY_OF] * step[3];
    const double growth = step[7] / of_template.deviation;
    found[BRIGHTNESS] = (found[BRIGHTNESS] - step[6] + growth * of_template.mean) / (1.0 + growth);
    found[CONTRAST] /= 1.0 + growth;
}

// The classical update: parameters add up.
void add(double *found, const Vector &step, double half, Moments of_search) {
    found[X] += step[0];
    found[Y] += step[3];
    found[XX_OF] += step[1] / half;
    found[XY_OF] += step[2] / half;
    found[YX_OF] += step[4] / half;
    found[YY_OF] += step[5] / half;
    const double growth = step[7] / of_search.deviation;
    found[BRIGHTNESS] += step[6] - growth * of_search.mean;
    found[CONTRAST] += growth;
}

}  // namespace

Ended match_patch(const Images &images, const double *at, double *found, const Rule &rule, const Noise &noise,
                  Workspace &work) {
    const double identity[6] = {at[0], at[1], 1.0, 0.0, 0.0, 1.0}, half = double(rule.half);
    double start[6];
    std::copy_n(found, 6, start);
    if (reaches_out(identity, rule.half, images.template_image) || reaches_out(found, rule.half, images.search))
        return OUTSIDE;
    const Moments of_template = fix_template(images.template_image, identity, rule, work);
    if (!(of_template.deviation > 0.0f)) return WEAK;
    double before = 0.0;
    for (Index iteration = 0; iteration < rule.most_iterations; iteration++) {
        Vector right, step;
        double squares = linearize(images.search, found, start, of_template, iteration == 0, rule, work, right);
        if (!(squares >= 0.0)) return WEAK;
        std::copy_n(right, N_PARAMETERS, step);
        solve(work.factor, step);
        for (int k = 0; k < N_PARAMETERS; k++) squares -= step[k] * right[k];
        if (rule.classical) add(found, step, half, moments(work.grey.data(), rule.n_pixels()));
        else compose(found, step, half, of_template);
        if (!(std::abs(found[X] - start[0]) <= rule.farthest && std::abs(found[Y] - start[1]) <= rule.farthest))
            return DRIFTED;
        if (reaches_out(found, rule.half, images.search)) return OUTSIDE;
        // steps shrink by a nearly constant factor: what is left to go is their geometric series
        const double moved = reach(step);
        if (moved < 0.1 * rule.tolerance || moved * moved < rule.tolerance * (before - moved)) {
            found[ITERATIONS] = double(iteration + 1);
            found[HALF_PATCH] = half;
            const bool precise = found[CONTRAST] > 0.0 &&
                                 estimate_precision(found, squares, of_template.deviation, rule, noise, work);
            return precise ? MATCHED : WEAK;
        }
        before = moved;
    }
    return NOT_CONVERGED;
}

void match_patches(const Images &images, Array<const double, 2> at, Array<double, 2> found, Array<Index, 1> ended,
                   const Rule &rule, const Noise &noise) {
    Workspace work(rule.half, noise.taps.size());
    for (Index k = 0; k < at.shape[0]; k++)
        ended[k] = match_patch(images, at[k].data, found[k].data, rule, noise, work);
}

}  // namespace bodytrack::patches
