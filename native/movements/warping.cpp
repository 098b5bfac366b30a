#include "movements/warping.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace bodytrack::movements {

namespace {

constexpr double INFINITE = std::numeric_limits<double>::infinity();
constexpr double DEGREES = 57.29577951308232;

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

}  // namespace

void direction_gaps(Array<const float, 3> queried, Array<const float, 3> known, Array<float, 2> gaps) {
    const Index n_limbs = queried.shape[1];
    for (Index t = 0; t < queried.shape[0]; t++)
        for (Index n = 0; n < known.shape[0]; n++) {
            double total = 0.0;
            for (Index k = 0; k < n_limbs; k++) {
                double chord2 = 0.0;
                for (int axis = 0; axis < 3; axis++) {
                    const double gap = double(queried(t, k, axis)) - double(known(n, k, axis));
                    chord2 += gap * gap;
                }
                // by the chord, which is exact near zero where an arc cosine is not
                const double angle = 2.0 * std::asin(std::min(1.0, 0.5 * std::sqrt(chord2)));
                total += angle * angle;
            }
            gaps(t, n) = float(DEGREES * std::sqrt(total / double(n_limbs)));
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
