#include "movements/warping.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace bodytrack::movements {

namespace {

constexpr double INFINITE = std::numeric_limits<double>::infinity();
constexpr float DEGREES = 57.29577951308232f;

// The cheapest way to a frame of the library: its cost, the frame of the recording where it began, and how many known
// frames it passed.
struct Way {
    double cost = INFINITE;
    Index start = 0, passed = 0;
};

// An end of a performance at a frame of the recording: number, beginning, known frames passed.
void tell(Array<Index, 1> told, Index number, Index start, Index passed) {
    told[0] = number;
    told[1] = start;
    told[2] = passed;
}

// The angle of a chord, rad, from its square: by the chord, which is exact near zero where an arc cosine is not. The arc
// sine is that of S. Moshier's Cephes (asinf), good to 3e-7, without a branch.
inline float between(float chord2) {
    const float half2 = std::min(0.25f * chord2, 1.0f), half = std::sqrt(half2);
    const bool wide = half > 0.5f;
    const float z = wide ? 0.5f * (1.0f - half) : half2, root = wide ? std::sqrt(z) : half;
    const float fine = 4.5470025998e-2f + z * (2.4181311049e-2f + z * 4.2163199048e-2f);
    const float series = 1.6666752422e-1f + z * (7.4953002686e-2f + z * fine);
    const float arc = root + root * z * series;
    return wide ? 3.14159265358979f - 4.0f * arc : 2.0f * arc;
}

}  // namespace

void direction_gaps(Array<const float, 3> queried, Array<const float, 3> known, Array<const float, 1> weights,
                    Array<float, 2> gaps) {
    const Index n_known = known.shape[0], n_limbs = queried.shape[1];
    // frames side by side, so that the compiler takes eight at a time: 53 us for 80 and 80 frames in place of 1600
    std::vector<float> aside(3 * n_limbs * n_known), total(n_known);
    for (Index n = 0; n < n_known; n++)
        for (Index k = 0; k < n_limbs; k++)
            for (int axis = 0; axis < 3; axis++) aside[(3 * k + axis) * n_known + n] = known(n, k, axis);
    for (Index t = 0; t < queried.shape[0]; t++) {
        std::fill(total.begin(), total.end(), 0.0f);
        for (Index k = 0; k < n_limbs; k++) {
            const float x = queried(t, k, 0), y = queried(t, k, 1), z = queried(t, k, 2), weight = weights[k];
            const float *xs = &aside[3 * k * n_known], *ys = xs + n_known, *zs = ys + n_known;
            for (Index n = 0; n < n_known; n++) {
                const float dx = xs[n] - x, dy = ys[n] - y, dz = zs[n] - z;
                const float angle = between(dx * dx + dy * dy + dz * dz);
                total[n] += weight * angle * angle;
            }
        }
        for (Index n = 0; n < n_known; n++) gaps(t, n) = DEGREES * std::sqrt(total[n]);
    }
}

double warp_sequence(const Known &known, double unknown, double entry, Array<Index, 2> found) {
    const Index n_frames = known.gaps.shape[0], n_known = known.gaps.shape[1];
    double best = 0.0;
    // met for the first time, for the second time, and the cheaper of both a frame ago
    std::vector<Way> moved(n_known), held(n_known), before(n_known);
    tell(found[0], -2, 0, 0);
    for (Index t = 0; t < n_frames; t++) {
        const auto gap = known.gaps[t];
        for (Index n = 0; n < n_known; n++) {
            before[n] = moved[n].cost <= held[n].cost ? moved[n] : held[n];
            held[n] = moved[n];
            held[n].cost += gap[n];
        }
        const auto told = found[t + 1];
        const double came = best;
        best = came + unknown;
        tell(told, std::isfinite(best) ? -1 : -2, t, 0);
        for (Index k = 0; k < known.slack.size(); k++) {
            const Index low = known.first[k], length = known.first[k + 1] - low, slack = known.slack[k];
            const bool repeats = known.repeats[k];
            const Index least = repeats ? slack : 0;
            for (Index j = 0; j < length; j++) {
                Way way{repeats || j <= slack ? came + entry : INFINITE, t, 1};
                for (Index step = 1; step <= 2; step++) {
                    if (j < step && !repeats) continue;
                    // round a performance of one frame as well, as Python's remainder goes
                    const Index i = ((j - step) % length + length) % length;
                    const Way &from = before[low + i];
                    if (from.cost < way.cost) way = {from.cost, from.start, from.passed + step};
                }
                way.cost += gap[low + j];
                moved[low + j] = way;
                if (!repeats && j < length - 1 - slack) continue;
                for (const Way &end : {way, held[low + j]})
                    if (end.cost < best && t + 1 - end.start >= least) {
                        best = end.cost;
                        tell(told, k, end.start, end.passed);
                    }
            }
        }
    }
    return best;
}

}  // namespace bodytrack::movements
