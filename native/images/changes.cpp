#include "images/changes.hpp"

#include <algorithm>
#include <vector>

namespace bodytrack::images {

namespace {

// n pixels of three channels; gaps (3 n) is scratch.
void mark_row(const Byte *__restrict row, const Byte *__restrict plate, Byte most, Index n, Byte *__restrict gaps,
              Byte *__restrict moving) {
    for (Index k = 0; k < 3 * n; k++) gaps[k] = Byte(std::max(row[k], plate[k]) - std::min(row[k], plate[k]));
    for (Index x = 0; x < n; x++)
        moving[x] = std::max(std::max(gaps[3 * x], gaps[3 * x + 1]), gaps[3 * x + 2]) > most ? 1 : 0;
}

}  // namespace

void mark_changes(Array<const Byte, 3> image, Array<const Byte, 3> plate, Index x, Index y, double level,
                  Array<Byte, 2> moving) {
    const Byte most = Byte(std::min(level, 255.0));
    std::vector<Byte> gaps(std::size_t(3 * moving.shape[1]));
    for (Index row = 0; row < moving.shape[0]; row++)
        mark_row(&image(row + 1, 1, 0), plate.data + ((y + row) * plate.shape[1] + x) * 3, most, moving.shape[1],
                 gaps.data(), moving[row].data);
}

double median_level(Array<const Byte, 2> picture) {
    constexpr int N_LEVELS = 256;
    const Index n = picture.size();
    // neighbours are often alike, and a count must be written before it is read again
    Index counts[N_LEVELS] = {}, others[N_LEVELS] = {};
    for (Index i = 0; i + 1 < n; i += 2) {
        counts[picture.data[i]]++;
        others[picture.data[i + 1]]++;
    }
    if (n % 2 == 1) counts[picture.data[n - 1]]++;
    for (int level = 0; level < N_LEVELS; level++) counts[level] += others[level];
    int total = 0;
    for (const Index rank : {(n - 1) / 2, n / 2}) {
        int least = 0;
        for (Index below = counts[0]; below <= rank && least < N_LEVELS - 1;) below += counts[++least];
        total += least;
    }
    return 0.5 * total;
}

void large_regions(Array<const std::int32_t, 2> labels, Index n_labels, double least, Array<bool, 2> mask) {
    std::vector<Index> areas(static_cast<std::size_t>(n_labels), 0);
    // pixels of one label next to each other are taken together
    struct Run {
        Index end;
        std::int32_t label;
    };
    std::vector<Run> runs;
    for (Index i = 0, end; i < labels.size(); i = end) {
        const std::int32_t label = labels.data[i];
        for (end = i + 1; end < labels.size() && labels.data[end] == label;) end++;
        areas[std::size_t(label)] += end - i;
        runs.push_back({end, label});
    }
    areas[0] = 0;
    const double smallest = std::max(least * double(*std::max_element(areas.begin(), areas.end())), 1.0);
    Index begin = 0;
    for (const auto [end, label] : runs) {
        std::fill(mask.data + begin, mask.data + end, double(areas[std::size_t(label)]) >= smallest);
        begin = end;
    }
}

}  // namespace bodytrack::images
