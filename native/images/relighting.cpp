#include "images/relighting.hpp"

#include <algorithm>
#include <vector>

#include "images/light.hpp"

namespace bodytrack::images {

namespace {

constexpr Index N_CHANNELS = 3;

// So many numbers of a row are computed at a time.
constexpr Index BLOCK = 32;

// The two nodes of a line of n between which a place lies, and how far it is from the first to the second.
struct Between {
    Index first, second;
    float share;

    Between(double place, Index n) {
        const double inside = std::min(std::max(place, 0.0), double(n - 1));
        first = std::min(Index(inside), std::max(n - 2, Index(0)));
        second = std::min(first + 1, n - 1);
        share = float(inside - double(first));
    }
};

// The gains (m, 3) of a row of blocks at every pixel.
void widen(Array<const float, 2> gains, const std::vector<Between> &columns, float *__restrict wide) {
    for (const auto &[first, second, share] : columns) {
        const float *left = gains[first].data, *right = gains[second].data;
        for (Index c = 0; c < N_CHANNELS; c++) *wide++ = left[c] + share * (right[c] - left[c]);
    }
}

// n numbers of a plate, with gains that are a share of the way from those above to those below.
inline void relight_some(const Byte *__restrict row, const float *__restrict above, const float *__restrict way,
                         float share, Index n, Byte *__restrict lit) {
    const float dark = float(DARK), half = 0.5f, most = 255.5f;
    for (Index x = 0; x < n; x++) {
        const float level = (float(row[x]) + dark) * (above[x] + share * way[x]) + (half - dark);
        lit[x] = Byte(std::int32_t(std::min(std::max(level, half), most)));
    }
}

// The same by whole blocks; the last one begins early, for single numbers would take as long as all blocks.
void relight_row(const Byte *row, const float *above, const float *way, float share, Index n, Byte *lit) {
    if (n < BLOCK) return relight_some(row, above, way, share, n, lit);
    for (Index x = 0; x < n; x += BLOCK) {
        const Index k = std::min(x, n - BLOCK);
        relight_some(row + k, above + k, way + k, share, BLOCK, lit + k);
    }
}

}  // namespace

void relight(Array<const Byte, 3> picture, Array<const float, 3> gains, double size, const Geometry &geometry,
             Array<Byte, 3> lit) {
    const Index height = lit.shape[0], width = lit.shape[1], length = width * N_CHANNELS;
    const auto place = [&](Index start, Index k) {
        return (double(start) + double(k) * double(geometry.spacing) + 0.5) / size - 0.5;
    };
    std::vector<Between> columns;
    for (Index x = 0; x < width; x++) columns.emplace_back(place(geometry.x, x), gains.shape[1]);
    // gains of every pixel along the row of blocks above, and the way from there to those along the row below
    std::vector<float> above(static_cast<std::size_t>(length)), way(above.size());
    Index known = -1;
    for (Index y = 0; y < height; y++) {
        const Between at(place(geometry.y, y), gains.shape[0]);
        if (at.first != known) {
            known = at.first;
            widen(gains[at.first], columns, above.data());
            widen(gains[at.second], columns, way.data());
            for (std::size_t k = 0; k < way.size(); k++) way[k] -= above[k];
        }
        relight_row(picture.data + y * length, above.data(), way.data(), at.share, length, lit.data + y * length);
    }
}

}  // namespace bodytrack::images
