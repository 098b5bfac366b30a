#include "regions/colours.hpp"

#include <algorithm>

namespace bodytrack::regions {

namespace {

// Of each channel.
constexpr int BINS = 16;

// A colour is the hider's where it is so much more frequent than in the part, and no stray one; as in `hides` of
// tracker.kernels.regions.
constexpr double HIDES = 3.0, LEAST_HIDER = 1e-3;

// Fewer pixels than this teach nothing: a table of a handful of colours calls every other one strange.
constexpr Index LEAST_PIXELS = 20;

int clamped(int bin) { return std::min(std::max(bin, 0), BINS - 1); }

// Adds colour counts (4096,), each spread 1-2-1 over its neighbours in all channels, times a factor. A Parzen window: 300
// pixels are too few for 4096 bins. Beyond the end of a channel the weight stays in the last bin.
void spread_colours(const Index *counts, float *table, double factor) {
    for (int colour = 0; colour < N_COLOURS; colour++) {
        if (counts[colour] == 0) continue;
        const int high = colour >> 8, middle = colour >> 4 & 15, low = colour & 15;
        const double share = factor * double(counts[colour]) / 64.0;
        for (int i = -1; i <= 1; i++) {
            const int first = clamped(high + i) << 8;
            for (int j = -1; j <= 1; j++) {
                const int second = first | clamped(middle + j) << 4;
                const double weight = share * ((2 - std::abs(i)) * (2 - std::abs(j)));
                for (int k = -1; k <= 1; k++) {
                    float &entry = table[second | clamped(low + k)];
                    entry = float(entry + weight * (2 - std::abs(k)));
                }
            }
        }
    }
}

}  // namespace

void encode(const Byte *picture, Index n, Code *codes) {
    for (Index k = 0; k < n; k++) {
        const Byte *levels = picture + 3 * k;
        codes[k] = Code((levels[0] >> 4) << 8 | (levels[1] & 240) | levels[2] >> 4);
    }
}

bool learn_colours(const Index *counts, double news, float *table) {
    Index total = 0;
    for (int colour = 0; colour < N_COLOURS; colour++) total += counts[colour];
    if (total < LEAST_PIXELS) return false;
    const double rate = *std::max_element(table, table + N_COLOURS) > 0.0f ? news : 1.0;
    for (int colour = 0; colour < N_COLOURS; colour++) table[colour] = float(table[colour] * (1.0 - rate));
    spread_colours(counts, table, rate / double(total));
    return true;
}

void tabulate_posteriors(const Tables<const float> &tables, double floor, double most, Array<const bool, 2> wanted,
                         Array<Byte, 3> posteriors) {
    const double low = 1.0 / (1.0 + std::exp(most));
    for (Index v = 0; v < wanted.shape[0]; v++)
        for (Index p = 0; p < wanted.shape[1]; p++) {
            if (!wanted(v, p)) continue;
            const float *own = tables.inside[v][p].data, *others = tables.outside[v][p].data;
            const float *hiders = tables.hiders[v].data;
            Byte *entries = posteriors[v][p].data;
            for (int colour = 0; colour < N_COLOURS; colour++) {
                const double inside = own[colour] + floor, share = inside / (inside + others[colour] + floor);
                const bool hidden = (hiders[colour] > LEAST_HIDER) & (hiders[colour] > HIDES * own[colour]);
                const Byte entry = Byte(int(254.0 * std::min(std::max(share, low), 1.0 - low) + 0.5));
                entries[colour] = hidden ? HIDDEN : entry;
            }
        }
}

}  // namespace bodytrack::regions
