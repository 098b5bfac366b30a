#include "pictures/coverage.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "contours/scoring.hpp"
#include "pictures/pixels.hpp"
#include "pictures/silhouettes.hpp"
#include "projection.hpp"

namespace bodytrack::pictures {

namespace {

// One view of the pictures.
struct Region {
    Region(const Weighted &weighted, Index v)
        : camera(weighted.cameras[v].data), start(weighted.regions(v, 0)), width(weighted.regions(v, 1)),
          height(weighted.regions(v, 2)) {}

    const double *camera;
    Index start, width, height;
};

// Rows of pixels of a part, and where each begins and ends.
struct Filled {
    explicit Filled(Index height) : extents(height) {}

    template <class Take>
    void each(const Region &region, Take take) const {
        for (Index row = first; row < end; row++) {
            const Index last = last_pixel(extents.right[row], region.width), at = region.start + row * region.width;
            for (Index column = first_pixel(extents.left[row]); column <= last; column++) take(at + column);
        }
    }

    Extents extents;
    Index first = 0, end = 0;
};

// Finds the rows of a part; pixels (3, R C) is workspace.
void fill(const double *placement, const Rings &rings, Index p, const double *camera, std::vector<double> &pixels,
          Filled &filled) {
    filled.first = filled.end = 0;
    const int n_rows = rings.n_rows, n_columns = rings.n_columns, n = n_rows * n_columns;
    if (!(project_grid(placement, rings.points[p], camera, pixels.data()) > NEAREST_M)) return;
    const double *us = pixels.data(), *vs = us + n;
    const auto [low, high] = std::minmax_element(vs, vs + n);
    filled.first = first_pixel(*low);
    filled.end = last_pixel(*high, filled.extents.height()) + 1;
    filled.extents.clear(filled.first, filled.end);
    const auto widen = [&](int i, int j) { filled.extents.widen(us[i], vs[i], us[j], vs[j]); };
    for (int r = 0; r < n_rows; r++)
        for (int c = 0; c < n_columns; c++) {
            const int i = r * n_columns + c;
            widen(i, r * n_columns + (c + 1) % n_columns);
            if (r + 1 < n_rows) widen(i, i + n_columns);
        }
}

std::vector<double> workspace(const Rings &rings) { return std::vector<double>(size_t(3) * rings.n_rows * rings.n_columns); }

}  // namespace

void cover_still(Array<const double, 3> placements, Array<const bool, 1> still, const Rings &rings,
                 const Weighted &weighted, Array<bool, 1> covered, Array<double, 2> sums) {
    std::fill_n(covered.data, covered.size(), false);
    std::fill_n(sums.data, sums.size(), 0.0);
    auto pixels = workspace(rings);
    for (Index v = 0; v < sums.shape[0]; v++) {
        const Region region(weighted, v);
        if (region.width == 0) continue;
        Filled filled(region.height);
        for (Index p = 0; p < still.size(); p++) {
            if (!still[p]) continue;
            fill(placements[p].data, rings, p, region.camera, pixels, filled);
            filled.each(region, [&](Index at) {
                if (covered[at]) return;
                covered[at] = true;
                for (int k = 0; k < 2; k++) sums(v, k) += weighted.pictures(at, k);
            });
        }
    }
}

void covered_sums(Array<const double, 4> placements, Array<const bool, 1> moving, const Rings &rings,
                  const Weighted &weighted, Array<const bool, 1> covered, Array<const double, 2> base,
                  Array<double, 3> sums) {
    std::fill_n(sums.data, sums.size(), 0.0);
    auto pixels = workspace(rings);
    // the pose that covered a pixel last
    std::vector<std::int32_t> last(covered.size(), -1);
    for (Index v = 0; v < base.shape[0]; v++) {
        const Region region(weighted, v);
        if (region.width == 0) continue;
        std::vector<Filled> filled(moving.size(), Filled(region.height));
        for (Index b = 0; b < placements.shape[0]; b++) {
            double first = base(v, 0), second = base(v, 1);
            for (Index p = 0; p < moving.size(); p++) {
                if (!moving[p]) continue;
                if (!contours::repeats(placements, b, p))
                    fill(placements[b][p].data, rings, p, region.camera, pixels, filled[p]);
                filled[p].each(region, [&](Index at) {
                    if (covered[at] || last[at] == b) return;
                    last[at] = std::int32_t(b);
                    first += weighted.pictures(at, 0);
                    second += weighted.pictures(at, 1);
                });
            }
            sums(b, v, 0) = first;
            sums(b, v, 1) = second;
        }
    }
}

void cover_shares(Array<const bool, 2> mask, Index factor, Array<float, 2> shares) {
    const Index width = mask.shape[1];
    std::vector<std::uint16_t> counts(width);
    const float share = 1.0f / float(factor * factor);
    for (Index row = 0; row < shares.shape[0]; row++) {
        const bool *rows = mask[row * factor].data;
        // most rows of a silhouette are empty
        if (!std::memchr(rows, 1, size_t(factor * width))) {
            std::fill_n(shares[row].data, shares.shape[1], 0.0f);
            continue;
        }
        std::fill(counts.begin(), counts.end(), std::uint16_t(0));
        for (Index y = row * factor; y < (row + 1) * factor; y++) {
            const bool *covered = mask[y].data;
            std::uint16_t *sums = counts.data();
            for (Index x = 0; x < width; x++) sums[x] = std::uint16_t(sums[x] + covered[x]);
        }
        for (Index column = 0; column < shares.shape[1]; column++) {
            int covered = 0;
            for (Index x = column * factor; x < (column + 1) * factor; x++) covered += counts[x];
            shares(row, column) = float(covered) * share;
        }
    }
}

}  // namespace bodytrack::pictures
