#include "regions/shifts.hpp"

#include <cmath>
#include <vector>

namespace bodytrack::regions {

namespace {

// Places on either side of the contour that must look inside and outside.
constexpr int SUPPORT = 3;

// What their shares must be on average, of 254.
constexpr double LOOKS_INSIDE = 140.0, LOOKS_OUTSIDE = 133.0;

// Probability of being inside, times 254, of places from inside to outside; the contour is between the two middle ones.
// step: their distance, px; deep: how far the line may go into the part, px; beside: parts seen at the SPOTS.
void read_line(const Lines &lines, const Sample &at, const Index *beside, double step, double deep,
               std::vector<double> &shares) {
    const int n = int(shares.size()), half = n / 2;
    for (int s = 0; s < n; s++) {
        const double along = s - half + 0.5;
        if (along * step < -deep) {
            shares[s] = EVEN;
            continue;
        }
        const int colour = lines.picture.at(at.v, at.x + at.nu * along * step, at.y + at.nv * along * step);
        const Index other = along < NEAR ? beside[0] : beside[1];
        const double share = inside_share(lines.looks, at.v, at.p, other, colour, lines.rule.floor);
        shares[s] = share < HIDDEN ? share : double(EVEN);
    }
}

// What a contour that moves out over a place gains in likelihood (255,), by 254 times its chance to be inside: a factor, and
// its logarithm.
struct Gains {
    explicit Gains(double slack) {
        for (int k = 0; k < 255; k++) {
            factors[k] = ((1.0 - slack) * k + slack * (254 - k)) / (slack * k + (1.0 - slack) * (254 - k));
            logarithms[k] = std::log(factors[k]);
        }
    }

    double factors[255], logarithms[255];
};

// Likelihoods (2 reach + 1,) of the shifts of the contour, relative to the largest; its index. They are multiplied outwards
// from there: so none is out of range, however long the line.
int weigh_shifts(const std::vector<double> &shares, const Gains &gains, std::vector<double> &likelihoods) {
    const int n = int(likelihoods.size()) - 1, start = int(shares.size()) / 2 - n / 2;
    const auto place = [&](int d) { return int(shares[start + d] + 0.5); };
    int best = 0;
    double energy = 0.0, most = 0.0;
    for (int d = 0; d < n; d++) {
        energy += gains.logarithms[place(d)];
        if (energy > most) {
            most = energy;
            best = d + 1;
        }
    }
    likelihoods[best] = 1.0;
    for (int d = best; d < n; d++) likelihoods[d + 1] = likelihoods[d] * gains.factors[place(d)];
    for (int d = best; d > 0; d--) likelihoods[d - 1] = likelihoods[d] / gains.factors[place(d - 1)];
    return best;
}

// Whether the places beside a contour look inside and outside, on average.
bool supported(const std::vector<double> &shares, int contour) {
    double inside = 0.0, outside = 0.0;
    for (int k = 0; k < SUPPORT; k++) {
        inside += shares[contour - 1 - k];
        outside += shares[contour + k];
    }
    return inside > SUPPORT * LOOKS_INSIDE && outside < SUPPORT * LOOKS_OUTSIDE;
}

// Mean, px, inverse variance, 1/px^2, and support of the shifts of a line; best: the index of the likeliest.
void write_shift(const std::vector<double> &likelihoods, int best, double step, float *shift) {
    const int n = int(likelihoods.size()), reach = n / 2;
    double total = 0.0, first = 0.0, second = 0.0;
    for (int d = 0; d < n; d++) {
        const double weight = likelihoods[d], moved = d - reach;
        total += weight;
        first += weight * moved;
        second += weight * moved * moved;
    }
    const double mean = first / total;
    // a place is a step wide: a twelfth of its square
    const double variance = (second / total - mean * mean + 1.0 / 12.0) * step * step;
    shift[0] = float(mean * step);
    shift[1] = float(1.0 / std::max(variance, 0.5));
    shift[2] = 0 < best && best < n - 1 ? 1.0f : 0.3f;
}

}  // namespace

void find_shifts(const Lines &lines, const Samples &samples, Array<const Index, 3> beside, Array<const double, 2> cameras,
                 Array<float, 3> shifts) {
    const Rule &rule = lines.rule;
    std::vector<double> shares(2 * (rule.reach + SUPPORT)), likelihoods(2 * rule.reach + 1);
    const Gains gains(rule.slack);
    for (Index v = 0; v < samples.counts.size(); v++)
        for (Index m = 0; m < samples.counts[v]; m++) {
            float *shift = shifts[v][m].data;
            std::fill_n(shift, 3, 0.0f);
            const Sample at(samples, v, m);
            if (!lines.picture.sees(v) || !(at.length > 0.0) || !lines.wanted[at.p] || !lines.looks.known(v, at.p)) continue;
            const double size = pixels_per_metre(cameras[v].data, at.point);
            double step = std::max(size * rule.step_m, 1.0);
            step = std::min(std::max(step, rule.gate_px / double(rule.reach)), rule.widest * step);
            read_line(lines, at, beside[v][m].data, step, DEEPEST * size * lines.looks.half_extents[at.p], shares);
            const int best = weigh_shifts(shares, gains, likelihoods);
            if (supported(shares, SUPPORT + best)) write_shift(likelihoods, best, step, shift);
        }
}

}  // namespace bodytrack::regions
