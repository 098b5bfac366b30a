#include "body/wrenches.hpp"

#include <algorithm>

namespace bodytrack::body {

void End::add(const Point &point, const Point &gradient, double pull, double weight) {
    const auto &[x, y, z] = point;
    const auto &[gx, gy, gz] = gradient;
    const double wrench[6] = {gx, gy, gz, y * gz - z * gy, z * gx - x * gz, x * gy - y * gx};
    for (int i = 0; i < 6; i++) {
        pulls[i] += pull * wrench[i];
        const double weighted = weight * wrench[i];
        for (int j = 0; j <= i; j++) wrenches[i][j] += weighted * wrench[j];
    }
    used = true;
}

void chain(const std::vector<End> &ends, const Motion &motion, Array<double, 2> matrix, Array<double, 1> vector) {
    const auto twists = motion.twists;
    const auto moves = motion.moves;
    const Index dof = twists.shape[0];
    std::fill_n(matrix.data, matrix.size(), 0.0);
    std::fill_n(vector.data, vector.size(), 0.0);
    std::vector<Index> movers;
    for (Index end = 0; end < dof; end++) {
        const End &sums = ends[end];
        if (!sums.used) continue;
        movers.clear();
        for (Index d = 0; d < dof; d++)
            if (moves(d, end)) movers.push_back(d);
        for (const Index d : movers) {
            const double *twist = twists[d].data;
            double half[6];
            for (int i = 0; i < 6; i++) {
                half[i] = 0.0;
                vector[d] += twist[i] * sums.pulls[i];
                for (int j = 0; j < 6; j++) half[i] += sums.wrenches[std::max(i, j)][std::min(i, j)] * twist[j];
            }
            for (const Index e : movers)
                for (int i = 0; i < 6; i++) matrix(e, d) += twists(e, i) * half[i];
        }
    }
}

}  // namespace bodytrack::body
