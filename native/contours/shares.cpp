#include "contours/shares.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rows.hpp"

namespace bodytrack::contours {

namespace {

using namespace rows;

// Chamfer image of view v at the pixel nearest to a position; `outside` beyond its region.
double nearest_gap(const Edges &edges, Index v, double x, double y, double outside) {
    const Index *at = edges.regions[v].data;
    const double column = std::nearbyint(x) - double(at[region::LEFT]), row = std::nearbyint(y) - double(at[region::TOP]);
    if (!(column >= 0.0 && row >= 0.0 && column < double(at[region::WIDTH]) && row < double(at[region::HEIGHT])))
        return outside;
    return edges.flat[at[region::START] + Index(row) * at[region::WIDTH] + Index(column)];
}

}  // namespace

void edge_shares(Array<const float, 3> positions, Array<const Index, 2> parts, Array<const Index, 1> counts,
                 const Edges &edges, Array<const float, 1> reach, const Nearness &near, Array<double, 3> sums) {
    std::fill_n(sums.data, sums.size(), 0.0);
    std::vector<double> xs(parts.shape[1]), ys(parts.shape[1]);
    for (Index v = 0; v < counts.size(); v++) {
        if (!edges.sees(v)) continue;
        const Index n = counts[v];
        for (Index m = 0; m < n; m++) {
            const float *from = positions[v][m].data;
            xs[m] = from[sample::U];
            ys[m] = from[sample::V];
            const double length = from[sample::LENGTH], gap = nearest_gap(edges, v, xs[m], ys[m], reach[v]);
            if (gap < 0.0) continue;
            const Index p = parts(v, m);
            sums(0, v, p) += length;
            sums(1, v, p) += length * gap;
            if (gap <= near.explained) sums(2, v, p) += length;
        }
        for (Index i = edges.first[v]; n > 0 && i < edges.first[v + 1]; i++) {
            const float *point = edges.points[i].data;
            const double x = point[scene_point::X], y = point[scene_point::Y];
            double least = std::numeric_limits<double>::infinity();
            Index nearest = 0;
            for (Index m = 0; m < n; m++) {
                const double square = (xs[m] - x) * (xs[m] - x) + (ys[m] - y) * (ys[m] - y);
                if (square < least) {
                    least = square;
                    nearest = m;
                }
            }
            if (std::sqrt(least) > near.missed) sums(3, v, parts(v, nearest)) += point[scene_point::WEIGHT];
        }
    }
}

}  // namespace bodytrack::contours
