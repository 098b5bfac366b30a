// Lines across the contour: places along the normal of each of its samples, and what they show.
//
// Each visible contour sample carries a line along its normal (correspondence lines: Tjaden et al., PAMI 2018; Stoiber et
// al., ACCV 2020). Every place on it is inside with a probability that the colour tables give.
//
// Places are steps apart, a length on the body, so that lines cover the same stretch of skin and background in every
// resolution. Where another part of a body is expected beside the contour, its colours take the place of the background's.
#pragma once
#include <algorithm>

#include "regions/colours.hpp"

namespace bodytrack::regions {

// Steps outside of the contour at which is asked what part is seen there. Places up to the middle of the two belong to the
// first; those inside too, which would show it if the contour moved inwards.
constexpr double SPOTS[2] = {4.0, 9.0};

// Steps outside up to which the part seen at the first spot counts.
constexpr double NEAR = 0.5 * (SPOTS[0] + SPOTS[1]);

// No part is seen at a spot.
constexpr Index BACKGROUND = -1;

// A line reaches this deep into a part, in smaller half extents: beyond its axis it comes out on the other side.
constexpr double DEEPEST = 1.7;

// Contour samples of poses, laid out as in `Contours`: of one pose (V, M, 5), (V, M, 3), (V, M) and (V,).
struct Samples {
    Array<const float, 3> positions, points;
    Array<const Index, 2> parts;
    Array<const Index, 1> counts;
};

// A contour sample in view v.
struct Sample {
    Index v, p;
    // pixel, and unit image normal
    double x, y, nu, nv;
    // contour length, px
    double length;
    // in the world, metres
    double point[3];

    Sample(const Samples &samples, Index view, Index m) : v(view), p(samples.parts(view, m)) {
        const float *at = samples.positions[v][m].data, *place = samples.points[v][m].data;
        x = at[rows::sample::U];
        y = at[rows::sample::V];
        nu = at[rows::sample::NU];
        nv = at[rows::sample::NV];
        length = at[rows::sample::LENGTH];
        std::copy_n(place, 3, point);
    }

    // Of a row of `trace_view`.
    Sample(Index view, const float *traced)
        : v(view), p(Index(traced[rows::sample::PART])), x(traced[rows::sample::U]), y(traced[rows::sample::V]),
          nu(traced[rows::sample::NU]), nv(traced[rows::sample::NV]), length(traced[rows::sample::LENGTH]),
          point{traced[rows::sample::X], traced[rows::sample::Y], traced[rows::sample::Z]} {}
};

// What is known of the colours of a scene's parts.
struct Looks {
    Tables<const float> tables;
    // (V, P, 4096) see `tabulate_posteriors`
    Array<const Byte, 3> posteriors;
    // (V, P) parts whose colours were learnt in a view
    Array<const bool, 2> known;
    // (P,) smaller half extent of each part across its axis, metres
    Array<const double, 1> half_extents;
};

// How lines are read.
struct Rule {
    // distance of places on the body, metres; never less than a pixel
    double step_m;
    // largest shift, steps
    Index reach;
    // probability that a place belongs to the other side in spite of its colour
    double slack;
    // share that a colour never seen has
    double floor;
    // how far the contour may be off, px: lines reach so far, with wider steps
    double gate_px;
    // most that steps are widened for it, a factor
    double widest;
};

// What contours are compared with: colours seen, colours known, the parts (P,) whose contours count.
struct Lines {
    Picture picture;
    Looks looks;
    Array<const bool, 1> wanted;
    Rule rule;
};

// Size in the image of a packed camera of a metre across the viewing ray of a world point, px; 0 behind the camera.
inline double pixels_per_metre(const double *camera, const double *point) {
    using namespace rows::camera;
    const double depth = camera[R31] * point[0] + camera[R32] * point[1] + camera[R33] * point[2] + camera[TZ];
    return depth > 1e-6 ? camera[FX] / depth : 0.0;
}

// 254 times the probability that a pixel of a colour is of part p and not of what is beside it; or HIDDEN.
inline double inside_share(const Looks &looks, Index v, Index p, Index beside, int colour, double floor) {
    if (colour < 0) return EVEN;
    const Byte posterior = looks.posteriors(v, p, colour);
    if (beside == BACKGROUND || posterior == HIDDEN) return posterior;
    if (!looks.known(v, beside)) return EVEN;
    const double own = looks.tables.inside(v, p, colour) + floor;
    // as far as the posteriors go
    return 254.0 * std::min(std::max(own / (own + looks.tables.inside(v, beside, colour) + floor), 0.018), 0.982);
}

}  // namespace bodytrack::regions
